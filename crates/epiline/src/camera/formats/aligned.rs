//! Pairs that came aligned: all that Middlebury's and KITTI's files say of them.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::{Pair, file_error};
use crate::camera::{CameraModel, Lens, Pose, StereoCalibration};
use crate::error::{Error, Result};

/// Two pinhole cameras with one focal length and one principal row, side by side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Aligned {
    pub focal_px: f64,
    pub left_cx_px: f64,
    pub right_cx_px: f64,
    pub cy_px: f64,
    pub baseline_m: f64,
    pub width: usize,
    pub height: usize,
}

impl Aligned {
    /// The two cameras and their pose.
    pub fn pair(&self) -> Pair {
        let camera = |cx: f64| CameraModel {
            focal_px: [self.focal_px; 2],
            center_px: [cx, self.cy_px],
            lens: Lens::default(),
            width: self.width,
            height: self.height,
        };
        Pair {
            left: camera(self.left_cx_px),
            right: camera(self.right_cx_px),
            right_from_left: Pose {
                rotation: Matrix3::identity(),
                translation_m: Vector3::new(-self.baseline_m, 0.0, 0.0),
            },
        }
    }

    /// Of a rig that is nothing more; else an error that says what the format cannot hold.
    pub fn of(path: &Path, rig: &StereoCalibration) -> Result<Self> {
        let StereoCalibration { left, right, right_from_left, .. } = rig;
        let refused = |what: String| -> Result<Self> { Err(cannot_hold(path, what)) };
        for (side, camera) in [("left", left), ("right", right)] {
            if camera.lens.coefficients().iter().any(|&c| c != 0.0)
                || matches!(camera.lens, Lens::KannalaBrandt(_))
            {
                return refused(format!("the {side} lens's distortion"));
            }
        }
        if right_from_left.rotation != Matrix3::identity() {
            return refused("a rotation between the cameras".into());
        }
        let t = right_from_left.translation_m;
        if t.y != 0.0 || t.z != 0.0 || t.x >= 0.0 {
            return refused(format!(
                "a translation of ({}, {}, {}) m, which is not along the rows",
                t.x, t.y, t.z
            ));
        }
        let [focal_px, fy] = left.focal_px;
        if [focal_px, focal_px, focal_px] != [fy, right.focal_px[0], right.focal_px[1]] {
            return refused("more than one focal length".into());
        }
        if left.center_px[1] != right.center_px[1] {
            return refused("two principal rows".into());
        }
        if (left.width, left.height) != (right.width, right.height) {
            return refused("two sizes of images".into());
        }
        Ok(Self {
            focal_px,
            left_cx_px: left.center_px[0],
            right_cx_px: right.center_px[0],
            cy_px: left.center_px[1],
            baseline_m: -t.x,
            width: left.width,
            height: left.height,
        })
    }
}

fn cannot_hold(path: &Path, what: String) -> Error {
    file_error(path, "document", format!("describes an aligned pair and cannot hold {what}; rectify first"))
}
