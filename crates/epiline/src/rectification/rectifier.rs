//! A calibrated rig's maps, computed once.

use super::geometry::RectifiedGeometry;
use super::projection::Projection;
use super::remap::Remap;
use super::view::{Turned, flat_of, focal_for_alpha, principal_point, shared_center};
use crate::camera::{AlignedFrame, StereoCalibration};
use crate::error::{Error, Result};
use crate::image::{Image, ImageRef, check_sides};

/// How large the scene is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Scale {
    /// As the cameras see it: the middle of the picture keeps its scale.
    #[default]
    Natural,
    /// A focal length, pixels; on a cylinder pixels per radian.
    Focal(f64),
    /// A horizontal field of view, radians, less than π on a plane.
    FieldOfView(f64),
    /// From 0, only valid pixels, to 1, all pixels of both cameras' pictures; focal lengths between in proportion.
    Alpha(f64),
}

/// What the aligned images should look like. The default suits matching.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RectifierOptions {
    /// Width and height of both aligned images, pixels. Default: those of the left camera, exchanged if it is rolled
    /// by more than 45 degrees against the baseline. Another size shows more or less of the scene at the natural
    /// scale.
    pub size: Option<(usize, usize)>,
    /// How large the scene is drawn.
    pub scale: Scale,
    /// What it is drawn on.
    pub projection: Projection,
}

/// Aligns the images of a calibrated rig, so that a point of the scene lies on one row in both.
///
/// - **Rotation**: each camera turns by half of the rotation between them, then both turn together until the
///   baseline is horizontal ([`AlignedFrame`]).
/// - **Focal length** and **principal row**: one for both. Unless the view is chosen, the focal length is
///   that of the cameras: nothing is zoomed to squeeze in the far corners of a distorted image, nor to hide the border.
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
    /// output side beyond [`MAX_SIDE_PX`](crate::image::MAX_SIDE_PX) or a scale beyond its range; [`Error::Degenerate`] where no rotation aligns the views ([`AlignedFrame::of`]) or the cameras see
    /// nothing in common.
    pub fn with_options(calibration: &StereoCalibration, options: RectifierOptions) -> Result<Self> {
        calibration.validate()?;
        let StereoCalibration { left, right, right_from_left, .. } = calibration;
        check_sides("left camera", left.width, left.height)?;
        check_sides("right camera", right.width, right.height)?;
        let frame = AlignedFrame::of(right_from_left)?;
        let rolled = frame.aligned_from_left[(0, 1)].abs() > frame.aligned_from_left[(0, 0)].abs();
        let natural = if rolled { (left.height, left.width) } else { (left.width, left.height) };
        let (width, height) = options.size.unwrap_or(natural);
        check_sides("rectified image", width, height)?;

        let cameras = Turned::pair(&frame, [left, right], options.projection);
        let center = shared_center(&cameras)?;
        let focal_px = match options.scale {
            Scale::Natural if rolled => 0.5 * (left.focal_px[0] + right.focal_px[0]),
            Scale::Natural => AlignedFrame::common_focal_px(left, right),
            Scale::Focal(focal_px) => focal_px,
            Scale::FieldOfView(fov_rad) => {
                let largest = match options.projection {
                    Projection::Pinhole => 179.0,
                    Projection::Cylindrical => 180.0,
                };
                let degrees = fov_rad.to_degrees();
                if !(0.1..=largest).contains(&degrees) {
                    let expected = format!("must lie between 0.1 and {largest} degrees on this projection");
                    return Err(Error::invalid("fov_deg", format!("{degrees} degrees"), expected));
                }
                0.5 * width as f64 / options.projection.half_width(fov_rad)
            }
            Scale::Alpha(alpha) if (0.0..=1.0).contains(&alpha) => {
                focal_for_alpha(&cameras, center, [width, height], alpha)?
            }
            Scale::Alpha(alpha) => {
                return Err(Error::invalid("alpha", alpha, "must lie between 0 and 1"));
            }
        };
        let [cx_px, cy_px] = principal_point([width, height], focal_px, center);
        let mut geometry =
            RectifiedGeometry::new(width, height, focal_px, cx_px, cy_px, 0.0, frame.baseline_m)?;
        geometry.projection = options.projection;
        geometry.aligned_from_left = frame.aligned_from_left;
        geometry.calibration_variance = calibration.depth_variance();

        let [left, right] = cameras.map(|camera| camera_map(&camera, &geometry));
        Ok(Self { geometry, left: left?, right: right? })
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

fn camera_map(camera: &Turned<'_>, geometry: &RectifiedGeometry) -> Result<Remap> {
    let size = (geometry.width, geometry.height);
    let map = Remap::from_fn(size, (camera.camera.width, camera.camera.height), |x, y| {
        camera.source(flat_of(geometry, x, y)).map(Into::into)
    })?;
    if map.valid().rows().flatten().all(|&valid| valid == 0) {
        let reason = format!("no pixel of the aligned view has a source in the {}'s image", camera.name);
        return Err(Error::degenerate("rectification", reason));
    }
    Ok(map)
}
