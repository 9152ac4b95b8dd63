//! What OpenCV's `FileStorage` holds of a pair of cameras: YAML, XML or JSON, one file or the sample programs' two.
//!
//! `stereo_calib.cpp` writes `intrinsics.yml` (M1 D1 M2 D2) and `extrinsics.yml` (R T …); other programs write all
//! into one file, under names that are tried in turn. The length of a unit of T is that of the board's squares.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use super::document::{Entry, Node};
use super::{Pair, ReadOptions, file_error, size_from_options, xml, yaml};
use crate::camera::{CameraModel, KannalaBrandt, Lens, LensFormula, Pose, StereoCalibration};
use crate::error::{Error, Result};

const CAMERA_MATRIX: [&[&str]; 2] = [
    &[
        "M1",
        "K1",
        "cameraMatrix1",
        "camera_matrix_1",
        "cameraMatrixL",
        "left_camera_matrix",
        "camera_matrix_left",
    ],
    &[
        "M2",
        "K2",
        "cameraMatrix2",
        "camera_matrix_2",
        "cameraMatrixR",
        "right_camera_matrix",
        "camera_matrix_right",
    ],
];
const DISTORTION: [&[&str]; 2] = [
    &["D1", "distCoeffs1", "dist_coeffs_1", "distCoeffsL", "left_distortion", "dist_coeffs_left"],
    &["D2", "distCoeffs2", "dist_coeffs_2", "distCoeffsR", "right_distortion", "dist_coeffs_right"],
];
const ROTATION: &[&str] = &["R", "rotation", "rotation_matrix"];
const TRANSLATION: &[&str] = &["T", "translation", "translation_vector"];

/// The document of a `FileStorage` file.
pub(super) fn parse(path: &Path, text: &str) -> Result<Node> {
    if text.trim_start().starts_with('<') {
        return xml::parse(path, text);
    }
    // `%YAML:1.0` is no YAML directive.
    let body = text.strip_prefix("%YAML:1.0").or_else(|| text.strip_prefix("%YAML 1.0")).unwrap_or(text);
    yaml::parse(path, body)
}

/// Whether a parsed document holds camera matrices or the pose under OpenCV's names.
pub(super) fn recognises(root: &Entry<'_>) -> bool {
    let names = [CAMERA_MATRIX[0], ROTATION];
    names.iter().any(|names| matches!(root.first_of(names), Ok(Some(found)) if found.get("data").is_ok()))
}

/// The rig in the files together.
pub(super) fn read(files: &[Entry<'_>], options: &ReadOptions) -> Result<Pair> {
    let camera = |side: usize| -> Result<CameraModel> {
        let k = matrix(files, CAMERA_MATRIX[side], 9)?;
        let (focal_px, center_px) = k.0.pinhole(&k.1)?;
        let (entry, coefficients) = any_matrix(files, DISTORTION[side])?;
        let lens = if is_fisheye(files)? {
            let four: [f64; 4] = coefficients
                .try_into()
                .map_err(|_| entry.error("must have 4 coefficients: the file says it is a fisheye's"))?;
            Lens::KannalaBrandt(KannalaBrandt::from_array(four))
        } else if coefficients.is_empty() {
            Lens::default()
        } else {
            Lens::from_opencv(&coefficients).map_err(|error| match error {
                Error::InvalidParameter { value, expected, .. } => {
                    entry.error(format!("is {value}: {expected}"))
                }
                other => other,
            })?
        };
        let [width, height] = size(files, options)?;
        Ok(CameraModel { focal_px, center_px, lens, width, height })
    };
    let rotation = matrix(files, ROTATION, 9)?;
    let translation = matrix(files, TRANSLATION, 3)?;
    Ok(Pair {
        left: camera(0)?,
        right: camera(1)?,
        right_from_left: Pose {
            rotation: rotation.0.rotation(&rotation.1)?,
            translation_m: Vector3::from_column_slice(&translation.1) * options.unit_m,
        },
    })
}

/// An entry of either file under one of its names.
fn find<'a>(files: &[Entry<'a>], names: &[&str]) -> Result<Entry<'a>> {
    for file in files {
        if let Some(found) = file.first_of(names)? {
            return Ok(found);
        }
    }
    Err(files[0].about(names[0], format!("is missing (also looked for {})", names[1..].join(", "))))
}

fn any_matrix<'a>(files: &[Entry<'a>], names: &[&str]) -> Result<(Entry<'a>, Vec<f64>)> {
    let found = find(files, names)?;
    let count = |key| found.get(key)?.count(1 << 12);
    let data = found.get("data")?;
    let count = count("rows")? * count("cols")?;
    Ok((found.clone(), data.all_numbers(count)?))
}

fn matrix<'a>(files: &[Entry<'a>], names: &[&str], count: usize) -> Result<(Entry<'a>, Vec<f64>)> {
    let (found, values) = any_matrix(files, names)?;
    if values.len() != count {
        return Err(found.error(format!("has {} numbers; expected {count}", values.len())));
    }
    Ok((found, values))
}

fn is_fisheye(files: &[Entry<'_>]) -> Result<bool> {
    for file in files {
        if let Some(flag) = file.optional("fisheye_model")? {
            return Ok(flag.count(1)? == 1);
        }
    }
    Ok(false)
}

/// The image's size from either file, else from the options.
fn size(files: &[Entry<'_>], options: &ReadOptions) -> Result<[usize; 2]> {
    for file in files {
        if let Some(width) = file.first_of(&["image_width", "imageWidth", "width"])? {
            let height = file.first_of(&["image_height", "imageHeight", "height"])?;
            let height = height.ok_or_else(|| file.about("image_height", "is missing"))?;
            return Ok([width.side_px()?, height.side_px()?]);
        }
        if let Some(size) = file.first_of(&["image_size", "imageSize", "size"])? {
            return size.size_px();
        }
    }
    size_from_options(files[0].file(), options)
}

/// How the files spell matrices.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Spelling {
    Yaml,
    Xml,
}

/// The text of one file with everything, or of one with the cameras and one with the pose.
pub(super) fn texts_of(paths: &[PathBuf], rig: &StereoCalibration) -> Result<Vec<String>> {
    let xml = paths[0].extension().is_some_and(|extension| extension.eq_ignore_ascii_case("xml"));
    let spelling = if xml { Spelling::Xml } else { Spelling::Yaml };
    let refused = |field: &str, reason: &str| Err(file_error(&paths[0], field, reason));
    let fisheyes = [&rig.left, &rig.right].map(|camera| matches!(camera.lens, Lens::KannalaBrandt(_)));
    if fisheyes[0] != fisheyes[1] {
        return refused(
            "fisheye_model",
            "would have to be one for both cameras; only one of the lenses is a fisheye",
        );
    }
    if (rig.left.width, rig.left.height) != (rig.right.width, rig.right.height) {
        return refused("image_width", "would have to be one for both cameras; their sizes differ");
    }
    let mut cameras = Storage::new(spelling);
    cameras.number("image_width", rig.left.width);
    cameras.number("image_height", rig.left.height);
    if fisheyes[0] {
        cameras.number("fisheye_model", 1);
    }
    for (i, camera) in [&rig.left, &rig.right].into_iter().enumerate() {
        let ([fx, fy], [cx, cy]) = (camera.focal_px, camera.center_px);
        if matches!(camera.lens, Lens::Tsai(_)) {
            return refused("D1", "cannot hold a lens of Tsai's model");
        }
        let number = i + 1;
        cameras.matrix(&format!("M{number}"), 3, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
        cameras.matrix(&format!("D{number}"), 1, &camera.lens.coefficients());
    }
    let Pose { rotation, translation_m } = &rig.right_from_left;
    let two_files = paths.len() == 2;
    let mut pose = if two_files {
        Storage::new(spelling)
    } else {
        std::mem::replace(&mut cameras, Storage::new(spelling))
    };
    pose.matrix("R", 3, rotation.transpose().as_slice());
    pose.matrix("T", 3, translation_m.as_slice());
    let pose = pose.finish();
    Ok(if two_files { vec![cameras.finish(), pose] } else { vec![pose] })
}

/// A `FileStorage` file being written.
struct Storage {
    spelling: Spelling,
    text: String,
}

impl Storage {
    fn new(spelling: Spelling) -> Self {
        let head = match spelling {
            Spelling::Yaml => "%YAML:1.0\n---\n",
            Spelling::Xml => "<?xml version=\"1.0\"?>\n<opencv_storage>\n",
        };
        Self { spelling, text: head.to_owned() }
    }

    fn number(&mut self, name: &str, value: usize) {
        match self.spelling {
            Spelling::Yaml => writeln!(self.text, "{name}: {value}"),
            Spelling::Xml => writeln!(self.text, "<{name}>{value}</{name}>"),
        }
        .expect("a string takes everything");
    }

    fn matrix(&mut self, name: &str, rows: usize, values: &[f64]) {
        let cols = values.len() / rows;
        // The shortest digits that read back as the same number.
        let numbers: Vec<String> = values.iter().map(|v| format!("{v:?}")).collect();
        match self.spelling {
            Spelling::Yaml => writeln!(
                self.text,
                "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {cols}\n   dt: d\n   data: [ {} ]",
                numbers.join(", ")
            ),
            Spelling::Xml => writeln!(
                self.text,
                "<{name} type_id=\"opencv-matrix\">\n  <rows>{rows}</rows>\n  <cols>{cols}</cols>\n  <dt>d</dt>\n  \
                 <data>\n    {}</data></{name}>",
                numbers.join(" ")
            ),
        }
        .expect("a string takes everything");
    }

    fn finish(mut self) -> String {
        if self.spelling == Spelling::Xml {
            self.text.push_str("</opencv_storage>\n");
        }
        self.text
    }
}
