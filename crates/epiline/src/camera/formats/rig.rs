//! Our own rig file: YAML, versioned, every number with its unit in its name, exact in the round trip.

use std::path::Path;

use nalgebra::{DMatrix, Vector3};
use serde::{Serialize, Serializer};
use serde_saphyr::FlowSeq;

use super::document::Entry;
use super::io_error;
use crate::camera::{BoardWarp, CameraModel, Lens, Outlier, Pose, StereoCalibration, ViewResidual};
use crate::error::Result;

const FORMAT: &str = "epiline stereo rig";
const VERSION: usize = 1;

/// YAML's end of a document: without it, a file cut off within its last number would pass for a whole one.
const END: &str = "...";

type Row = FlowSeq<Vec<f64>>;

#[derive(Serialize)]
struct RigFile {
    format: &'static str,
    version: usize,
    left: CameraEntry,
    right: CameraEntry,
    right_from_left: PoseEntry,
    #[serde(skip_serializing_if = "Option::is_none")]
    rms_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    epipolar_error_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    covariance: Option<CovarianceEntry>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    views: Vec<ViewEntry>,
    #[serde(skip_serializing_if = "Option::is_none")]
    board_warp: Option<WarpEntry>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    outliers: Vec<OutlierEntry>,
}

#[derive(Serialize)]
struct CameraEntry {
    width_px: usize,
    height_px: usize,
    lens: &'static str,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    #[serde(flatten)]
    coefficients: Coefficients,
}

#[derive(Serialize)]
struct PoseEntry {
    rotation: Vec<Row>,
    translation_m: Row,
}

#[derive(Serialize)]
struct CovarianceEntry {
    parameters: FlowSeq<Vec<String>>,
    matrix: Vec<Row>,
}

#[derive(Serialize)]
struct ViewEntry {
    #[serde(skip_serializing_if = "Option::is_none")]
    left_rms_px: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    right_rms_px: Option<f64>,
    left_from_board: PoseEntry,
}

#[derive(Serialize)]
struct WarpEntry {
    height_m: Row,
    sigma_m: Row,
}

#[derive(Serialize)]
struct OutlierEntry {
    view: usize,
    side: &'static str,
    corner: usize,
    residual_px: f64,
    sigma_px: f64,
}

/// A lens's coefficients by name, in their order.
struct Coefficients(Lens);

impl Serialize for Coefficients {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.coefficient_names().iter().zip(self.0.coefficients()))
    }
}

impl From<&CameraModel> for CameraEntry {
    fn from(camera: &CameraModel) -> Self {
        let CameraModel { focal_px: [fx_px, fy_px], center_px: [cx_px, cy_px], lens, width, height } =
            *camera;
        Self {
            width_px: width,
            height_px: height,
            lens: lens.name(),
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            coefficients: Coefficients(lens),
        }
    }
}

impl From<&Pose> for PoseEntry {
    fn from(pose: &Pose) -> Self {
        Self {
            rotation: pose.rotation.row_iter().map(|row| FlowSeq(row.iter().copied().collect())).collect(),
            translation_m: FlowSeq(pose.translation_m.iter().copied().collect()),
        }
    }
}

impl From<&StereoCalibration> for RigFile {
    fn from(rig: &StereoCalibration) -> Self {
        let known = |value: f64| (!value.is_nan()).then_some(value);
        Self {
            format: FORMAT,
            version: VERSION,
            left: (&rig.left).into(),
            right: (&rig.right).into(),
            right_from_left: (&rig.right_from_left).into(),
            rms_px: known(rig.rms_px),
            epipolar_error_px: known(rig.epipolar_error_px),
            covariance: rig.covariance.as_ref().map(|covariance| CovarianceEntry {
                parameters: FlowSeq(rig.parameter_names()),
                matrix: covariance.row_iter().map(|row| FlowSeq(row.iter().copied().collect())).collect(),
            }),
            views: rig
                .views
                .iter()
                .map(|view| ViewEntry {
                    left_rms_px: known(view.left_rms_px),
                    right_rms_px: known(view.right_rms_px),
                    left_from_board: (&view.left_from_board).into(),
                })
                .collect(),
            board_warp: rig.board_warp.map(|BoardWarp { height_m, sigma_m }| WarpEntry {
                height_m: FlowSeq(height_m.to_vec()),
                sigma_m: FlowSeq(sigma_m.to_vec()),
            }),
            outliers: rig
                .outliers
                .iter()
                .map(|&Outlier { view, side, corner, residual_px, sigma_px }| OutlierEntry {
                    view,
                    side,
                    corner,
                    residual_px,
                    sigma_px,
                })
                .collect(),
        }
    }
}

/// The whole text of a rig file.
pub(super) fn text_of(path: &Path, rig: &StereoCalibration) -> Result<String> {
    let text = serde_saphyr::to_string(&RigFile::from(rig)).map_err(|e| io_error(path, e))?;
    Ok(format!("{text}{END}\n"))
}

/// Whether a parsed document says what format it is of.
pub(super) fn recognises(root: &Entry<'_>) -> bool {
    root.optional("format").is_ok_and(|format| format.is_some())
}

/// The rig of a parsed file.
pub(super) fn read(root: &Entry<'_>, text: &str) -> Result<StereoCalibration> {
    if text.trim_end().lines().last() != Some(END) {
        return Err(root.error(format!("is cut off: a rig file ends with a line '{END}'")));
    }
    let format = root.get("format")?;
    if format.text()? != FORMAT {
        return Err(format.error(format!("is '{}'; expected '{FORMAT}'", format.text()?)));
    }
    let version = root.get("version")?;
    if version.count(usize::MAX >> 12)? != VERSION {
        return Err(version.error(format!("must be {VERSION}; a newer epiline may have written this file")));
    }
    let mut rig = StereoCalibration {
        left: camera(&root.get("left")?)?,
        right: camera(&root.get("right")?)?,
        right_from_left: pose(&root.get("right_from_left")?)?,
        rms_px: optional_number(root, "rms_px")?,
        epipolar_error_px: optional_number(root, "epipolar_error_px")?,
        covariance: None,
        views: match root.optional("views")? {
            Some(list) => list.list()?.map(|entry| view(&entry)).collect::<Result<_>>()?,
            None => Vec::new(),
        },
        outliers: match root.optional("outliers")? {
            Some(list) => list.list()?.map(|entry| outlier(&entry)).collect::<Result<_>>()?,
            None => Vec::new(),
        },
        board_warp: root.optional("board_warp")?.map(|entry| board_warp(&entry)).transpose()?,
    };
    if let Some(entry) = root.optional("covariance")? {
        rig.covariance = Some(covariance(&entry, &rig.parameter_names())?);
    }
    Ok(rig)
}

fn optional_number(parent: &Entry<'_>, key: &str) -> Result<f64> {
    parent.optional(key)?.map_or(Ok(f64::NAN), |entry| entry.number())
}

fn camera(entry: &Entry<'_>) -> Result<CameraModel> {
    let number = |key| entry.get(key)?.number();
    let name = entry.get("lens")?;
    let model = Lens::of_name(name.text()?).ok_or_else(|| {
        name.error(format!(
            "is '{}'; expected one of {}",
            name.text().unwrap_or_default(),
            Lens::NAMES.join(", ")
        ))
    })?;
    let coefficients = model
        .coefficient_names()
        .iter()
        .map(|coefficient| number(coefficient))
        .collect::<Result<Vec<_>>>()?;
    Ok(CameraModel {
        focal_px: [entry.get("fx_px")?.positive()?, entry.get("fy_px")?.positive()?],
        center_px: [number("cx_px")?, number("cy_px")?],
        lens: model.with_coefficients(&coefficients).expect("one number for each name"),
        width: entry.get("width_px")?.side_px()?,
        height: entry.get("height_px")?.side_px()?,
    })
}

fn pose(entry: &Entry<'_>) -> Result<Pose> {
    let rotation = entry.get("rotation")?;
    let matrix = rotation.rotation(&rotation.square(3)?)?;
    let translation_m = Vector3::from(entry.get("translation_m")?.numbers::<3>()?);
    Ok(Pose { rotation: matrix, translation_m })
}

fn covariance(entry: &Entry<'_>, expected: &[String]) -> Result<DMatrix<f64>> {
    let parameters = entry.get("parameters")?;
    let names = parameters.list()?.map(|name| name.text()).collect::<Result<Vec<_>>>()?;
    if names != expected {
        return Err(parameters.error("does not list the parameters of these two lenses in their order"));
    }
    let matrix = entry.get("matrix")?;
    let values = matrix.square(expected.len())?;
    let covariance = DMatrix::from_row_slice(expected.len(), expected.len(), &values);
    if let Some(i) = (0..expected.len()).find(|&i| covariance[(i, i)] < 0.0) {
        let value = covariance[(i, i)];
        return Err(matrix.error(format!("has a negative variance, {value}, of {}", expected[i])));
    }
    Ok(covariance)
}

fn view(entry: &Entry<'_>) -> Result<ViewResidual> {
    Ok(ViewResidual {
        left_rms_px: optional_number(entry, "left_rms_px")?,
        right_rms_px: optional_number(entry, "right_rms_px")?,
        left_from_board: pose(&entry.get("left_from_board")?)?,
    })
}

fn outlier(entry: &Entry<'_>) -> Result<Outlier> {
    /// No set of photographs, and no board, has so many.
    const MANY: usize = 1 << 24;
    let side = entry.get("side")?;
    let known = ["left", "right"].into_iter().find(|known| side.text().is_ok_and(|text| text == *known));
    Ok(Outlier {
        view: entry.get("view")?.count(MANY)?,
        side: known.ok_or_else(|| side.error("must be 'left' or 'right'"))?,
        corner: entry.get("corner")?.count(MANY)?,
        residual_px: entry.get("residual_px")?.positive()?,
        sigma_px: entry.get("sigma_px")?.positive()?,
    })
}

fn board_warp(entry: &Entry<'_>) -> Result<BoardWarp> {
    Ok(BoardWarp {
        height_m: entry.get("height_m")?.numbers::<2>()?,
        sigma_m: entry.get("sigma_m")?.numbers::<2>()?,
    })
}
