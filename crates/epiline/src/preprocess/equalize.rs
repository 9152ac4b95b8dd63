//! Histogram equalisation.

use crate::image::{Image, ImageRef};
use crate::kernels::lookup::LookupRow;
use crate::kernels::{Kernels, Level};

const MAX_LEVEL: u64 = 255;

/// Histogram equalisation exactly as eq. 3 of the paper: `q = T(w) = Imax · Σ_{r<=w} P_w(r)`.
///
/// `P_w(r)` is the share of pixels at level `r` and `Imax` = 255; `q` is rounded to nearest, halves upward, in
/// exact integer arithmetic. `dst` takes the size of `src`.
///
/// OpenCV's `equalizeHist` leaves the pixels of the darkest occupied level out of the sum: there that level becomes
/// 0 and an image of one level stays as it is, here the first becomes its own share of 255 and the second white.
pub fn equalize_histogram(src: ImageRef<'_, u8>, dst: &mut Image<u8>) {
    let kernels = Kernels::new(Level::current());
    let table = transfer_table(&histogram(src));
    dst.resize(src.width(), src.height());
    for (y, levels) in src.rows().enumerate() {
        kernels.lookup(&mut LookupRow { table: &table, levels, out: dst.row_mut(y) });
    }
}

fn histogram(src: ImageRef<'_, u8>) -> [u32; 256] {
    // Eight counters per level: equal neighbours would otherwise wait for each other's store.
    let mut lanes = [[0u32; 256]; 8];
    for row in src.rows() {
        let (eights, rest) = row.as_chunks::<8>();
        for eight in eights {
            for (lane, &w) in lanes.iter_mut().zip(eight) {
                lane[usize::from(w)] += 1;
            }
        }
        for &w in rest {
            lanes[0][usize::from(w)] += 1;
        }
    }
    std::array::from_fn(|level| lanes.iter().map(|lane| lane[level]).sum())
}

/// `T(w)` for every level `w`.
fn transfer_table(histogram: &[u32; 256]) -> [u8; 256] {
    let total: u64 = histogram.iter().map(|&n| u64::from(n)).sum();
    let mut not_brighter = 0u64;
    histogram.map(|count| {
        not_brighter += u64::from(count);
        // round(MAX_LEVEL * not_brighter / total)
        ((2 * MAX_LEVEL * not_brighter + total) / (2 * total)) as u8
    })
}
