//! mrcal's `.cameramodel` files, one per camera: a Python dictionary that is YAML too, poses from a reference frame.

use std::path::{Path, PathBuf};

use nalgebra::{Rotation3, Vector3};

use super::document::{Entry, Node};
use super::{Pair, file_error, yaml};
use crate::camera::{CameraModel, Lens, Pose, StereoCalibration};
use crate::error::Result;

/// The document of a `.cameramodel`.
pub(super) fn parse(path: &Path, text: &str) -> Result<Node> {
    yaml::parse(path, &without_optimization_inputs(text))
}

/// The packed inputs of mrcal's solver are a bytes literal of base 85, whose punctuation is none of YAML's; its
/// alphabet has no quote.
fn without_optimization_inputs(text: &str) -> String {
    const KEY: &str = "'optimization_inputs'";
    let cut = || {
        let start = text.find(KEY)?;
        let open = start + text[start..].find("b'")? + 2;
        let close = open + text[open..].find('\'')?;
        Some([&text[..start], "'optimization_inputs': ''", &text[close + 1..]].concat())
    };
    cut().unwrap_or_else(|| text.to_owned())
}

/// Whether a parsed document is a camera model of mrcal's.
pub(super) fn recognises(root: &Entry<'_>) -> bool {
    root.first_of(&["lensmodel", "lens_model"]).is_ok_and(|entry| entry.is_some())
}

/// The rig of the two files.
pub(super) fn read(left: &Entry<'_>, right: &Entry<'_>) -> Result<Pair> {
    let (left, left_from_reference) = camera(left)?;
    let (right, right_from_reference) = camera(right)?;
    Ok(Pair { left, right, right_from_left: right_from_reference.after(&left_from_reference.inverse()) })
}

/// The camera and `camera_from_reference`.
fn camera(root: &Entry<'_>) -> Result<(CameraModel, Pose)> {
    let required = |names: &[&str]| root.first_of(names)?.ok_or_else(|| root.about(names[0], "is missing"));
    let model = required(&["lensmodel", "lens_model"])?;
    let known = match model.text()? {
        "LENSMODEL_PINHOLE" => None,
        "LENSMODEL_OPENCV4" => Some(4),
        "LENSMODEL_OPENCV5" => Some(5),
        "LENSMODEL_OPENCV8" => Some(8),
        "LENSMODEL_OPENCV12" => Some(12),
        other => {
            let known = "LENSMODEL_PINHOLE, LENSMODEL_OPENCV4, _OPENCV5, _OPENCV8, _OPENCV12";
            return Err(model.error(format!(
                "is '{other}', which no lens here equals; fit one of {known} with mrcal-convert-lensmodel"
            )));
        }
    };
    let intrinsics = root.get("intrinsics")?;
    let numbers = intrinsics.all_numbers(4 + known.unwrap_or(0))?;
    let [fx, fy, cx, cy] = numbers[..4].try_into().expect("at least four");
    let (focal_px, center_px) = intrinsics.pinhole(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])?;
    let lens = match known {
        None => Lens::default(),
        Some(_) => Lens::from_opencv(&numbers[4..]).map_err(|e| intrinsics.error(e.to_string()))?,
    };
    let [width, height] = root.get("imagersize")?.size_px()?;
    // Called `extrinsics` before mrcal 2.5.
    let [rx, ry, rz, tx, ty, tz] = required(&["rt_cam_ref", "extrinsics"])?.numbers()?;
    let camera_from_reference = Pose {
        rotation: Rotation3::from_scaled_axis(Vector3::new(rx, ry, rz)).into_inner(),
        translation_m: Vector3::new(tx, ty, tz),
    };
    Ok((CameraModel { focal_px, center_px, lens, width, height }, camera_from_reference))
}

/// The texts of the left and the right file, with the left camera as the reference.
pub(super) fn texts_of(paths: &[PathBuf], rig: &StereoCalibration) -> Result<Vec<String>> {
    let poses = [Pose::identity(), rig.right_from_left];
    let sides = paths.iter().zip([&rig.left, &rig.right]).zip(poses);
    sides.map(|((path, camera), pose)| camera_text(path, camera, &pose)).collect()
}

fn camera_text(path: &Path, camera: &CameraModel, camera_from_left: &Pose) -> Result<String> {
    let model = match camera.lens {
        Lens::Brown(_) => "LENSMODEL_OPENCV5",
        Lens::Rational(_) => "LENSMODEL_OPENCV8",
        Lens::ThinPrism(_) => "LENSMODEL_OPENCV12",
        lens @ (Lens::KannalaBrandt(_) | Lens::Tsai(_)) => {
            let reason = format!("cannot be '{}': mrcal has no such lens", lens.name());
            return Err(file_error(path, "lensmodel", reason));
        }
    };
    let intrinsics = [camera.focal_px.as_slice(), &camera.center_px, &camera.lens.coefficients()].concat();
    let Pose { rotation, translation_m: t } = camera_from_left;
    let r = Rotation3::from_matrix_unchecked(*rotation).scaled_axis();
    let rt = [r.x, r.y, r.z, t.x, t.y, t.z];
    // `extrinsics` is read by every version of mrcal.
    Ok(format!(
        "{{\n    'lensmodel': '{model}',\n    'intrinsics': {intrinsics:?},\n    'extrinsics': {rt:?},\n    \
         'imagersize': [{}, {}]\n}}\n",
        camera.width, camera.height
    ))
}
