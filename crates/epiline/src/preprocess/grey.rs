//! Colour to grey.

use crate::image::{Image, ImageRef};

// BT.601 weights in 1/32768, as OpenCV rounds them; they add up to one, so that white stays white.
const SHIFT: u32 = 15;
const BLUE: u32 = 3_735;
const GREEN: u32 = 19_235;
const RED: u32 = 9_798;

/// Grey level of every pixel: `Y = 0.299 R + 0.587 G + 0.114 B` (ITU-R BT.601), rounded to nearest.
///
/// `src` holds blue, green, red; `dst` takes its size. Equal bit for bit to OpenCV's `COLOR_BGR2GRAY`.
pub fn grey_from_bgr(src: ImageRef<'_, [u8; 3]>, dst: &mut Image<u8>) {
    dst.resize(src.width(), src.height());
    for (y, row) in src.rows().enumerate() {
        for (grey, &[b, g, r]) in dst.row_mut(y).iter_mut().zip(row) {
            let sum = BLUE * u32::from(b) + GREEN * u32::from(g) + RED * u32::from(r);
            *grey = ((sum + (1 << (SHIFT - 1))) >> SHIFT) as u8;
        }
    }
}
