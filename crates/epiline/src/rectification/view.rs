//! Which part of the aligned frame both aligned images show.

use nalgebra::{Matrix3, Vector2};

use crate::camera::{AlignedFrame, CameraModel};
use crate::error::{Error, Result};

/// What a camera sees along its middle row and its middle column, in normalised coordinates of the aligned frame.
struct Footprint {
    x: [f64; 2],
    y: [f64; 2],
}

/// Principal point (x, y), in pixels, that centres aligned images of the given size on what both cameras see at
/// infinity, measured along each image's middle row and middle column.
///
/// The images' corners take no part: under lens distortion or a wide angle they run off far to the side, and to
/// include them the view would have to shrink or shift away from what the images resolve.
pub(super) fn shared_principal_point(
    frame: &AlignedFrame,
    cameras: [&CameraModel; 2],
    [width, height]: [usize; 2],
    focal_px: f64,
) -> Result<[f64; 2]> {
    let left = footprint("left camera", cameras[0], &frame.aligned_from_left)?;
    let right = footprint("right camera", cameras[1], &frame.aligned_from_right)?;
    let cx = center_of_overlap("sideways", left.x, right.x)?;
    let cy = center_of_overlap("up and down", left.y, right.y)?;
    Ok([(width as f64 - 1.0) / 2.0 - focal_px * cx, (height as f64 - 1.0) / 2.0 - focal_px * cy])
}

fn center_of_overlap(direction: &'static str, a: [f64; 2], b: [f64; 2]) -> Result<f64> {
    let (low, high) = (a[0].max(b[0]), a[1].min(b[1]));
    if low < high {
        return Ok(0.5 * (low + high));
    }
    let degrees = |v: f64| v.atan().to_degrees();
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

fn footprint(
    name: &'static str,
    camera: &CameraModel,
    aligned_from_camera: &Matrix3<f64>,
) -> Result<Footprint> {
    let center = Vector2::new((camera.width as f64 - 1.0) / 2.0, (camera.height as f64 - 1.0) / 2.0);
    let half_width = Vector2::new(camera.width as f64 / 2.0, 0.0);
    let half_height = Vector2::new(0.0, camera.height as f64 / 2.0);
    let reach = |half: Vector2<f64>| farthest_direction(name, camera, aligned_from_camera, center, half);
    Ok(Footprint {
        x: [reach(-half_width)?.x, reach(half_width)?.x],
        y: [reach(-half_height)?.y, reach(half_height)?.y],
    })
}

/// The aligned direction of the pixel `center + half`, or of the farthest one on the way there that has a direction
/// in front of the aligned view: a strong distortion polynomial may fold before the image's edge.
fn farthest_direction(
    name: &'static str,
    camera: &CameraModel,
    aligned_from_camera: &Matrix3<f64>,
    center: Vector2<f64>,
    half: Vector2<f64>,
) -> Result<Vector2<f64>> {
    const STEPS: u32 = 32;
    (0..=STEPS)
        .rev()
        .find_map(|step| {
            let pixel = center + half * (f64::from(step) / f64::from(STEPS));
            let ray = aligned_from_camera * camera.normalised_from_pixel(pixel)?.push(1.0);
            (ray.z > 0.0).then(|| ray.xy() / ray.z)
        })
        .ok_or_else(|| {
            Error::degenerate(
                "rectification",
                format!("the {name}'s lens model has no direction for its image centre"),
            )
        })
}
