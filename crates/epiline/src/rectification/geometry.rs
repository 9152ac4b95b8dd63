//! What an aligned pair's numbers mean in metres.

use nalgebra::{Matrix3, Matrix4};

use crate::camera::DepthVariance;
use crate::error::{Error, Result};
use crate::image::check_sides;

/// Geometry of an aligned pair: both views share focal length, principal row and orientation.
///
/// With disparity `d = x_left - x_right`, depth along the optical axis is `Z = focal_px·baseline_m / (d + doffs_px)`
/// (eq. 2 of the paper).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectifiedGeometry {
    /// Width of both aligned images, pixels.
    pub width: usize,
    /// Height of both aligned images, pixels.
    pub height: usize,
    /// Focal length, pixels.
    pub focal_px: f64,
    /// Principal column of the left image, pixels.
    pub cx_px: f64,
    /// Principal row of both images, pixels.
    pub cy_px: f64,
    /// Principal column of the right image less that of the left, pixels; zero for rigs we align ourselves.
    pub doffs_px: f64,
    /// Distance between the cameras, metres.
    pub baseline_m: f64,
    /// Rotates left-camera directions into the aligned frame; identity if unknown.
    pub aligned_from_left: Matrix3<f64>,
    /// What the calibration's own uncertainty does to depth.
    pub calibration_variance: DepthVariance,
}

impl RectifiedGeometry {
    /// Geometry of a pair that came already aligned.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] unless focal length and baseline are positive, all is finite and the size is an
    /// image's.
    pub fn new(
        width: usize,
        height: usize,
        focal_px: f64,
        cx_px: f64,
        cy_px: f64,
        doffs_px: f64,
        baseline_m: f64,
    ) -> Result<Self> {
        check_sides("rectified image", width, height)?;
        let positive = |name, value: f64, unit: &str| {
            (value.is_finite() && value > 0.0)
                .then_some(())
                .ok_or_else(|| Error::invalid(name, format!("{value} {unit}"), "must be positive and finite"))
        };
        positive("focal_px", focal_px, "px")?;
        positive("baseline_m", baseline_m, "m")?;
        for (name, value) in [("cx_px", cx_px), ("cy_px", cy_px), ("doffs_px", doffs_px)] {
            if !value.is_finite() {
                return Err(Error::invalid(name, format!("{value} px"), "must be finite"));
            }
        }
        Ok(Self {
            width,
            height,
            focal_px,
            cx_px,
            cy_px,
            doffs_px,
            baseline_m,
            aligned_from_left: Matrix3::identity(),
            calibration_variance: DepthVariance::default(),
        })
    }

    /// Depth Z along the optical axis for a disparity, metres. Not positive finite where the rays do not meet in front.
    pub fn depth_m(&self, disparity_px: f64) -> f64 {
        self.focal_px * self.baseline_m / (disparity_px + self.doffs_px)
    }

    /// Disparity of a point at depth Z, pixels.
    pub fn disparity_px(&self, depth_m: f64) -> f64 {
        self.focal_px * self.baseline_m / depth_m - self.doffs_px
    }

    /// `‖ray‖` of a left pixel: range = depth times this.
    pub fn range_per_depth(&self, x: f64, y: f64) -> f64 {
        let (u, v) = ((x - self.cx_px) / self.focal_px, (y - self.cy_px) / self.focal_px);
        (1.0 + u * u + v * v).sqrt()
    }

    /// Bearing of a left column, radians: positive to the right of the optical axis.
    pub fn bearing_rad(&self, x: f64) -> f64 {
        ((x - self.cx_px) / self.focal_px).atan()
    }

    /// The matrix Q with `(X, Y, Z, 1)ᵀ ~ Q (x, y, d, 1)ᵀ`, metres in the left aligned frame.
    pub fn q_matrix(&self) -> Matrix4<f64> {
        let Self { focal_px: f, cx_px, cy_px, doffs_px, baseline_m, .. } = *self;
        Matrix4::new(
            1.0,
            0.0,
            0.0,
            -cx_px, //
            0.0,
            1.0,
            0.0,
            -cy_px, //
            0.0,
            0.0,
            0.0,
            f, //
            0.0,
            0.0,
            1.0 / baseline_m,
            doffs_px / baseline_m,
        )
    }
}
