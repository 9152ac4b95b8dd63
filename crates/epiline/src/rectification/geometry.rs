//! What an aligned pair's numbers mean in metres.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Matrix4, Vector2, Vector3};

use super::projection::Projection;
use crate::camera::DepthVariance;
use crate::error::{Error, Result};
use crate::image::check_sides;

/// Geometry of an aligned pair: both views share focal length, principal row and orientation.
///
/// With disparity `d = x_left - x_right`, depth along the optical axis is `Z = focal_px·baseline_m / (d + doffs_px)`
/// (eq. 2 of the paper) on a plane. On a cylinder disparity is an angle, `δ = (d + doffs_px) / focal_px`, and with the
/// columns' angles `ψ` the law of sines gives the range `b·cos(ψ_right) / sin(δ)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RectifiedGeometry {
    /// Width of both aligned images, pixels.
    pub width: usize,
    /// Height of both aligned images, pixels.
    pub height: usize,
    /// What the images are drawn on.
    pub projection: Projection,
    /// Focal length, pixels; on a cylinder pixels per radian.
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
            projection: Projection::Pinhole,
            focal_px,
            cx_px,
            cy_px,
            doffs_px,
            baseline_m,
            aligned_from_left: Matrix3::identity(),
            calibration_variance: DepthVariance::default(),
        })
    }

    /// Depth Z along the optical axis for a disparity, metres; on a cylinder that of a point on the axis, whose left
    /// column is `cx_px`. Not positive finite where the rays do not meet in front.
    #[inline]
    pub fn depth_m(&self, disparity_px: f64) -> f64 {
        let slope = (disparity_px + self.doffs_px) / self.focal_px;
        match self.projection {
            Projection::Pinhole => self.baseline_m / slope,
            Projection::Cylindrical => self.baseline_m / slope.tan(),
        }
    }

    /// Disparity of a point at depth Z, pixels; on a cylinder of one on the optical axis.
    pub fn disparity_px(&self, depth_m: f64) -> f64 {
        let slope = match self.projection {
            Projection::Pinhole => self.baseline_m / depth_m,
            Projection::Cylindrical => self.baseline_m.atan2(depth_m),
        };
        self.focal_px * slope - self.doffs_px
    }

    /// The point seen at (x, y) of the left image with a disparity, metres in the left aligned frame; `None` where the
    /// two rays do not meet in front of both cameras.
    pub fn point_m(&self, x: f64, y: f64, disparity_px: f64) -> Option<Vector3<f64>> {
        let ray = self.projection.ray(Vector2::new(x - self.cx_px, y - self.cy_px) / self.focal_px)?;
        match self.projection {
            Projection::Pinhole => {
                let depth_m = self.depth_m(disparity_px);
                (depth_m.is_finite() && depth_m > 0.0).then(|| ray * depth_m)
            }
            Projection::Cylindrical => {
                let angle = (disparity_px + self.doffs_px) / self.focal_px;
                let right = (x - self.cx_px) / self.focal_px - angle;
                // Of length one: the range is the factor.
                (angle > 0.0 && right > -FRAC_PI_2)
                    .then(|| ray * (self.baseline_m * right.cos() / angle.sin()))
            }
        }
    }

    /// Where a point of the left aligned frame is seen: (x, y) of the left image and the disparity, pixels; `None`
    /// where one of the two images cannot show it.
    pub fn pixel_of(&self, point_m: &Vector3<f64>) -> Option<[f64; 3]> {
        let left = self.projection.flat(point_m)?;
        let right = self.projection.flat(&(point_m - Vector3::new(self.baseline_m, 0.0, 0.0)))?;
        Some([
            self.focal_px * left.x + self.cx_px,
            self.focal_px * left.y + self.cy_px,
            self.focal_px * (left.x - right.x) - self.doffs_px,
        ])
    }

    /// Fails for a cylinder: `what` counts on `Z = f·b/d`.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for a cylinder.
    pub fn require_pinhole(&self, what: &'static str) -> Result<()> {
        match self.projection {
            Projection::Pinhole => Ok(()),
            Projection::Cylindrical => Err(Error::invalid(
                "projection",
                "'cylindrical'",
                format!("{what} needs a pinhole pair; points of a cylindrical one are RectifiedGeometry's"),
            )),
        }
    }

    /// `‖ray‖` of a left pixel: range = depth times this.
    #[inline]
    pub fn range_per_depth(&self, x: f64, y: f64) -> f64 {
        let (u, v) = ((x - self.cx_px) / self.focal_px, (y - self.cy_px) / self.focal_px);
        (1.0 + u * u + v * v).sqrt()
    }

    /// Bearing of a left column, radians: positive to the right of the optical axis.
    pub fn bearing_rad(&self, x: f64) -> f64 {
        ((x - self.cx_px) / self.focal_px).atan()
    }

    /// The matrix Q of a pinhole pair, with `(X, Y, Z, 1)ᵀ ~ Q (x, y, d, 1)ᵀ`, metres in the left aligned frame.
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
