//! The method of the 2011 paper: pixels brighter than their neighbourhood, clustered into objects.
//!
//! ```text
//! near     = disparity, 0 where there is none               (brighter is nearer)
//! around   = lowpass(near) / lowpass(has a disparity)       (eq. 7; what has none does not count)
//! bright   = near > around + brighter_px
//! objects  = bright pixels connected to one another without a step of disparity
//! ```

use super::columns::Peak;
use super::{ObstacleParams, PixelBox};
use crate::error::Result;
use crate::image::Image;
use crate::matching::{DisparityMap, Validity};
use crate::preprocess::GaussianLowPass;

/// Connected pixels differ by no more than this, sixteenths of a pixel.
const LARGEST_STEP: u16 = DisparityMap::SCALE;
/// The low-passed mask is at least this, so that nothing is divided by nothing.
const LEAST_WEIGHT: f32 = 1e-3;

/// Clusters bright pixels; keeps its plans and buffers.
#[derive(Default)]
pub(super) struct BrightClusters {
    low_pass: Option<(f64, GaussianLowPass)>,
    near: Image<f32>,
    known: Image<f32>,
    around: Image<f32>,
    weight: Image<f32>,
    bright: Image<u8>,
    open: Vec<(u16, u16)>,
    /// Pixels of the object being listed: column, row, disparity in sixteenths.
    pixels: Vec<(u16, u16, u16)>,
}

impl std::fmt::Debug for BrightClusters {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("BrightClusters").finish_non_exhaustive()
    }
}

impl BrightClusters {
    /// Calls `visit` with each object: its columns from left to right.
    pub fn find(
        &mut self,
        disparity: &DisparityMap,
        smallest_px: f64,
        params: &ObstacleParams,
        peaks: &mut Vec<Peak>,
        mut visit: impl FnMut(&[Peak]),
    ) -> Result<()> {
        self.mark_bright(disparity, smallest_px, params)?;
        for y in 0..disparity.height() {
            for x in 0..disparity.width() {
                if self.bright.row(y)[x] == 0 {
                    continue;
                }
                let bounds = self.take_object(disparity, x, y);
                if self.pixels.len() >= params.min_pixels {
                    list_columns(&self.pixels, &bounds, peaks);
                    visit(peaks);
                }
            }
        }
        Ok(())
    }

    fn mark_bright(
        &mut self,
        disparity: &DisparityMap,
        smallest_px: f64,
        params: &ObstacleParams,
    ) -> Result<()> {
        let (width, height) = (disparity.width(), disparity.height());
        for image in [&mut self.near, &mut self.known] {
            image.resize(width, height);
        }
        self.bright.resize(width, height);
        let smallest_raw = (smallest_px * f64::from(DisparityMap::SCALE)).ceil();
        for y in 0..height {
            let seen = disparity.values.row(y).iter().zip(disparity.validity.row(y));
            let out = self.near.row_mut(y).iter_mut().zip(self.known.row_mut(y));
            for ((&raw, &bits), (near, known)) in seen.zip(out) {
                let has_value = Validity::has_value(bits) && f64::from(raw) >= smallest_raw;
                *known = f32::from(u8::from(has_value));
                *near = *known * f32::from(raw) / f32::from(DisparityMap::SCALE);
            }
        }
        let fits = self.low_pass.as_ref().is_some_and(|(sigma, _)| {
            *sigma == params.low_pass_sigma && (self.around.width(), self.around.height()) == (width, height)
        });
        if !fits {
            self.low_pass = None;
        }
        let (_, low_pass) = match &mut self.low_pass {
            Some(kept) => kept,
            none => none
                .insert((params.low_pass_sigma, GaussianLowPass::new(width, height, params.low_pass_sigma)?)),
        };
        low_pass.apply(self.near.view(), &mut self.around)?;
        low_pass.apply(self.known.view(), &mut self.weight)?;
        let margin = params.brighter_px as f32;
        for y in 0..height {
            let around = self.around.row(y).iter().zip(self.weight.row(y));
            let seen = self.near.row(y).iter().zip(self.known.row(y));
            for ((bright, (&near, &known)), (&around, &weight)) in
                self.bright.row_mut(y).iter_mut().zip(seen).zip(around)
            {
                let is_brighter = near > around / weight.max(LEAST_WEIGHT) + margin;
                *bright = u8::from(known > 0.0 && is_brighter);
            }
        }
        Ok(())
    }

    /// Lists the pixels connected to one and takes them out of the image; returns their box.
    fn take_object(&mut self, disparity: &DisparityMap, x: usize, y: usize) -> PixelBox {
        let (width, height) = (disparity.width(), disparity.height());
        self.pixels.clear();
        self.open.clear();
        self.open.push((x as u16, y as u16));
        self.bright.row_mut(y)[x] = 0;
        let (mut left, mut right, mut top, mut bottom) = (x, x, y, y);
        while let Some((x, y)) = self.open.pop() {
            let (x, y) = (usize::from(x), usize::from(y));
            let raw = disparity.values.row(y)[x];
            self.pixels.push((x as u16, y as u16, raw));
            (left, right) = (left.min(x), right.max(x));
            (top, bottom) = (top.min(y), bottom.max(y));
            let beside = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            for (x, y) in beside.into_iter().filter(|&(x, y)| x < width && y < height) {
                let connected = disparity.values.row(y)[x].abs_diff(raw) <= LARGEST_STEP;
                if connected && self.bright.row(y)[x] != 0 {
                    self.bright.row_mut(y)[x] = 0;
                    self.open.push((x as u16, y as u16));
                }
            }
        }
        PixelBox { x: left, y: top, width: right + 1 - left, height: bottom + 1 - top }
    }
}

/// What each column of an object sees, from left to right.
fn list_columns(pixels: &[(u16, u16, u16)], bounds: &PixelBox, peaks: &mut Vec<Peak>) {
    let empty = |column: usize| Peak {
        column,
        disparity_px: 0.0,
        support: 0,
        top: usize::MAX,
        bottom: 0,
        near: 0,
        far: 0,
    };
    peaks.clear();
    peaks.extend((bounds.x..bounds.x + bounds.width).map(empty));
    for &(x, y, raw) in pixels {
        let peak = &mut peaks[usize::from(x) - bounds.x];
        peak.support += 1;
        peak.disparity_px += f64::from(raw) / f64::from(DisparityMap::SCALE);
        (peak.top, peak.bottom) = (peak.top.min(usize::from(y)), peak.bottom.max(usize::from(y)));
    }
    // Connected pixels leave no column out.
    for peak in peaks {
        peak.disparity_px /= peak.support as f64;
    }
}
