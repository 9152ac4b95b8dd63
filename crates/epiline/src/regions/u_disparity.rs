//! How often each disparity occurs in each column of a region.

use super::Region;
use crate::image::{Image, ImageRef};
use crate::matching::{DisparityMap, Validity};

/// The u-disparity histogram of a region in steps of half a pixel of disparity.
///
/// Two neighbouring bins together are a window of 1 px that can lie anywhere to within half a bin: wide enough for
/// the scatter of an upright surface, narrow enough that a level floor, whose disparity changes from row to row,
/// leaves few pixels in it (see [`obstacles`](crate::obstacles)).
///
/// Stored a bin to a row: neighbouring columns mostly see one disparity, so counting stays within few cache lines.
#[derive(Debug, Clone, Default)]
pub(crate) struct UDisparity {
    counts: Image<u16>,
}

impl UDisparity {
    /// Sixteenths of a pixel in a bin.
    pub const RAW_PER_BIN: u16 = DisparityMap::SCALE / 2;

    /// The bin of a disparity.
    #[inline]
    pub fn bin(raw: u16) -> usize {
        usize::from(raw / Self::RAW_PER_BIN)
    }

    /// The disparity in the middle of a bin, pixels.
    pub fn center_px(bin: usize) -> f64 {
        (bin as f64 + 0.5) * f64::from(Self::RAW_PER_BIN) / f64::from(DisparityMap::SCALE)
    }

    /// Counts the pixels of a region, which the caller has validated.
    pub fn count(&mut self, disparity: &DisparityMap, region: &Region) {
        let rows = region.y..region.y + region.height;
        let columns = region.x..region.x + region.width;
        let largest_of = |y| disparity.values.row(y)[columns.clone()].iter().copied().fold(0, u16::max);
        let largest = rows.clone().map(largest_of).fold(0, u16::max);
        self.counts.resize(region.width, Self::bin(largest) + 1);
        self.counts.fill(0);
        let width = region.width;
        let counts = self.counts.as_mut_slice();
        for y in rows {
            let raws = &disparity.values.row(y)[columns.clone()];
            let bits = &disparity.validity.row(y)[columns.clone()];
            for (x, (&raw, &bits)) in raws.iter().zip(bits).enumerate() {
                // At most 16 384 rows: no overflow.
                counts[Self::bin(raw) * width + x] += u16::from(Validity::has_value(bits));
            }
        }
    }

    /// The counts: columns of the region along x, bins along y.
    pub fn counts(&self) -> ImageRef<'_, u16> {
        self.counts.view()
    }
}
