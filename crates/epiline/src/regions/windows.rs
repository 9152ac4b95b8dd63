//! The nearest window of disparity of each column.

use std::ops::RangeInclusive;

use super::plane::{Plane, Scene};
use super::u_disparity::UDisparity;
use crate::kernels::Kernels;
use crate::kernels::sort::LANES;
use crate::kernels::windows::{OfferBin, REACH, SumColumns};

/// For each column of a region, the nearest window of disparity, 1 px wide, with enough pixels in this and
/// [`REACH`](Self::REACH) columns on either side.
#[derive(Debug, Clone, Default)]
pub(super) struct Windows {
    /// A bin's pixels, between zeros that stand for the columns beyond the region.
    counts: Vec<u16>,
    /// Sums over neighbouring columns, of the four bins looked at.
    sums: [Vec<u32>; 4],
    /// As [`OfferBin`] has them.
    first: Vec<u32>,
    taken: Vec<u32>,
    full: Vec<u32>,
    mean: Vec<f32>,
    /// How near each is, larger is nearer; negative where there is none, or none any more.
    nearness: Vec<f32>,
}

impl Windows {
    /// Columns on either side that support a column.
    pub const REACH: usize = REACH;

    /// Finds them; `support` pixels are enough.
    pub fn find(&mut self, kernels: &Kernels, scene: &Scene<'_>, u_disparity: &UDisparity, support: u32) {
        let width = scene.tiles.width();
        let padded = scene.tiles.len() * LANES + 2 * REACH;
        self.counts.clear();
        self.counts.resize(padded, 0);
        for sums in &mut self.sums {
            sums.clear();
            sums.resize(width, 0);
        }
        for numbers in [&mut self.first, &mut self.taken, &mut self.full] {
            numbers.clear();
            numbers.resize(width, 0);
        }
        self.mean.clear();
        self.mean.resize(width, 0.0);
        let totals = u_disparity.totals();
        // Before the step for a bin, `sums` holds the bin nearer, itself and the next farther one; the step adds one more.
        let total = |bin: Option<usize>| bin.map_or(0, |bin| totals[bin]);
        for bin in (1..totals.len() + 2).rev() {
            self.sums.rotate_left(1);
            let farthest = bin.checked_sub(2);
            self.sum_bin(kernels, u_disparity, farthest.filter(|_| total(farthest) > 0), width);
            // The first two bins are too many: they only bring in what is farther.
            if bin < totals.len() && totals[bin] + totals[bin - 1] >= support {
                kernels.offer(&mut OfferBin {
                    pixels: self.sums.each_ref().map(Vec::as_slice),
                    bin: bin as u32,
                    support,
                    first: &mut self.first,
                    taken: &mut self.taken,
                    full: &mut self.full,
                    mean: &mut self.mean,
                });
            }
        }
        self.rank(scene);
    }

    fn sum_bin(&mut self, kernels: &Kernels, u_disparity: &UDisparity, bin: Option<usize>, width: usize) {
        let Some(bin) = bin else {
            self.sums[3].fill(0);
            return;
        };
        for (counts, of_tile) in self.counts[REACH..].chunks_exact_mut(LANES).zip(u_disparity.of_bin(bin)) {
            counts.copy_from_slice(of_tile);
        }
        kernels.sum_columns(&mut SumColumns {
            counts: &self.counts[..width + 2 * REACH],
            sums: &mut self.sums[3],
        });
    }

    fn rank(&mut self, scene: &Scene<'_>) {
        let row = scene.slopes_of_rows(0);
        let v = row.0 + row.1 * scene.middle_row();
        let of_column = |x: usize, mean: f32, full: u32| {
            let from_infinity = (UDisparity::center_px(f64::from(mean)) + scene.doffs_px()) as f32;
            let u = scene.slope_of_column(scene.region.x + x);
            let ray_squared = (1.0 + u * u + v * v) as f32;
            if full > 0 && from_infinity > 0.0 { from_infinity * from_infinity / ray_squared } else { -1.0 }
        };
        let windows = self.mean.iter().zip(&self.full).enumerate();
        self.nearness.clear();
        self.nearness.extend(windows.map(|(x, (&mean, &full))| of_column(x, mean, full)));
    }

    /// The column of the region whose window is nearest, and its mean disparity, px.
    pub fn nearest(&self) -> Option<(usize, f64)> {
        let nearest = self.nearness.iter().copied().fold(-1.0, f32::max);
        if nearest < 0.0 {
            return None;
        }
        let column = self.nearness.iter().position(|&nearness| nearness == nearest)?;
        Some((column, self.mean_px(column)))
    }

    /// Forgets a column's window.
    pub fn remove(&mut self, column: usize) {
        self.nearness[column] = -1.0;
    }

    /// Forgets the windows that look at a plane: they would only lead to it again.
    pub fn remove_on(&mut self, scene: &Scene<'_>, plane: &Plane, columns: RangeInclusive<usize>) {
        let top = scene.region.y as f64;
        let bottom = top + (scene.region.height - 1) as f64;
        for column in columns {
            let x = (scene.region.x + column) as f64;
            let ends = [plane.at(x, top), plane.at(x, bottom)];
            let (far, near) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            if (far - 1.0..=near + 1.0).contains(&self.mean_px(column)) {
                self.remove(column);
            }
        }
    }

    fn mean_px(&self, column: usize) -> f64 {
        UDisparity::center_px(f64::from(self.mean[column]))
    }
}
