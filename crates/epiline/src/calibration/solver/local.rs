//! What one camera saw of one board, as normal equations in that camera's own frame.

use nalgebra::{Matrix2, Matrix6, Matrix6x2, SMatrix, SVector, Vector2, Vector3, Vector6};

use super::super::lens::{Lens, Projected};
use super::{Bundle, Estimate, Huber, View, is_seen};
use crate::camera::Pose;

/// By intrinsics and `camera_from_board`, and by the warp of the board.
pub(super) struct LocalNormals<const K: usize> {
    pub intrinsics: SMatrix<f64, K, K>,
    pub cross: SMatrix<f64, K, 6>,
    pub pose: Matrix6<f64>,
    pub intrinsics_gradient: SVector<f64, K>,
    pub pose_gradient: Vector6<f64>,
    pub warp: WarpNormals<K>,
    pub cost: f64,
}

/// The part of the board's two warp parameters; zero if they are not free.
pub(super) struct WarpNormals<const K: usize> {
    pub own: Matrix2<f64>,
    pub intrinsics: SMatrix<f64, K, 2>,
    pub pose: Matrix6x2<f64>,
    pub gradient: Vector2<f64>,
}

impl<L: Lens<K>, const K: usize> Bundle<'_, L, K> {
    /// `None` where a corner has no image.
    pub(super) fn accumulate(
        &self,
        view: &View<'_>,
        camera: usize,
        estimate: &Estimate<K>,
        camera_from_board: &Pose,
        loss: Huber,
    ) -> Option<LocalNormals<K>> {
        let mut sum = LocalNormals {
            intrinsics: SMatrix::zeros(),
            cross: SMatrix::zeros(),
            pose: Matrix6::zeros(),
            intrinsics_gradient: SVector::zeros(),
            pose_gradient: Vector6::zeros(),
            warp: WarpNormals {
                own: Matrix2::zeros(),
                intrinsics: SMatrix::zeros(),
                pose: Matrix6x2::zeros(),
                gradient: Vector2::zeros(),
            },
            cost: 0.0,
        };
        let board_normal: Vector3<f64> = camera_from_board.rotation.column(2).into_owned();
        for (point, pixel) in view.board_m.iter().zip(view.pixels[camera]) {
            if !is_seen(pixel) {
                continue;
            }
            let turned = camera_from_board.rotation * self.board.lifted(point, &estimate.board_warp_m);
            let Projected { pixel: predicted, by_point, by_intrinsics } = self
                .lens
                .project(&estimate.intrinsics[camera], &(turned + camera_from_board.translation_m))?;
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
                if self.is_warp_free() {
                    let by_warp = self.board.bend(point) * slope.dot(&board_normal);
                    sum.warp.own += by_warp * by_warp.transpose() * weight;
                    sum.warp.intrinsics += weighted_intrinsics * by_warp.transpose();
                    sum.warp.pose += weighted_pose * by_warp.transpose();
                    sum.warp.gradient += by_warp * (weight * residual[row]);
                }
            }
        }
        Some(sum)
    }
}
