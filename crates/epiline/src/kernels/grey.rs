//! Colour to grey, one row.

use super::portable;

// BT.601 weights in 1/32768, as OpenCV rounds them; they add up to one, so that white stays white.
const SHIFT: u32 = 15;
const BLUE: u32 = 3_735;
const GREEN: u32 = 19_235;
const RED: u32 = 9_798;

/// `grey = 0.299 R + 0.587 G + 0.114 B`, rounded to nearest.
#[derive(Debug)]
pub struct GreyRow<'a> {
    /// Blue, green, red of each pixel.
    pub bgr: &'a [[u8; 3]],
    /// Out: as many.
    pub grey: &'a mut [u8],
}

impl GreyRow<'_> {
    pub(super) fn check(&self) {
        assert!(self.bgr.len() == self.grey.len(), "a grey level for each pixel");
    }
}

#[inline(always)]
fn grey_of([blue, green, red]: [u8; 3]) -> u8 {
    let sum = BLUE * u32::from(blue) + GREEN * u32::from(green) + RED * u32::from(red);
    ((sum + (1 << (SHIFT - 1))) >> SHIFT) as u8
}

#[inline(always)]
pub(super) fn grey_row(row: &mut GreyRow<'_>) {
    const BLOCK: usize = 32;
    let (blocks, rest) = row.bgr.as_chunks::<BLOCK>();
    let (grey_blocks, grey_rest) = row.grey.as_chunks_mut::<BLOCK>();
    for (block, grey) in blocks.iter().zip(grey_blocks) {
        // A length known beforehand, so that taking the channels apart becomes shuffles of registers.
        *grey = block.map(grey_of);
    }
    for (&pixel, grey) in rest.iter().zip(grey_rest) {
        *grey = grey_of(pixel);
    }
}

portable!(row, grey_row, GreyRow<'_>);
