//! The normal equations, the elimination of the board poses, and the solution.

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, Vector6};

/// A view's part of the normal equations: its pose block and its coupling to the free shared parameters.
pub(super) struct PoseBlock {
    pub pose: Matrix6<f64>,
    pub gradient: Vector6<f64>,
    /// 6 x free: transposed coupling, one column per shared parameter.
    pub coupling: Matrix6xX<f64>,
}

impl PoseBlock {
    /// Adds the coupling of the pose to some parameters: `value(pose, parameter)`.
    pub fn add_coupling(&mut self, slots: &[Option<usize>], value: impl Fn(usize, usize) -> f64) {
        for (k, slot) in slots.iter().enumerate() {
            if let Some(slot) = *slot {
                for i in 0..6 {
                    self.coupling[(i, slot)] += value(i, k);
                }
            }
        }
    }
}

/// The normal equations `JᵀWJ`, `JᵀWe` at an estimate.
pub(super) struct System {
    pub shared: DMatrix<f64>,
    pub gradient: DVector<f64>,
    pub blocks: Vec<PoseBlock>,
    pub cost: f64,
}

/// A step, and by how much the quadratic model says it lowers the cost.
pub(super) struct Step {
    pub shared: DVector<f64>,
    pub poses: Vec<Vector6<f64>>,
    pub predicted_reduction: f64,
}

/// Adds a block at the slots of its rows and columns; what is held fixed has none.
pub(super) fn add_block(
    shared: &mut DMatrix<f64>,
    rows: &[Option<usize>],
    columns: &[Option<usize>],
    value: impl Fn(usize, usize) -> f64,
) {
    for (c, column) in columns.iter().enumerate() {
        let Some(column) = *column else { continue };
        for (r, row) in rows.iter().enumerate() {
            if let Some(row) = *row {
                shared[(row, column)] += value(r, c);
            }
        }
    }
}

/// The shared parameters' equations once the poses are eliminated.
pub(super) struct Reduced {
    pub shared: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

impl System {
    /// Adds to the gradient at the slots of some parameters.
    pub fn add_gradient(&mut self, slots: &[Option<usize>], values: &[f64]) {
        for (slot, value) in slots.iter().zip(values) {
            if let Some(slot) = *slot {
                self.gradient[slot] += value;
            }
        }
    }

    /// Schur complement, with `damping` times the diagonal added to every block (Marquardt's scaling).
    pub fn reduced(&self, damping: f64) -> Option<Reduced> {
        let mut shared = self.shared.clone();
        for i in 0..shared.nrows() {
            shared[(i, i)] *= 1.0 + damping;
        }
        let mut gradient = self.gradient.clone();
        for block in &self.blocks {
            let factor = damped(&block.pose, damping).cholesky()?;
            let eliminated = factor.solve(&block.coupling);
            shared.gemm_tr(-1.0, &block.coupling, &eliminated, 1.0);
            gradient.gemv_tr(-1.0, &block.coupling, &factor.solve(&block.gradient), 1.0);
        }
        Some(Reduced { shared, gradient })
    }

    pub fn solve(&self, damping: f64) -> Option<Step> {
        let reduced = self.reduced(damping)?;
        let shared = -scaled_cholesky_solve(&reduced.shared, &reduced.gradient)?;
        let mut poses = Vec::with_capacity(self.blocks.len());
        // The model's promise: L(0) - L(h) = ½ hᵀ(damping·D h - g).
        let mut predicted_reduction =
            marquardt_product(damping, &self.shared.diagonal(), &shared) - shared.dot(&self.gradient);
        for block in &self.blocks {
            let factor = damped(&block.pose, damping).cholesky()?;
            let pose = -factor.solve(&(block.gradient + &block.coupling * &shared));
            for i in 0..6 {
                predicted_reduction += damping * block.pose[(i, i)] * pose[i] * pose[i];
            }
            predicted_reduction -= pose.dot(&block.gradient);
            poses.push(pose);
        }
        predicted_reduction *= 0.5;
        predicted_reduction.is_finite().then_some(Step { shared, poses, predicted_reduction })
    }
}

fn damped(pose: &Matrix6<f64>, damping: f64) -> Matrix6<f64> {
    let mut damped = *pose;
    for i in 0..6 {
        damped[(i, i)] *= 1.0 + damping;
    }
    damped
}

fn marquardt_product(damping: f64, diagonal: &DVector<f64>, step: &DVector<f64>) -> f64 {
    damping * diagonal.iter().zip(step.iter()).map(|(d, h)| d * h * h).sum::<f64>()
}

/// Reciprocal square roots of the diagonal: focal lengths of hundreds and coefficients of 1e-9 get one scale.
fn equilibration(matrix: &DMatrix<f64>) -> Option<DVector<f64>> {
    let scale = matrix.diagonal().map(|d| 1.0 / d.sqrt());
    scale.iter().all(|s| s.is_finite()).then_some(scale)
}

fn equilibrated(matrix: &DMatrix<f64>, scale: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |r, c| matrix[(r, c)] * scale[r] * scale[c])
}

pub(super) fn scaled_cholesky_solve(
    matrix: &DMatrix<f64>,
    right_side: &DVector<f64>,
) -> Option<DVector<f64>> {
    let scale = equilibration(matrix)?;
    let solution = equilibrated(matrix, &scale).cholesky()?.solve(&right_side.component_mul(&scale));
    Some(solution.component_mul(&scale))
}

pub(super) fn scaled_cholesky_inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = equilibration(matrix)?;
    let inverse = equilibrated(matrix, &scale).cholesky()?.inverse();
    Some(equilibrated(&inverse, &scale))
}
