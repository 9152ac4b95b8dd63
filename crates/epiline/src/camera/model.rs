//! One camera: a lens, a focal length and a principal point in pixels, and an image size.

use nalgebra::{Vector2, Vector3};

use super::lens::{Lens, LensView};
use crate::error::{Error, Result};

/// One camera: `u = fx x' + cx`, `v = fy y' + cy`, where the [`Lens`] takes a direction to `(x', y')`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraModel {
    /// Focal lengths along x and y, pixels.
    pub focal_px: [f64; 2],
    /// Principal point (x, y), pixels; (0, 0) is the centre of the top-left pixel.
    pub center_px: [f64; 2],
    /// How the lens bends light.
    pub lens: Lens,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
}

impl CameraModel {
    /// Names of the four intrinsic parameters that every camera has, before its lens coefficients.
    pub const PINHOLE_PARAMETERS: [&'static str; 4] = ["fx", "fy", "cx", "cy"];

    /// Fails unless every number is finite and both focal lengths are positive.
    pub fn validate(&self) -> Result<()> {
        let pinhole = self.focal_px.into_iter().chain(self.center_px);
        let pinhole = Self::PINHOLE_PARAMETERS.into_iter().zip(pinhole);
        let coefficients = self.lens.coefficient_names().iter().copied().zip(self.lens.coefficients());
        for (name, value) in pinhole.chain(coefficients) {
            if !value.is_finite() {
                return Err(Error::invalid(name, value, "must be finite"));
            }
        }
        for (name, value) in Self::PINHOLE_PARAMETERS.into_iter().zip(self.focal_px) {
            if value <= 0.0 {
                return Err(Error::invalid(name, format!("{value} px"), "a focal length must be positive"));
            }
        }
        if self.width == 0 || self.height == 0 {
            let size = format!("{}x{} px", self.width, self.height);
            return Err(Error::invalid("image_size", size, "both sides must be positive"));
        }
        Ok(())
    }

    /// The camera with the limit of its lens's field of view worked out: for projecting much.
    pub fn view(&self) -> CameraView {
        CameraView { camera: *self, lens: self.lens.view() }
    }

    /// [`CameraView::project`], for a single point.
    pub fn project(&self, point_m: Vector3<f64>) -> Option<Vector2<f64>> {
        self.view().project(&point_m)
    }

    /// [`CameraView::direction`], for a single pixel.
    pub fn direction(&self, pixel: Vector2<f64>) -> Option<Vector3<f64>> {
        self.view().direction(pixel)
    }

    /// [`CameraView::normalised_from_pixel`], for a single pixel.
    pub fn normalised_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        self.view().normalised_from_pixel(pixel)
    }
}

/// A [`CameraModel`] ready to project: nothing beyond its field of view has an image.
#[derive(Debug, Clone, Copy)]
pub struct CameraView {
    camera: CameraModel,
    lens: LensView,
}

impl CameraView {
    /// The camera.
    pub fn camera(&self) -> &CameraModel {
        &self.camera
    }

    /// The largest angle from the axis that has an image, radians, whether or not it falls within the picture.
    pub fn largest_angle_rad(&self) -> f64 {
        self.lens.largest_angle_rad()
    }

    /// Where a point of the camera's frame appears, pixels, inside the picture or not; `None` outside the field of
    /// view.
    pub fn project(&self, point_m: &Vector3<f64>) -> Option<Vector2<f64>> {
        let at = self.lens.image(point_m)?;
        let ([fx, fy], [cx, cy]) = (self.camera.focal_px, self.camera.center_px);
        Some(Vector2::new(fx * at.x + cx, fy * at.y + cy))
    }

    /// The direction, of length one, that a pixel sees; `None` if there is none inside the field of view.
    pub fn direction(&self, pixel: Vector2<f64>) -> Option<Vector3<f64>> {
        let ([fx, fy], [cx, cy]) = (self.camera.focal_px, self.camera.center_px);
        self.lens.direction(Vector2::new((pixel.x - cx) / fx, (pixel.y - cy) / fy))
    }

    /// Pixel to normalised ideal point `(X/Z, Y/Z)`; `None` where there is none, as beside and behind the camera.
    pub fn normalised_from_pixel(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let ray = self.direction(pixel)?;
        (ray.z > 0.0).then(|| ray.xy() / ray.z)
    }
}

#[cfg(test)]
mod tests {
    use super::super::lens::Brown;
    use super::*;

    #[test]
    fn nan_is_named() {
        let camera = CameraModel {
            focal_px: [500.0, f64::NAN],
            center_px: [320.0, 240.0],
            lens: Lens::default(),
            width: 640,
            height: 480,
        };
        let message = camera.validate().expect_err("NaN must be refused").to_string();
        assert!(message.contains("fy = NaN"), "{message}");
        let lens = Lens::Brown(Brown { p2: f64::INFINITY, ..Brown::default() });
        let message = CameraModel { focal_px: [500.0; 2], lens, ..camera }.validate().expect_err("infinite");
        assert!(message.to_string().contains("p2 = inf"), "{message}");
    }
}
