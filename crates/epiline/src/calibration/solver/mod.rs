//! Bundle adjustment: Levenberg–Marquardt on cameras, the pose between them and every board pose together.
//!
//! Each board pose meets only its own view, so the normal equations are block-arrow and the poses are eliminated
//! with the Schur complement (Triggs et al., "Bundle adjustment — a modern synthesis", 2000). What one
//! camera saw of one board is accumulated in that camera's own frame, by intrinsics and `camera_from_board`; a
//! 6x12 chain then carries the right camera's pose to the pose between the cameras and the board pose. A view that
//! only one camera saw is a view with no pixels for the other, and one camera alone is a rig of such views.

mod equations;
mod local;
#[cfg(test)]
mod tests;

use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, SVector, Vector2, Vector6};

use super::lens::Lens;
use super::warp::BoardShape;
use crate::camera::Pose;
use equations::{PoseBlock, Step, System, add_block, scaled_cholesky_inverse};
use local::LocalNormals;

/// Corners of one board as both cameras saw them: NaN for a corner that a camera did not see, an empty slice where it
/// saw none.
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
    /// How far the board's middle stands out, along its x and y axis, metres.
    pub board_warp_m: Vector2<f64>,
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

/// Which of the shared parameters are solved for, and which of them are one.
///
/// They are, in this order, the `K` left intrinsics, the `K` right ones, three of rotation and three of translation
/// between the cameras, and the two of the board's warp.
#[derive(Debug, Clone)]
pub(super) struct Freedom {
    /// For each its place among the free ones.
    slots: Vec<Option<usize>>,
    count: usize,
}

impl Freedom {
    /// Parameters beside the intrinsics.
    pub const POSE_AND_WARP: usize = 6 + 2;

    /// `ties` are pairs of parameters with one value; both must start from it.
    pub fn new(free: &[bool], ties: &[(usize, usize)]) -> Self {
        let first = representatives(free.len(), ties);
        let (mut slots, mut count) = (vec![None; free.len()], 0);
        for i in 0..free.len() {
            if first[i] < i {
                slots[i] = slots[first[i]];
            } else if free[i] {
                slots[i] = Some(count);
                count += 1;
            }
        }
        Self { slots, count }
    }
}

/// For each parameter the first of those that are tied to it, over any number of ties; itself if none is.
pub(super) fn representatives(count: usize, ties: &[(usize, usize)]) -> Vec<usize> {
    let mut first: Vec<usize> = (0..count).collect();
    for &(a, b) in ties {
        let (low, high) = (first[a].min(first[b]), first[a].max(first[b]));
        first.iter_mut().filter(|f| **f == high).for_each(|f| *f = low);
    }
    first
}

/// The problem: what was seen, through which lens, and which shared parameters are free.
pub(super) struct Bundle<'a, L, const K: usize> {
    lens: &'a L,
    views: &'a [View<'a>],
    board: BoardShape,
    freedom: &'a Freedom,
}

impl<'a, L: Lens<K>, const K: usize> Bundle<'a, L, K> {
    pub fn new(lens: &'a L, views: &'a [View<'a>], freedom: &'a Freedom) -> Self {
        debug_assert_eq!(freedom.slots.len(), 2 * K + Freedom::POSE_AND_WARP);
        let board = BoardShape::of(views.iter().flat_map(|v| v.board_m));
        Self { lens, views, board, freedom }
    }

    /// Number of free parameters, poses included.
    pub fn parameter_count(&self) -> usize {
        self.freedom.count + 6 * self.views.len()
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

    /// Calls `visit(view, camera, corner, predicted minus seen)` for every corner seen; `None` if one has no image.
    pub fn visit_residuals(
        &self,
        estimate: &Estimate<K>,
        mut visit: impl FnMut(usize, usize, usize, Vector2<f64>),
    ) -> Option<()> {
        for (v, view) in self.views.iter().enumerate() {
            for (c, pixels) in view.pixels.iter().enumerate() {
                let pose = estimate.camera_from_board(c, v);
                for (i, (point, pixel)) in view.board_m.iter().zip(*pixels).enumerate() {
                    if is_seen(pixel) {
                        let lifted = self.board.lifted(point, &estimate.board_warp_m);
                        let predicted = self.lens.project(&estimate.intrinsics[c], &pose.apply(lifted))?;
                        visit(v, c, i, predicted.pixel - Vector2::from(*pixel));
                    }
                }
            }
        }
        Some(())
    }

    /// Inverse of the normal equations of all corners at full weight, reduced to the free shared parameters and
    /// spread over all of them (zeros for fixed ones), with the covariance of each board pose.
    ///
    /// Both are covariances for residuals of variance 1 px². `None` if the views do not determine the parameters.
    pub fn inverse_normals(&self, estimate: &Estimate<K>) -> Option<(DMatrix<f64>, Vec<Matrix6<f64>>)> {
        let system = self.assemble(estimate, Huber::SQUARED)?;
        let reduced = system.reduced(0.0)?;
        let inverse = scaled_cholesky_inverse(&reduced.shared)?;
        let slots = &self.freedom.slots;
        let covariance = DMatrix::from_fn(slots.len(), slots.len(), |i, j| {
            slots[i].zip(slots[j]).map_or(0.0, |(row, column)| inverse[(row, column)])
        });
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
        let n = self.freedom.count;
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
                let local = self.accumulate(view, camera, estimate, &pose, loss)?;
                system.cost += local.cost;
                if camera == 0 {
                    self.add_camera(&mut system, &mut block, 0, &local, &Matrix6::identity());
                } else {
                    self.add_right(&mut system, &mut block, &local, estimate, v);
                }
            }
            system.blocks.push(block);
        }
        system.cost.is_finite().then_some(system)
    }

    fn is_warp_free(&self) -> bool {
        self.freedom.slots[2 * K + 6].is_some()
    }

    /// Adds what one camera says of its intrinsics, the warp and the board pose; `by_board` is
    /// d(local pose)/d(board pose).
    fn add_camera(
        &self,
        system: &mut System,
        block: &mut PoseBlock,
        offset: usize,
        local: &LocalNormals<K>,
        by_board: &Matrix6<f64>,
    ) {
        block.pose += by_board.transpose() * local.pose * by_board;
        block.gradient += by_board.transpose() * local.pose_gradient;
        let slots = &self.freedom.slots;
        let intrinsics = &slots[offset..offset + K];
        add_block(&mut system.shared, intrinsics, intrinsics, |r, c| local.intrinsics[(r, c)]);
        system.add_gradient(intrinsics, local.intrinsics_gradient.as_slice());
        let cross = local.cross * by_board;
        block.add_coupling(intrinsics, |i, k| cross[(k, i)]);
        if self.is_warp_free() {
            let (warp, part) = (&slots[2 * K + 6..], &local.warp);
            add_block(&mut system.shared, warp, warp, |r, c| part.own[(r, c)]);
            add_block(&mut system.shared, warp, intrinsics, |r, c| part.intrinsics[(c, r)]);
            add_block(&mut system.shared, intrinsics, warp, |r, c| part.intrinsics[(r, c)]);
            system.add_gradient(warp, part.gradient.as_slice());
            let pose = by_board.transpose() * part.pose;
            block.add_coupling(warp, |i, k| pose[(i, k)]);
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
        self.add_camera(system, block, K, local, &by_board);

        let slots = &self.freedom.slots;
        let (intrinsics, rig, warp) = (&slots[K..2 * K], &slots[2 * K..2 * K + 6], &slots[2 * K + 6..]);
        let own = by_rig.transpose() * local.pose * by_rig;
        add_block(&mut system.shared, rig, rig, |r, c| own[(r, c)]);
        let by_intrinsics = local.cross * by_rig;
        add_block(&mut system.shared, rig, intrinsics, |r, c| by_intrinsics[(c, r)]);
        add_block(&mut system.shared, intrinsics, rig, |r, c| by_intrinsics[(r, c)]);
        if self.is_warp_free() {
            let by_warp = by_rig.transpose() * local.warp.pose;
            add_block(&mut system.shared, rig, warp, |r, c| by_warp[(r, c)]);
            add_block(&mut system.shared, warp, rig, |r, c| by_warp[(c, r)]);
        }
        system.add_gradient(rig, (by_rig.transpose() * local.pose_gradient).as_slice());
        let board = by_rig.transpose() * local.pose * by_board;
        block.add_coupling(rig, |i, k| board[(k, i)]);
    }

    fn moved(&self, estimate: &Estimate<K>, step: &Step) -> Estimate<K> {
        let mut next = estimate.clone();
        let of = |index: usize| self.freedom.slots[index].map_or(0.0, |slot| step.shared[slot]);
        for (camera, intrinsics) in next.intrinsics.iter_mut().enumerate() {
            for (k, value) in intrinsics.iter_mut().enumerate() {
                *value += of(camera * K + k);
            }
        }
        let increment = Vector6::from_fn(|i, _| of(2 * K + i));
        next.right_from_left = moved_pose(&next.right_from_left, &increment);
        next.board_warp_m += Vector2::new(of(2 * K + 6), of(2 * K + 7));
        for (pose, increment) in next.left_from_board.iter_mut().zip(&step.poses) {
            *pose = moved_pose(pose, increment);
        }
        next
    }
}

fn moved_pose(pose: &Pose, increment: &Vector6<f64>) -> Pose {
    pose.moved(increment.fixed_rows::<3>(0).into_owned(), increment.fixed_rows::<3>(3).into_owned())
}

/// Whether a corner was seen: NaN stands for one that was not.
pub(super) fn is_seen(pixel: &[f64; 2]) -> bool {
    !pixel[0].is_nan()
}
