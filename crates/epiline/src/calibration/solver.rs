//! Bundle adjustment: Levenberg–Marquardt on cameras, the pose between them and every board pose together.
//!
//! Each board pose meets only its own view, so the normal equations are block-arrow and the poses are eliminated
//! with the Schur complement (Triggs et al., "Bundle adjustment — a modern synthesis", 2000). What one
//! camera saw of one board is accumulated in that camera's own frame, by intrinsics and `camera_from_board`; a
//! 6x12 chain then carries the right camera's pose to the pose between the cameras and the board pose. A view that
//! only one camera saw is a view with no pixels for the other, and one camera alone is a rig of such views.

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, SMatrix, SVector, Vector2, Vector3, Vector6};

use super::lens::{Lens, Projected};
use crate::camera::Pose;

/// Corners of one board as both cameras saw them; an empty slice where a camera did not.
#[derive(Debug, Clone, Copy)]
pub(super) struct View<'a> {
    pub board_m: &'a [[f64; 3]],
    pub pixels: [&'a [[f64; 2]]; 2],
}

/// Everything that is solved for.
#[derive(Debug, Clone)]
pub(super) struct Estimate<const K: usize> {
    pub intrinsics: [SVector<f64, K>; 2],
    pub right_from_left: Pose,
    pub left_from_board: Vec<Pose>,
}

impl<const K: usize> Estimate<K> {
    /// Pose of a view's board in one camera's frame.
    pub fn camera_from_board(&self, camera: usize, view: usize) -> Pose {
        match camera {
            0 => self.left_from_board[view],
            _ => self.right_from_left.after(&self.left_from_board[view]),
        }
    }
}

/// How a corner's distance from its prediction is punished; `threshold_px` is infinite for least squares.
#[derive(Debug, Clone, Copy)]
pub(super) struct Huber {
    pub threshold_px: f64,
}

impl Huber {
    pub const SQUARED: Self = Self { threshold_px: f64::INFINITY };

    /// (weight, cost) of a residual of this length: the cost is `½ r²` inside the threshold, linear outside.
    fn weigh(&self, length_px: f64) -> (f64, f64) {
        if length_px <= self.threshold_px {
            (1.0, 0.5 * length_px * length_px)
        } else {
            (self.threshold_px / length_px, self.threshold_px * (length_px - 0.5 * self.threshold_px))
        }
    }
}

/// Where the minimisation ended.
#[derive(Debug, Clone)]
pub(super) struct Minimum<const K: usize> {
    pub estimate: Estimate<K>,
    pub converged: bool,
}

/// The problem: what was seen, through which lens, and which shared parameters are free.
pub(super) struct Bundle<'a, L, const K: usize> {
    lens: &'a L,
    views: &'a [View<'a>],
    /// For each of left intrinsics, right intrinsics, rotation, translation: its place among the free ones.
    slots: Vec<Option<usize>>,
    free_count: usize,
}

/// The normal equations of what one camera saw of one board, by intrinsics and `camera_from_board`.
struct LocalNormals<const K: usize> {
    intrinsics: SMatrix<f64, K, K>,
    cross: SMatrix<f64, K, 6>,
    pose: Matrix6<f64>,
    intrinsics_gradient: SVector<f64, K>,
    pose_gradient: Vector6<f64>,
    cost: f64,
}

/// A view's part of the normal equations: its pose block and its coupling to the free shared parameters.
struct PoseBlock {
    pose: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// 6 x free: transposed coupling, one column per shared parameter.
    coupling: Matrix6xX<f64>,
}

/// The normal equations `JᵀWJ`, `JᵀWe` at an estimate.
struct System {
    shared: DMatrix<f64>,
    gradient: DVector<f64>,
    blocks: Vec<PoseBlock>,
    cost: f64,
}

/// A step, and by how much the quadratic model says it lowers the cost.
struct Step {
    shared: DVector<f64>,
    poses: Vec<Vector6<f64>>,
    predicted_reduction: f64,
}

impl<'a, L: Lens<K>, const K: usize> Bundle<'a, L, K> {
    /// `free` has an entry for each of `K` left intrinsics, `K` right ones, three of rotation, three of translation.
    pub fn new(lens: &'a L, views: &'a [View<'a>], free: &[bool]) -> Self {
        debug_assert_eq!(free.len(), 2 * K + 6);
        let mut free_count = 0;
        let slots = free
            .iter()
            .map(|is_free| {
                is_free.then(|| {
                    free_count += 1;
                    free_count - 1
                })
            })
            .collect();
        Self { lens, views, slots, free_count }
    }

    /// Number of free parameters, poses included.
    pub fn parameter_count(&self) -> usize {
        self.free_count + 6 * self.views.len()
    }

    /// Minimises the cost from `start` until steps no longer lower it by more than `tolerance` of itself.
    pub fn minimise(&self, start: Estimate<K>, loss: Huber, tolerance: f64) -> Minimum<K> {
        const MAX_ITERATIONS: usize = 200;
        let mut estimate = start;
        let Some(mut system) = self.assemble(&estimate, loss) else {
            return Minimum { estimate, converged: false };
        };
        let corners = self.views.iter().flat_map(|v| v.pixels).map(<[_]>::len).sum::<usize>();
        // Residuals of 1e-9 px are rounding: pixels are numbers near a thousand.
        let negligible_cost = 1e-18 * corners as f64;
        let (mut damping, mut growth) = (1e-4, 2.0);
        for _ in 0..MAX_ITERATIONS {
            if system.cost <= negligible_cost {
                return Minimum { estimate, converged: true };
            }
            let Some(step) = system.solve(damping) else {
                damping *= growth;
                growth *= 2.0;
                continue;
            };
            let target = (tolerance * system.cost).max(negligible_cost);
            let trial = self.moved(&estimate, &step);
            let trial_system = self.assemble(&trial, loss).filter(|s| s.cost < system.cost);
            let Some(next) = trial_system else {
                // No step improves on a minimum: rounding decides once the model promises next to nothing.
                if step.predicted_reduction <= target {
                    return Minimum { estimate, converged: true };
                }
                if damping > 1e16 {
                    return Minimum { estimate, converged: false };
                }
                damping *= growth;
                growth *= 2.0;
                continue;
            };
            let reduction = system.cost - next.cost;
            // Nielsen, "Damping parameter in Marquardt's method", 1999.
            let gain = reduction / step.predicted_reduction;
            damping = (damping * (1.0 - (2.0 * gain - 1.0).powi(3)).max(0.1)).max(1e-12);
            growth = 2.0;
            (estimate, system) = (trial, next);
            // A heavily damped step is short because it is damped, not because the minimum is near.
            if reduction <= target && damping < 1e-2 {
                return Minimum { estimate, converged: true };
            }
        }
        Minimum { estimate, converged: false }
    }

    /// Distance of every corner from its prediction, pixels: `[view][camera][corner]`, flattened by `visit`.
    pub fn visit_residuals(
        &self,
        estimate: &Estimate<K>,
        mut visit: impl FnMut(usize, usize, Vector2<f64>),
    ) -> Option<()> {
        for (v, view) in self.views.iter().enumerate() {
            for (c, pixels) in view.pixels.iter().enumerate() {
                let pose = estimate.camera_from_board(c, v);
                for (point, pixel) in view.board_m.iter().zip(*pixels) {
                    let predicted =
                        self.lens.project(&estimate.intrinsics[c], &pose.apply(Vector3::from(*point)))?;
                    visit(v, c, predicted.pixel - Vector2::from(*pixel));
                }
            }
        }
        Some(())
    }

    /// Inverse of the normal equations of all corners at full weight, reduced to the free shared parameters and
    /// spread over all `2K + 6` of them (zeros for fixed ones), with the covariance of each board pose.
    ///
    /// Both are covariances for residuals of variance 1 px². `None` if the views do not determine the parameters.
    pub fn inverse_normals(&self, estimate: &Estimate<K>) -> Option<(DMatrix<f64>, Vec<Matrix6<f64>>)> {
        let system = self.assemble(estimate, Huber::SQUARED)?;
        let reduced = system.reduced(0.0)?;
        let inverse = scaled_cholesky_inverse(&reduced.shared)?;
        let mut covariance = DMatrix::zeros(self.slots.len(), self.slots.len());
        for (i, row) in self.slots.iter().enumerate() {
            for (j, column) in self.slots.iter().enumerate() {
                if let (Some(row), Some(column)) = (row, column) {
                    covariance[(i, j)] = inverse[(*row, *column)];
                }
            }
        }
        let pose_covariances = system
            .blocks
            .iter()
            .map(|block| {
                // V⁻¹ + V⁻¹ Wᵀ C W V⁻¹
                let inverse_pose = block.pose.cholesky()?.inverse();
                let gain = inverse_pose * &block.coupling;
                Some(inverse_pose + &gain * &inverse * gain.transpose())
            })
            .collect::<Option<Vec<_>>>()?;
        Some((covariance, pose_covariances))
    }

    fn assemble(&self, estimate: &Estimate<K>, loss: Huber) -> Option<System> {
        let n = self.free_count;
        let mut system = System {
            shared: DMatrix::zeros(n, n),
            gradient: DVector::zeros(n),
            blocks: Vec::with_capacity(self.views.len()),
            cost: 0.0,
        };
        for (v, view) in self.views.iter().enumerate() {
            let mut block = PoseBlock {
                pose: Matrix6::zeros(),
                gradient: Vector6::zeros(),
                coupling: Matrix6xX::zeros(n),
            };
            for camera in 0..2 {
                if view.pixels[camera].is_empty() {
                    continue;
                }
                let pose = estimate.camera_from_board(camera, v);
                let local = self.accumulate(
                    view.board_m,
                    view.pixels[camera],
                    &estimate.intrinsics[camera],
                    &pose,
                    loss,
                )?;
                system.cost += local.cost;
                if camera == 0 {
                    block.pose += local.pose;
                    block.gradient += local.pose_gradient;
                    self.add_intrinsics(&mut system, &mut block, 0, &local, &Matrix6::identity());
                } else {
                    self.add_right(&mut system, &mut block, &local, estimate, v);
                }
            }
            system.blocks.push(block);
        }
        system.cost.is_finite().then_some(system)
    }

    /// Normal equations of one camera's corners of one board.
    fn accumulate(
        &self,
        board_m: &[[f64; 3]],
        pixels: &[[f64; 2]],
        intrinsics: &SVector<f64, K>,
        camera_from_board: &Pose,
        loss: Huber,
    ) -> Option<LocalNormals<K>> {
        let mut sum = LocalNormals {
            intrinsics: SMatrix::zeros(),
            cross: SMatrix::zeros(),
            pose: Matrix6::zeros(),
            intrinsics_gradient: SVector::zeros(),
            pose_gradient: Vector6::zeros(),
            cost: 0.0,
        };
        for (point, pixel) in board_m.iter().zip(pixels) {
            let turned = camera_from_board.rotation * Vector3::from(*point);
            let Projected { pixel: predicted, by_point, by_intrinsics } =
                self.lens.project(intrinsics, &(turned + camera_from_board.translation_m))?;
            let residual = predicted - Vector2::from(*pixel);
            let (weight, cost) = loss.weigh(residual.norm());
            sum.cost += cost;
            for row in 0..2 {
                let slope = Vector3::new(by_point[(row, 0)], by_point[(row, 1)], by_point[(row, 2)]);
                // slope · (δ x turned) = δ · (turned x slope)
                let by_rotation = turned.cross(&slope);
                let by_pose =
                    Vector6::new(by_rotation.x, by_rotation.y, by_rotation.z, slope.x, slope.y, slope.z);
                let by_intrinsics: SVector<f64, K> = by_intrinsics.row(row).transpose();
                let weighted_pose = by_pose * weight;
                let weighted_intrinsics = by_intrinsics * weight;
                sum.intrinsics += weighted_intrinsics * by_intrinsics.transpose();
                sum.cross += weighted_intrinsics * by_pose.transpose();
                sum.pose += weighted_pose * by_pose.transpose();
                sum.intrinsics_gradient += weighted_intrinsics * residual[row];
                sum.pose_gradient += weighted_pose * residual[row];
            }
        }
        Some(sum)
    }

    /// Adds a camera's intrinsics and their coupling to the board pose; `by_board` is d(local pose)/d(board pose).
    fn add_intrinsics(
        &self,
        system: &mut System,
        block: &mut PoseBlock,
        offset: usize,
        local: &LocalNormals<K>,
        by_board: &Matrix6<f64>,
    ) {
        let cross = local.cross * by_board;
        for (r, row) in self.slots[offset..offset + K].iter().enumerate() {
            let Some(row) = *row else { continue };
            for (c, column) in self.slots[offset..offset + K].iter().enumerate() {
                if let Some(column) = *column {
                    system.shared[(row, column)] += local.intrinsics[(r, c)];
                }
            }
            system.gradient[row] += local.intrinsics_gradient[r];
            for i in 0..6 {
                block.coupling[(i, row)] += cross[(r, i)];
            }
        }
    }

    /// Carries the right camera's local pose to the pose between the cameras and the board pose.
    ///
    /// With `right_from_board = (R Rb, R tb + T)` and left increments, to first order
    /// `δ_local = δ + R δb` and `τ_local = δ x (R tb) + τ + R τb`.
    fn add_right(
        &self,
        system: &mut System,
        block: &mut PoseBlock,
        local: &LocalNormals<K>,
        estimate: &Estimate<K>,
        view: usize,
    ) {
        let rotation = estimate.right_from_left.rotation;
        let lever = rotation * estimate.left_from_board[view].translation_m;
        let mut by_rig = Matrix6::identity();
        by_rig.fixed_view_mut::<3, 3>(3, 0).copy_from(&-lever.cross_matrix());
        let mut by_board = Matrix6::zeros();
        by_board.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        by_board.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);

        self.add_intrinsics(system, block, K, local, &by_board);
        block.pose += by_board.transpose() * local.pose * by_board;
        block.gradient += by_board.transpose() * local.pose_gradient;
        let rig = by_rig.transpose() * local.pose * by_rig;
        let rig_gradient = by_rig.transpose() * local.pose_gradient;
        let rig_board = by_rig.transpose() * local.pose * by_board;
        let intrinsics_rig = local.cross * by_rig;
        for (r, row) in self.slots[2 * K..].iter().enumerate() {
            let Some(row) = *row else { continue };
            for (c, column) in self.slots[2 * K..].iter().enumerate() {
                if let Some(column) = *column {
                    system.shared[(row, column)] += rig[(r, c)];
                }
            }
            for (k, column) in self.slots[K..2 * K].iter().enumerate() {
                if let Some(column) = *column {
                    system.shared[(row, column)] += intrinsics_rig[(k, r)];
                    system.shared[(column, row)] += intrinsics_rig[(k, r)];
                }
            }
            system.gradient[row] += rig_gradient[r];
            for i in 0..6 {
                block.coupling[(i, row)] += rig_board[(r, i)];
            }
        }
    }

    fn moved(&self, estimate: &Estimate<K>, step: &Step) -> Estimate<K> {
        let mut next = estimate.clone();
        let of = |index: usize| self.slots[index].map_or(0.0, |slot| step.shared[slot]);
        for (camera, intrinsics) in next.intrinsics.iter_mut().enumerate() {
            for (k, value) in intrinsics.iter_mut().enumerate() {
                *value += of(camera * K + k);
            }
        }
        let increment = Vector6::from_fn(|i, _| of(2 * K + i));
        next.right_from_left = moved_pose(&next.right_from_left, &increment);
        for (pose, increment) in next.left_from_board.iter_mut().zip(&step.poses) {
            *pose = moved_pose(pose, increment);
        }
        next
    }
}

fn moved_pose(pose: &Pose, increment: &Vector6<f64>) -> Pose {
    pose.moved(increment.fixed_rows::<3>(0).into_owned(), increment.fixed_rows::<3>(3).into_owned())
}

/// The shared parameters' equations once the poses are eliminated.
struct Reduced {
    shared: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl System {
    /// Schur complement, with `damping` times the diagonal added to every block (Marquardt's scaling).
    fn reduced(&self, damping: f64) -> Option<Reduced> {
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

    fn solve(&self, damping: f64) -> Option<Step> {
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

fn scaled_cholesky_solve(matrix: &DMatrix<f64>, right_side: &DVector<f64>) -> Option<DVector<f64>> {
    let scale = equilibration(matrix)?;
    let solution = equilibrated(matrix, &scale).cholesky()?.solve(&right_side.component_mul(&scale));
    Some(solution.component_mul(&scale))
}

fn scaled_cholesky_inverse(matrix: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = equilibration(matrix)?;
    let inverse = equilibrated(matrix, &scale).cholesky()?.inverse();
    Some(equilibrated(&inverse, &scale))
}

#[cfg(test)]
mod tests;
