//! What the pixels of a row are compared by.

use crate::kernels::portable;

/// Bytes of a 5x5 census: 24 comparisons, eight to a byte.
pub const CENSUS_BYTES: usize = 3;
/// Half the side of the census window.
pub const CENSUS_RADIUS: usize = 2;

/// A row of one quantity: its values, and its extremes within half a pixel.
#[derive(Debug, Clone, Copy)]
pub struct Channel<'a> {
    /// At the pixel.
    pub value: &'a [u8],
    /// Smallest of the value and the means with both neighbours.
    pub low: &'a [u8],
    /// Largest of them.
    pub high: &'a [u8],
}

/// A row of one image, ready to be compared.
#[derive(Debug, Clone, Copy)]
pub struct PixelRow<'a> {
    /// The prefiltered image; values up to 126.
    pub filtered: Channel<'a>,
    /// Grey values.
    pub grey: Channel<'a>,
    /// Bits of the census, a plane per byte.
    pub census: [&'a [u8]; CENSUS_BYTES],
}

impl PixelRow<'_> {
    /// The row's length, which all its parts have.
    pub(in crate::kernels) fn check(&self) -> usize {
        let len = self.grey.value.len();
        for channel in [self.filtered, self.grey] {
            assert!(
                [channel.value, channel.low, channel.high].iter().all(|part| part.len() == len),
                "a channel"
            );
        }
        assert!(self.census.iter().all(|plane| plane.len() == len), "a plane of the census");
        len
    }
}

/// Extremes of a row within half a pixel; at its ends, the neighbour outside is the pixel itself.
#[derive(Debug)]
pub struct ExtremesRow<'a> {
    /// `width` values.
    pub value: &'a [u8],
    /// Out.
    pub low: &'a mut [u8],
    /// Out.
    pub high: &'a mut [u8],
}

impl ExtremesRow<'_> {
    pub(in crate::kernels) fn check(&self) {
        let width = self.value.len();
        assert!(width > 0 && self.low.len() == width && self.high.len() == width, "a row's length");
    }
}

/// Means are rounded up.
#[inline(always)]
pub(in crate::kernels) fn extremes(row: &mut ExtremesRow<'_>) {
    let last = row.value.len() - 1;
    let mean = |a: u8, b: u8| (u16::from(a) + u16::from(b)).div_ceil(2) as u8;
    let of = |before: u8, value: u8, after: u8| {
        let (before, after) = (mean(before, value), mean(value, after));
        (value.min(before).min(after), value.max(before).max(after))
    };
    let value = row.value;
    (row.low[0], row.high[0]) = of(value[0], value[0], value[last.min(1)]);
    (row.low[last], row.high[last]) = of(value[last.saturating_sub(1)], value[last], value[last]);
    let inner = last.saturating_sub(1);
    if inner == 0 {
        return;
    }
    let (before, middle, after) = (&value[..inner], &value[1..=inner], &value[2..]);
    let (low, high) = (&mut row.low[1..=inner], &mut row.high[1..=inner]);
    for x in 0..inner {
        (low[x], high[x]) = of(before[x], middle[x], after[x]);
    }
}

/// The 5x5 census of a row: bit by bit, in raster order, whether a neighbour is darker than the centre (Zabih and
/// Woodfill, ECCV 1994).
#[derive(Debug)]
pub struct CensusRow<'a> {
    /// The five rows, from above; each extended by [`CENSUS_RADIUS`] pixels to both sides.
    pub rows: [&'a [u8]; 2 * CENSUS_RADIUS + 1],
    /// Out: `width` bytes each.
    pub planes: [&'a mut [u8]; CENSUS_BYTES],
}

impl CensusRow<'_> {
    pub(in crate::kernels) fn check(&self) {
        let width = self.planes[0].len();
        assert!(self.planes.iter().all(|plane| plane.len() == width), "a plane's length");
        assert!(self.rows.iter().all(|row| row.len() == width + 2 * CENSUS_RADIUS), "a row's length");
    }
}

#[inline(always)]
pub(in crate::kernels) fn census(row: &mut CensusRow<'_>) {
    let width = row.planes[0].len();
    let centre = &row.rows[CENSUS_RADIUS][CENSUS_RADIUS..][..width];
    let side = 2 * CENSUS_RADIUS + 1;
    let neighbours = (0..side * side).filter(|&i| i != side * side / 2);
    for (bit, i) in neighbours.enumerate() {
        let neighbour = &row.rows[i / side][i % side..][..width];
        let plane = &mut row.planes[bit / 8][..width];
        if bit % 8 == 0 {
            plane.fill(0);
        }
        for x in 0..width {
            plane[x] |= u8::from(neighbour[x] < centre[x]) << (bit % 8);
        }
    }
}

portable!(extremes_row, extremes, ExtremesRow<'_>);
portable!(census_row, census, CensusRow<'_>);
