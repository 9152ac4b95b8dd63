//! Which part of the aligned frame both aligned images show.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::geometry::RectifiedGeometry;
use super::projection::Projection;
use crate::camera::{AlignedFrame, CameraModel, CameraView};
use crate::error::{Error, Result};

/// A camera as the aligned frame sees it.
pub(super) struct Turned<'a> {
    pub name: &'static str,
    pub camera: &'a CameraModel,
    pub view: CameraView,
    pub aligned_from_camera: Matrix3<f64>,
    pub projection: Projection,
}

impl<'a> Turned<'a> {
    /// Left and right.
    pub fn pair(frame: &AlignedFrame, cameras: [&'a CameraModel; 2], projection: Projection) -> [Self; 2] {
        let turned = |name, camera: &'a CameraModel, aligned_from_camera| Self {
            name,
            camera,
            view: camera.view(),
            aligned_from_camera,
            projection,
        };
        [
            turned("left camera", cameras[0], frame.aligned_from_left),
            turned("right camera", cameras[1], frame.aligned_from_right),
        ]
    }

    /// The pixel that shows a position of the aligned surface; `None` if none does, inside the picture or not.
    pub fn source(&self, flat: Vector2<f64>) -> Option<Vector2<f64>> {
        self.view.project(&self.aligned_from_camera.tr_mul(&self.projection.ray(flat)?))
    }

    /// Where a pixel lies on the aligned surface.
    fn flat(&self, pixel: Vector2<f64>) -> Option<Vector2<f64>> {
        let ray: Vector3<f64> = self.aligned_from_camera * self.view.direction(pixel)?;
        self.projection.flat(&ray)
    }

    fn last(&self) -> Vector2<f64> {
        Vector2::new(self.camera.width as f64 - 1.0, self.camera.height as f64 - 1.0)
    }

    /// What the camera sees from the middle of one edge of its picture to the middle of the opposite one.
    fn footprint(&self) -> Result<Footprint> {
        let center = self.last() / 2.0;
        let half = Vector2::new(self.camera.width as f64 / 2.0, self.camera.height as f64 / 2.0);
        let (across, along) = (Vector2::new(half.x, 0.0), Vector2::new(0.0, half.y));
        let mut edges = [Vector2::zeros(); 4];
        for (edge, half) in edges.iter_mut().zip([-across, across, -along, along]) {
            *edge = self.farthest(center, half)?;
        }
        // All four, because a rolled camera's rows may run along the aligned columns.
        let span = |axis: usize| {
            edges.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], edge| {
                [low.min(edge[axis]), high.max(edge[axis])]
            })
        };
        Ok(Footprint { x: span(0), y: span(1) })
    }

    /// Where the pixel `center + half` lies, or the farthest one on the way there that lies anywhere: a strong
    /// distortion polynomial may fold before the image's edge.
    fn farthest(&self, center: Vector2<f64>, half: Vector2<f64>) -> Result<Vector2<f64>> {
        const STEPS: u32 = 32;
        let step = |step: u32| self.flat(center + half * (f64::from(step) / f64::from(STEPS)));
        (0..=STEPS).rev().find_map(step).ok_or_else(|| {
            let reason = format!("the {}'s lens model has no direction for its image centre", self.name);
            Error::degenerate("rectification", reason)
        })
    }

    /// Whether a position of the aligned surface shows a pixel of the picture.
    fn shows(&self, flat: Vector2<f64>) -> bool {
        let last = self.last();
        self.source(flat).is_some_and(|p| (0.0..=last.x).contains(&p.x) && (0.0..=last.y).contains(&p.y))
    }
}

/// What a camera sees along its middle row and its middle column, on the aligned surface.
struct Footprint {
    x: [f64; 2],
    y: [f64; 2],
}

/// The middle of what both cameras see at infinity, measured along each image's middle row and middle column.
///
/// The images' corners take no part: under lens distortion or a wide angle they run off far to the side, and to
/// include them the view would have to shrink or shift away from what the images resolve.
pub(super) fn shared_center(cameras: &[Turned<'_>; 2]) -> Result<Vector2<f64>> {
    let (left, right) = (cameras[0].footprint()?, cameras[1].footprint()?);
    let projection = cameras[0].projection;
    Ok(Vector2::new(
        center_of_overlap("sideways", projection, left.x, right.x)?,
        center_of_overlap("up and down", projection, left.y, right.y)?,
    ))
}

fn center_of_overlap(
    direction: &'static str,
    projection: Projection,
    a: [f64; 2],
    b: [f64; 2],
) -> Result<f64> {
    let (low, high) = (a[0].max(b[0]), a[1].min(b[1]));
    if low < high {
        return Ok(0.5 * (low + high));
    }
    let degrees = |v: f64| match projection {
        Projection::Pinhole => v.atan().to_degrees(),
        Projection::Cylindrical => v.to_degrees(),
    };
    Err(Error::degenerate(
        "rectification",
        format!(
            "the cameras look past each other {direction}: left sees {:.1} to {:.1} degrees, right {:.1} to {:.1}",
            degrees(a[0]),
            degrees(a[1]),
            degrees(b[0]),
            degrees(b[1])
        ),
    ))
}

/// The pixels all along the edges of a picture.
fn border([width, height]: [usize; 2]) -> impl Iterator<Item = Vector2<f64>> {
    let last = Vector2::new(width as f64 - 1.0, height as f64 - 1.0);
    let rows = (0..width).flat_map(move |x| [Vector2::new(x as f64, 0.0), Vector2::new(x as f64, last.y)]);
    let columns =
        (0..height).flat_map(move |y| [Vector2::new(0.0, y as f64), Vector2::new(last.x, y as f64)]);
    rows.chain(columns)
}

/// The focal length, pixels, between those at which the view shows only valid pixels (`alpha` 0) and all pixels of
/// both pictures (`alpha` 1), about a centre.
pub(super) fn focal_for_alpha(
    cameras: &[Turned<'_>; 2],
    center: Vector2<f64>,
    size: [usize; 2],
    alpha: f64,
) -> Result<f64> {
    let half = Vector2::new(size[0] as f64 - 1.0, size[1] as f64 - 1.0) / 2.0;
    let only_valid = |focal: f64| {
        border(size).all(|p| cameras.iter().all(|camera| camera.shows((p - half) / focal + center)))
    };
    // A view ever narrower has a source everywhere, unless the middle itself has none.
    let (mut wide, mut narrow) = (1.0, 1e6);
    if !only_valid(narrow) {
        let reason = "the middle of the common view has no source in one of the cameras";
        return Err(Error::degenerate("rectification", reason));
    }
    for _ in 0..60 {
        let middle = f64::sqrt(wide * narrow);
        if only_valid(middle) { narrow = middle } else { wide = middle }
    }
    let mut all = f64::INFINITY;
    for camera in cameras {
        for pixel in border([camera.camera.width, camera.camera.height]) {
            // What a plane cannot show at all limits nothing.
            let Some(flat) = camera.flat(pixel) else { continue };
            let offset = flat - center;
            all = all.min(half.x / offset.x.abs()).min(half.y / offset.y.abs());
        }
    }
    Ok(narrow + alpha * (all.min(narrow) - narrow))
}

/// Principal point (x, y), in pixels, that puts a position of the aligned surface in the middle of the view.
pub(super) fn principal_point([width, height]: [usize; 2], focal_px: f64, center: Vector2<f64>) -> [f64; 2] {
    [(width as f64 - 1.0) / 2.0 - focal_px * center.x, (height as f64 - 1.0) / 2.0 - focal_px * center.y]
}

/// The position on the aligned surface, in units of the focal length, of a pixel of the aligned images.
pub(super) fn flat_of(geometry: &RectifiedGeometry, x: usize, y: usize) -> Vector2<f64> {
    Vector2::new(x as f64 - geometry.cx_px, y as f64 - geometry.cy_px) / geometry.focal_px
}
