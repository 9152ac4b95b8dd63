//! Depth, range and their uncertainty of every pixel.

use super::confidence;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::kernels::range::{ENTRIES, Metres, RangeRow};
use crate::kernels::{Kernels, Level};
use crate::matching::{DisparityMap, Validity};
use crate::rectification::RectifiedGeometry;

/// Metres of every pixel of the left aligned image.
///
/// `depth_m` is Z along the optical axis, `range_m` the Euclidean distance from the left camera; both and `sigma_m`
/// are NaN where the disparity map has no value, and where the two rays do not meet in front of the cameras
/// (`d + doffs_px <= 0`: a point at infinity has no range).
#[derive(Debug, Clone, PartialEq)]
pub struct RangeImage {
    /// Z along the optical axis, metres.
    pub depth_m: Image<f32>,
    /// Euclidean distance, metres.
    pub range_m: Image<f32>,
    /// Standard deviation of `range_m`, metres: matching and calibration together.
    pub sigma_m: Image<f32>,
    /// Bits of [`Validity`], as in the disparity map.
    pub validity: Image<u8>,
    /// What the pixels mean in space.
    pub geometry: RectifiedGeometry,
}

impl RangeImage {
    /// An image of the geometry's size without a single answer.
    pub fn new(geometry: &RectifiedGeometry) -> Self {
        let unknown = || Image::from_fn(geometry.width, geometry.height, |_, _| f32::NAN);
        let mut validity = Image::new(geometry.width, geometry.height);
        validity.fill(Validity::BORDER);
        Self { depth_m: unknown(), range_m: unknown(), sigma_m: unknown(), validity, geometry: *geometry }
    }

    /// Width, pixels.
    pub fn width(&self) -> usize {
        self.depth_m.width()
    }

    /// Height, pixels.
    pub fn height(&self) -> usize {
        self.depth_m.height()
    }

    /// Every pixel that has a depth, row after row, as `(x, y, (X, Y, Z) in metres)` in the left aligned frame.
    pub fn points(&self) -> impl Iterator<Item = (usize, usize, [f32; 3])> + '_ {
        let RectifiedGeometry { focal_px, cx_px, cy_px, .. } = self.geometry;
        let slope = move |at: usize, center: f64| ((at as f64 - center) / focal_px) as f32;
        (0..self.height()).flat_map(move |y| {
            let row_slope = slope(y, cy_px);
            self.depth_m
                .row(y)
                .iter()
                .enumerate()
                .filter(|(_, z)| z.is_finite())
                .map(move |(x, &z)| (x, y, [slope(x, cx_px) * z, row_slope * z, z]))
        })
    }
}

/// Triangulation of one rig, with everything that does not depend on the frame worked out beforehand.
///
/// ```text
/// Z       = f·b / (d + doffs)                                     eq. 2
/// range   = Z·‖ray‖,  ray = ((x - cx)/f, (y - cy)/f, 1)
/// σ_range = ‖ray‖·sqrt((Z²·σ_d / (f·b))² + var_calibration(Z))
/// ```
///
/// `Z` and its variance depend on the disparity alone, of which there are few (sixteenths of a pixel), so both come
/// from a table; `‖ray‖² = 1 + u² + v²` is a sum of a term per column and one per row.
#[derive(Debug, Clone)]
pub struct Triangulation {
    geometry: RectifiedGeometry,
    disparity_sigma_px: f64,
    kernels: Kernels,
    /// Entry 0 is unknown; entry `1 + raw` belongs to a disparity of `raw` sixteenths. [`ENTRIES`] long, of which memory
    /// is only touched as far as it was worked out.
    table: Vec<Metres>,
    /// How many entries of the table are worked out.
    worked_out: usize,
    /// The calibration's part of the variance of depth, metres²; by disparity, as far as it was asked for.
    calibration_variance: Vec<f32>,
    /// `1 + u²` of each column.
    column_term: Vec<f32>,
}

impl Triangulation {
    /// Prepares for maps of this geometry, whose disparities have a standard deviation of `disparity_sigma_px`.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] unless the standard deviation is finite and not negative.
    pub fn new(geometry: &RectifiedGeometry, disparity_sigma_px: f64) -> Result<Self> {
        check_disparity_sigma(disparity_sigma_px)?;
        geometry.require_pinhole("to_range")?;
        let column_term = (0..geometry.width)
            .map(|x| {
                let u = (x as f64 - geometry.cx_px) / geometry.focal_px;
                (1.0 + u * u) as f32
            })
            .collect();
        let mut table = vec![[0.0; 2]; ENTRIES];
        table[0] = UNKNOWN;
        Ok(Self {
            geometry: *geometry,
            disparity_sigma_px,
            kernels: Kernels::new(Level::current()),
            table,
            worked_out: 1,
            calibration_variance: Vec::new(),
            column_term,
        })
    }

    /// Fills `out`, keeping its memory.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] if the map is not of the geometry's size.
    pub fn apply(&mut self, disparity: &DisparityMap, out: &mut RangeImage) -> Result<()> {
        let geometry = self.geometry;
        check_size(disparity, &geometry)?;
        self.extend_table(disparity.values.as_slice().iter().copied().max().unwrap_or(0));
        for image in [&mut out.depth_m, &mut out.range_m, &mut out.sigma_m] {
            image.resize(geometry.width, geometry.height);
        }
        out.validity.resize(geometry.width, geometry.height);
        out.validity.as_mut_slice().copy_from_slice(disparity.validity.as_slice());
        out.geometry = geometry;

        let table = self.table.as_slice().try_into().expect("an entry for each disparity");
        for y in 0..geometry.height {
            let v = (y as f64 - geometry.cy_px) / geometry.focal_px;
            self.kernels.range(&mut RangeRow {
                raws: disparity.values.row(y),
                bits: disparity.validity.row(y),
                harmless: Validity::FILLED,
                table,
                column_terms: &self.column_term,
                row_term: (v * v) as f32,
                depth: out.depth_m.row_mut(y),
                range: out.range_m.row_mut(y),
                sigma: out.sigma_m.row_mut(y),
            });
        }
        Ok(())
    }

    /// The same, with a standard deviation of the disparity for each pixel by its confidence
    /// ([`disparity_sigma_px`](super::disparity_sigma_px)), as [`DisparityMap::confidence`] gives it.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] if the map or the confidences are not of the geometry's size.
    pub fn apply_by_confidence(
        &mut self,
        disparity: &DisparityMap,
        confidence: &Image<u8>,
        out: &mut RangeImage,
    ) -> Result<()> {
        disparity.values.view().require_same_size("disparity", &confidence.view(), "confidence")?;
        self.apply(disparity, out)?;
        let geometry = self.geometry;
        let sigma_of: [f32; 256] =
            std::array::from_fn(|confidence| confidence::disparity_sigma_px(confidence as u8));
        let per_square_metre = (1.0 / (geometry.focal_px * geometry.baseline_m)) as f32;
        for raw in self.calibration_variance.len()..self.worked_out - 1 {
            self.calibration_variance.push(calibration_variance(&geometry, self.depth_m(raw)) as f32);
        }
        for y in 0..geometry.height {
            let metres = out.depth_m.row(y).iter().zip(out.range_m.row(y));
            let pixels = metres.zip(disparity.values.row(y).iter().zip(confidence.row(y)));
            for (sigma, ((&depth, &range), (&raw, &confidence))) in
                out.sigma_m.row_mut(y).iter_mut().zip(pixels)
            {
                if depth.is_nan() {
                    continue;
                }
                let matching = depth * depth * per_square_metre * sigma_of[usize::from(confidence)];
                let calibration = self.calibration_variance[usize::from(raw)];
                *sigma = range / depth * (matching * matching + calibration).sqrt();
            }
        }
        Ok(())
    }

    /// Makes the table reach `largest` sixteenths of a pixel.
    fn extend_table(&mut self, largest: u16) {
        // The largest number is no disparity, and has no entry.
        for entry in self.worked_out..=(usize::from(largest) + 1).min(ENTRIES - 1) {
            let depth_m = self.depth_m(entry - 1);
            self.table[entry] = if depth_m.is_finite() && depth_m > 0.0 {
                [depth_m, depth_sigma_m(&self.geometry, depth_m, self.disparity_sigma_px)].map(|m| m as f32)
            } else {
                UNKNOWN
            };
            self.worked_out = entry + 1;
        }
    }

    fn depth_m(&self, raw: usize) -> f64 {
        self.geometry.depth_m(raw as f64 / f64::from(DisparityMap::SCALE))
    }
}

const UNKNOWN: Metres = [f32::NAN; 2];

/// Standard deviation of a depth: `sqrt((Z²·σ_d / (f·b))² + var_calibration(Z))`, metres.
pub(crate) fn depth_sigma_m(geometry: &RectifiedGeometry, depth_m: f64, disparity_sigma_px: f64) -> f64 {
    let matching_m = depth_m * depth_m * disparity_sigma_px / (geometry.focal_px * geometry.baseline_m);
    (matching_m * matching_m + calibration_variance(geometry, depth_m)).sqrt()
}

/// Variance of a depth by the calibration's uncertainty, metres².
fn calibration_variance(geometry: &RectifiedGeometry, depth_m: f64) -> f64 {
    // A covariance rounded to indefiniteness must not turn the whole into NaN.
    geometry.calibration_variance.at(depth_m).max(0.0)
}

pub(crate) fn check_disparity_sigma(disparity_sigma_px: f64) -> Result<()> {
    if disparity_sigma_px.is_finite() && disparity_sigma_px >= 0.0 {
        return Ok(());
    }
    let value = format!("{disparity_sigma_px} px");
    Err(Error::invalid("disparity_sigma_px", value, "must be finite and not negative"))
}

/// Fails unless map and geometry have one size.
pub(crate) fn check_size(disparity: &DisparityMap, geometry: &RectifiedGeometry) -> Result<()> {
    let RectifiedGeometry { width, height, .. } = *geometry;
    if (disparity.width(), disparity.height()) == (width, height) {
        return Ok(());
    }
    Err(Error::SizeMismatch {
        first: "disparity",
        first_width: disparity.width(),
        first_height: disparity.height(),
        second: "geometry",
        second_width: width,
        second_height: height,
    })
}

/// Depth, range and sigma of a disparity map, sigma by each pixel's confidence.
///
/// # Errors
///
/// [`Error::SizeMismatch`] if map and geometry differ in size, [`Error::InvalidParameter`] for a cylindrical pair.
pub fn to_range_by_confidence(
    disparity: &DisparityMap,
    geometry: &RectifiedGeometry,
    out: &mut RangeImage,
) -> Result<()> {
    Triangulation::new(geometry, 0.0)?.apply_by_confidence(disparity, &disparity.confidence(), out)
}

/// Depth, range and sigma of a disparity map; [`Triangulation`] does the same for many frames of one rig.
///
/// # Errors
///
/// [`Error::SizeMismatch`] if map and geometry differ in size, [`Error::InvalidParameter`] for a `disparity_sigma_px`
/// that is negative or not finite.
pub fn to_range(
    disparity: &DisparityMap,
    geometry: &RectifiedGeometry,
    disparity_sigma_px: f64,
    out: &mut RangeImage,
) -> Result<()> {
    Triangulation::new(geometry, disparity_sigma_px)?.apply(disparity, out)
}
