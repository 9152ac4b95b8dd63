//! Kalibr's `camchain.yaml`: `cam0` is the left camera, `cam1` the right one with `T_cn_cnm1 = right_from_left`, metres.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::document::Entry;
use super::{Pair, file_error};
use crate::camera::{Brown, CameraModel, KannalaBrandt, Lens, LensFormula, Pose, StereoCalibration};
use crate::error::Result;

/// Whether a parsed document is a camera chain.
pub(super) fn recognises(root: &Entry<'_>) -> bool {
    root.optional("cam0").is_ok_and(|entry| entry.is_some())
}

/// The rig of the first two cameras.
pub(super) fn read(root: &Entry<'_>) -> Result<Pair> {
    let (left, right) = (root.get("cam0")?, root.get("cam1")?);
    let transform = right.get("T_cn_cnm1")?;
    let m = transform.square(4)?;
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err(transform.error("must end with the row 0 0 0 1"));
    }
    let rotation = [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]];
    let right_from_left =
        Pose { rotation: transform.rotation(&rotation)?, translation_m: Vector3::new(m[3], m[7], m[11]) };
    Ok(Pair { left: camera(&left)?, right: camera(&right)?, right_from_left })
}

fn camera(entry: &Entry<'_>) -> Result<CameraModel> {
    let model = entry.get("camera_model")?;
    if model.text()? != "pinhole" {
        return Err(model.error(format!("is '{}'; only 'pinhole' can be read", model.text()?)));
    }
    let intrinsics = entry.get("intrinsics")?;
    let [fx, fy, cx, cy] = intrinsics.numbers()?;
    let (focal_px, center_px) = intrinsics.pinhole(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])?;
    let distortion = entry.get("distortion_model")?;
    let coefficients = || entry.get("distortion_coeffs")?.numbers::<4>();
    let lens = match distortion.text()? {
        "radtan" => {
            let [k1, k2, p1, p2] = coefficients()?;
            Lens::Brown(Brown { k1, k2, p1, p2, k3: 0.0 })
        }
        "equidistant" => Lens::KannalaBrandt(KannalaBrandt::from_array(coefficients()?)),
        "none" => Lens::default(),
        other => {
            let known = "radtan, equidistant, none";
            return Err(distortion.error(format!("is '{other}'; expected one of {known}")));
        }
    };
    let [width, height] = entry.get("resolution")?.size_px()?;
    Ok(CameraModel { focal_px, center_px, lens, width, height })
}

/// The text of the chain.
pub(super) fn text_of(path: &Path, rig: &StereoCalibration) -> Result<String> {
    let transform = transform_text(&rig.right_from_left.rotation, &rig.right_from_left.translation_m);
    Ok(camera_text(path, 0, &rig.left, "")? + &camera_text(path, 1, &rig.right, &transform)?)
}

fn camera_text(path: &Path, number: usize, camera: &CameraModel, transform: &str) -> Result<String> {
    let refused = |reason: String| Err(file_error(path, format!("cam{number}.distortion_model"), reason));
    let (model, coefficients) = match camera.lens {
        Lens::Brown(Brown { k3, .. }) if k3 != 0.0 => {
            return refused(format!("'radtan' has no k3, and the lens has k3 = {k3}"));
        }
        Lens::Brown(Brown { k1, k2, p1, p2, .. }) => ("radtan", [k1, k2, p1, p2]),
        Lens::KannalaBrandt(lens) => ("equidistant", lens.to_array()),
        lens => return refused(format!("cannot be '{}': camchain.yaml has no such lens", lens.name())),
    };
    let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.center_px);
    Ok(format!(
        "cam{number}:\n{transform}  camera_model: pinhole\n  distortion_coeffs: {coefficients:?}\n  \
         distortion_model: {model}\n  intrinsics: {:?}\n  resolution: [{}, {}]\n  rostopic: /cam{number}/image_raw\n",
        [fx, fy, cx, cy],
        camera.width,
        camera.height
    ))
}

fn transform_text(rotation: &Matrix3<f64>, translation_m: &Vector3<f64>) -> String {
    let row = |i: usize| {
        let numbers = [rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)], translation_m[i]];
        format!("  - {numbers:?}\n")
    };
    format!("  T_cn_cnm1:\n{}{}{}  - [0.0, 0.0, 0.0, 1.0]\n", row(0), row(1), row(2))
}
