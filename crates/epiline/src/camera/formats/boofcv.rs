//! BoofCV's `stereo.yaml`: two cameras and `rightToLeft`, whose unit of length is that of the target.

use nalgebra::Vector3;

use super::document::Entry;
use super::{Pair, ReadOptions};
use crate::camera::{Brown, CameraModel, Lens, Pose};
use crate::error::Result;

/// Whether a parsed document is such a file.
pub(super) fn recognises(root: &Entry<'_>) -> bool {
    root.optional("rightToLeft").is_ok_and(|entry| entry.is_some())
}

/// The rig of the file.
pub(super) fn read(root: &Entry<'_>, options: &ReadOptions) -> Result<Pair> {
    let transform = root.get("rightToLeft")?;
    let rotation = transform.get("rotation")?;
    let rotation = rotation.rotation(&rotation.all_numbers(9)?)?;
    let number = |key| transform.get(key)?.number();
    let left_from_right = Pose {
        rotation,
        translation_m: Vector3::new(number("x")?, number("y")?, number("z")?) * options.unit_m,
    };
    Ok(Pair {
        left: camera(&root.get("left")?)?,
        right: camera(&root.get("right")?)?,
        right_from_left: left_from_right.inverse(),
    })
}

fn camera(entry: &Entry<'_>) -> Result<CameraModel> {
    let model = entry.get("model")?;
    if model.text()? != "pinhole_radial_tangential" {
        return Err(
            model.error(format!("is '{}'; only 'pinhole_radial_tangential' can be read", model.text()?))
        );
    }
    let pinhole = entry.get("pinhole")?;
    let number = |key| pinhole.get(key)?.number();
    let matrix =
        [number("fx")?, number("skew")?, number("cx")?, 0.0, number("fy")?, number("cy")?, 0.0, 0.0, 1.0];
    let (focal_px, center_px) = pinhole.pinhole(&matrix)?;
    let distortion = entry.get("radial_tangential")?;
    let radial = distortion.get("radial")?;
    let count = radial.list()?.len();
    if count > 3 {
        return Err(radial.error(format!("has {count} coefficients; expected at most 3")));
    }
    let mut k = radial.all_numbers(count)?;
    k.resize(3, 0.0);
    let lens = Lens::Brown(Brown {
        k1: k[0],
        k2: k[1],
        k3: k[2],
        p1: distortion.get("t1")?.number()?,
        p2: distortion.get("t2")?.number()?,
    });
    Ok(CameraModel {
        focal_px,
        center_px,
        lens,
        width: pinhole.get("width")?.side_px()?,
        height: pinhole.get("height")?.side_px()?,
    })
}
