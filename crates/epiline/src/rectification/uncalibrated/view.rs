//! The aligned images of an estimated rig.

use nalgebra::{Matrix3, Vector2};

use super::rig::{Match, Rig};
use crate::error::Result;
use crate::image::{Image, ImageRef};
use crate::rectification::remap::Remap;

/// Which part of the aligned frame the images show: one focal length and principal row, a principal column each.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    rig: Rig,
    size: [usize; 2],
    center_px: [[f64; 2]; 2],
}

impl View {
    /// A view that keeps the left photograph's middle in the middle, and in which the smallest of the disparities, pixels,
    /// becomes `least_px`.
    pub fn with_least_disparity(rig: &Rig, size: [usize; 2], smallest_px: f64, least_px: f64) -> Self {
        let middle = size.map(|side| 0.5 * (side as f64 - 1.0));
        let aligned = rig.align(&[Vector2::from(middle); 2]).unwrap_or([Vector2::zeros(); 2]);
        let cx = middle[0] - rig.focal_px * aligned[0].x;
        let cy = middle[1] - rig.focal_px * 0.5 * (aligned[0].y + aligned[1].y);
        let shift = smallest_px - least_px;
        Self { rig: *rig, size, center_px: [[cx, cy], [cx + shift, cy]] }
    }

    /// The photographs' pixels at which a match in the aligned images lies.
    pub fn in_photographs(&self, aligned: [[f64; 2]; 2]) -> Option<Match> {
        let pixel = |side| self.rig.pixel_of(side, self.normalised(side, aligned[side]));
        Some([pixel(0)?, pixel(1)?])
    }

    /// Where a match of the photographs lies in the aligned images.
    pub fn in_aligned(&self, points: &Match) -> Option<[[f64; 2]; 2]> {
        let aligned = self.rig.align(points)?;
        Some([0, 1].map(|side| {
            [0, 1].map(|axis| self.rig.focal_px * aligned[side][axis] + self.center_px[side][axis])
        }))
    }

    fn normalised(&self, side: usize, pixel: [f64; 2]) -> Vector2<f64> {
        (Vector2::from(pixel) - Vector2::from(self.center_px[side])) / self.rig.focal_px
    }

    /// The aligned image of a photograph, and where it has a source (255) and where not (0).
    pub fn render(&self, side: usize, photograph: ImageRef<'_, u8>) -> Result<[Image<u8>; 2]> {
        let [width, height] = self.size;
        let map = Remap::from_fn((width, height), (photograph.width(), photograph.height()), |x, y| {
            let pixel = self.rig.pixel_of(side, self.normalised(side, [x as f64, y as f64]))?;
            Some([pixel.x, pixel.y])
        })?;
        let mut aligned = Image::default();
        map.apply("photograph", photograph, &mut aligned)?;
        let mut valid = Image::new(width, height);
        for y in 0..height {
            valid.row_mut(y).copy_from_slice(map.valid().row(y));
        }
        Ok([aligned, valid])
    }

    /// Maps pixels of the photograph, once freed of lens distortion, to pixels of the aligned image.
    pub fn homography(&self, side: usize) -> Matrix3<f64> {
        let camera = self.rig.cameras[side].camera();
        let pinhole = |focal: [f64; 2], center: [f64; 2]| {
            Matrix3::new(focal[0], 0.0, center[0], 0.0, focal[1], center[1], 0.0, 0.0, 1.0)
        };
        let to_rays =
            pinhole(camera.focal_px, camera.center_px).try_inverse().expect("focal lengths are positive");
        pinhole([self.rig.focal_px; 2], self.center_px[side]) * self.rig.turns[side].rotation * to_rays
    }
}
