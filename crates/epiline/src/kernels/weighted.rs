//! Weighted sums of stretches of pixels.

use super::portable;

/// `out[i] = Σ_k weights[k]·pixels[starts[k] + i]`, summed in the order of k from zero.
#[derive(Debug)]
pub struct WeightedRow<'a> {
    /// What is summed.
    pub pixels: &'a [f32],
    /// Where each stretch begins.
    pub starts: &'a [usize],
    /// One for each stretch.
    pub weights: &'a [f32],
    /// Out: as long as each stretch.
    pub out: &'a mut [f32],
}

impl WeightedRow<'_> {
    pub(super) fn check(&self) {
        assert!(self.starts.len() == self.weights.len(), "a weight for each stretch");
        let length = self.out.len();
        let inside = |&start: &usize| start <= self.pixels.len() && length <= self.pixels.len() - start;
        assert!(self.starts.iter().all(inside), "stretches inside the pixels");
    }
}

/// Sums `LANES` pixels at a time, which stay in registers, from `from` on; returns where fewer are left.
#[inline(always)]
fn blocks<const LANES: usize>(row: &mut WeightedRow<'_>, mut from: usize) -> usize {
    while row.out.len() - from >= LANES {
        let mut sums = [0.0_f32; LANES];
        for (&weight, &start) in row.weights.iter().zip(row.starts) {
            let pixels = &row.pixels[start + from..][..LANES];
            for (sum, &pixel) in sums.iter_mut().zip(pixels) {
                *sum += weight * pixel;
            }
        }
        row.out[from..from + LANES].copy_from_slice(&sums);
        from += LANES;
    }
    from
}

/// The plain one: pixel by pixel where no more than four fit a register.
#[inline(always)]
pub(super) fn weighted_row(row: &mut WeightedRow<'_>) {
    let from = blocks::<16>(row, 0);
    blocks::<1>(row, from);
}

/// For registers of eight or sixteen.
#[inline(always)]
fn wide(row: &mut WeightedRow<'_>) {
    let from = blocks::<64>(row, 0);
    let from = blocks::<16>(row, from);
    blocks::<1>(row, from);
}

portable!(row, wide, WeightedRow<'_>);
