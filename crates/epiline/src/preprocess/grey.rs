//! Colour to grey.

use crate::image::{Image, ImageRef};
use crate::kernels::grey::GreyRow;
use crate::kernels::{Kernels, Level};

/// Grey level of every pixel: `Y = 0.299 R + 0.587 G + 0.114 B` (ITU-R BT.601), rounded to nearest.
///
/// `src` holds blue, green, red; `dst` takes its size. Equal bit for bit to OpenCV's `COLOR_BGR2GRAY`.
pub fn grey_from_bgr(src: ImageRef<'_, [u8; 3]>, dst: &mut Image<u8>) {
    let kernels = Kernels::new(Level::current());
    dst.resize(src.width(), src.height());
    if src.stride() == src.width() {
        // One long row, which ends once.
        let bgr = &src.elements_from(0, 0)[..dst.as_slice().len()];
        return kernels.grey(&mut GreyRow { bgr, grey: dst.as_mut_slice() });
    }
    for (y, bgr) in src.rows().enumerate() {
        kernels.grey(&mut GreyRow { bgr, grey: dst.row_mut(y) });
    }
}
