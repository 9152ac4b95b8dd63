//! A calibrated rig's maps, computed once.

use nalgebra::{Matrix3, Vector3};

use super::geometry::RectifiedGeometry;
use super::remap::Remap;
use super::view::shared_principal_point;
use crate::camera::{AlignedFrame, CameraModel, StereoCalibration};
use crate::error::{Error, Result};
use crate::image::{Image, ImageRef, check_sides};

/// What the aligned images should look like. The default suits matching.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RectifierOptions {
    /// Width and height of both aligned images, pixels. Default: those of the left camera. Another size shows more
    /// or less of the scene at the same scale; to scale the picture, give `focal_px` too.
    pub size: Option<(usize, usize)>,
    /// Focal length of both aligned images, pixels. Default: [`AlignedFrame::common_focal_px`], so that the middle of
    /// the picture keeps its scale. A smaller one shows more of the scene, smaller.
    pub focal_px: Option<f64>,
}

/// Aligns the images of a calibrated rig, so that a point of the scene lies on one row in both.
///
/// - **Rotation**: each camera turns by half of the rotation between them, then both turn together until the
///   baseline is horizontal ([`AlignedFrame`]).
/// - **Focal length** and **principal row**: one for both. The focal length is that of the cameras: nothing is
///   zoomed to squeeze in the far corners of a distorted image, nor to hide the border.
/// - **Principal point**: one for both, so that disparity 0 is infinity, placed so that the middle of the output
///   shows the middle of what both cameras see at infinity.
/// - **Border**: output pixels with no source are 0 in the image and 0 in the valid mask; nothing is filled in.
///   What lies beyond the fold of a lens polynomial is no source either, although the polynomial leads back into
///   the image from there.
///
/// The images are resampled as [`Remap`] says: bilinear, eq. 4 of the paper, positions in 1/256 px.
#[derive(Debug, Clone)]
pub struct Rectifier {
    geometry: RectifiedGeometry,
    left: Remap,
    right: Remap,
}

impl Rectifier {
    /// Maps for a rig, with the default options.
    ///
    /// # Errors
    ///
    /// Those of [`with_options`](Self::with_options).
    pub fn new(calibration: &StereoCalibration) -> Result<Self> {
        Self::with_options(calibration, RectifierOptions::default())
    }

    /// Maps for a rig.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for a rig that cannot exist (see [`StereoCalibration::validate`]), an image or
    /// output side beyond [`MAX_SIDE_PX`](crate::image::MAX_SIDE_PX) or a focal length that is not positive and
    /// finite; [`Error::Degenerate`] where no rotation aligns the views ([`AlignedFrame::of`]) or the cameras see
    /// nothing in common.
    pub fn with_options(calibration: &StereoCalibration, options: RectifierOptions) -> Result<Self> {
        calibration.validate()?;
        let StereoCalibration { left, right, right_from_left, .. } = calibration;
        check_sides("left camera", left.width, left.height)?;
        check_sides("right camera", right.width, right.height)?;
        let (width, height) = options.size.unwrap_or((left.width, left.height));
        let focal_px = options.focal_px.unwrap_or_else(|| AlignedFrame::common_focal_px(left, right));

        let frame = AlignedFrame::of(right_from_left)?;
        let [cx_px, cy_px] = shared_principal_point(&frame, [left, right], [width, height], focal_px)?;
        let mut geometry =
            RectifiedGeometry::new(width, height, focal_px, cx_px, cy_px, 0.0, frame.baseline_m)?;
        geometry.aligned_from_left = frame.aligned_from_left;
        geometry.calibration_variance = calibration.depth_variance();

        let left = camera_map("left camera", left, &frame.aligned_from_left, &geometry)?;
        let right = camera_map("right camera", right, &frame.aligned_from_right, &geometry)?;
        Ok(Self { geometry, left, right })
    }

    /// Geometry of the aligned images.
    pub fn geometry(&self) -> &RectifiedGeometry {
        &self.geometry
    }

    /// Aligns an image of the left camera; `dst` takes the size of the aligned images.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] unless `src` has the size of the calibrated images.
    pub fn rectify_left(&self, src: ImageRef<'_, u8>, dst: &mut Image<u8>) -> Result<()> {
        self.left.apply("left image", src, dst)
    }

    /// Aligns an image of the right camera, as [`rectify_left`](Self::rectify_left).
    pub fn rectify_right(&self, src: ImageRef<'_, u8>, dst: &mut Image<u8>) -> Result<()> {
        self.right.apply("right image", src, dst)
    }

    /// 255 where a pixel of the aligned left image has a source, 0 where it has none.
    pub fn left_valid(&self) -> ImageRef<'_, u8> {
        self.left.valid()
    }

    /// 255 where a pixel of the aligned right image has a source, 0 where it has none.
    pub fn right_valid(&self) -> ImageRef<'_, u8> {
        self.right.valid()
    }
}

fn camera_map(
    name: &'static str,
    camera: &CameraModel,
    aligned_from_camera: &Matrix3<f64>,
    geometry: &RectifiedGeometry,
) -> Result<Remap> {
    let camera_from_aligned = aligned_from_camera.transpose();
    let view = camera.view();
    let size = (geometry.width, geometry.height);
    let map = Remap::from_fn(size, (camera.width, camera.height), |x, y| {
        let ray = camera_from_aligned
            * Vector3::new(
                (x as f64 - geometry.cx_px) / geometry.focal_px,
                (y as f64 - geometry.cy_px) / geometry.focal_px,
                1.0,
            );
        view.project(&ray).map(Into::into)
    })?;
    if map.valid().rows().flatten().all(|&valid| valid == 0) {
        let reason = format!("no pixel of the aligned view has a source in the {name}'s image");
        return Err(Error::degenerate("rectification", reason));
    }
    Ok(map)
}
