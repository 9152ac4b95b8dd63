//! The x-Sobel prefilter: what remains of an image when exposure, gain and slow shading are gone.

use crate::error::{Error, Result};
use crate::image::{Image, ImageRef};
use crate::kernels::xsobel::XSobelRow;
use crate::kernels::{Kernels, Level};

/// `clamp(S, -cap, cap) + cap` with the horizontal Sobel derivative
/// `S(x, y) = Σ_{j = -1..1} (2 - |j|) (I(x + 1, y + j) - I(x - 1, y + j))`, the image mirrored at its borders.
///
/// `cap` is 1 to 63 grey levels. `dst` takes the size of `src`. The formula is that of OpenCV's `PREFILTER_XSOBEL`,
/// which leaves the last row of images of odd height flat; here that row is filtered like the others.
pub fn xsobel(src: ImageRef<'_, u8>, cap: u8, dst: &mut Image<u8>) -> Result<()> {
    if !(1..=63).contains(&cap) {
        return Err(Error::invalid("cap", cap, "must be 1 to 63 grey levels"));
    }
    let kernels = Kernels::new(Level::current());
    dst.resize(src.width(), src.height());
    for y in 0..src.height() {
        xsobel_row(&kernels, src, y, cap, dst.row_mut(y));
    }
    Ok(())
}

/// Row `y` of [`xsobel`].
pub(crate) fn xsobel_row(kernels: &Kernels, src: ImageRef<'_, u8>, y: usize, cap: u8, filtered: &mut [u8]) {
    let last = src.height() - 1;
    // Mirrored without repeating the border row; an image of one row mirrors onto itself.
    let above = y.checked_sub(1).unwrap_or(last.min(1));
    let below = if y < last { y + 1 } else { last.saturating_sub(1) };
    let (above, middle, below) = (src.row(above), src.row(y), src.row(below));
    kernels.xsobel(&mut XSobelRow { above, middle, below, cap, filtered });
}
