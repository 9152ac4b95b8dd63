//! Weighted sums of rows of pixels.
//!
//! ```text
//! for every strip of columns                                       (1)
//!     for every group of four sums
//!         for every stretch of columns that fits the registers      (2)
//!             for k
//!                 load pixels of row k once, count them for every sum   (3)
//! ```
//!
//! 1. The rows that the next group shares are still in the cache.
//! 2. What is summed stays in registers from the first weight to the last.
//! 3. Four sums that share their rows share the loads, which else take longer than the arithmetic.

use std::ops::Range;

/// Sums that share their rows.
pub const SUMS: usize = 4;
/// Columns of a strip.
const STRIP: usize = 320;

/// Consecutive sums that share their rows.
#[derive(Debug, Clone)]
pub struct Group {
    /// The first row that any of them counts.
    pub first: usize,
    /// The weights of that row and those that follow it in each sum.
    pub weights: Vec<[f32; SUMS]>,
}

/// `out[(SUMS·g + i)·stride + x] = Σ_k groups[g].weights[k][i]·pixels[starts[groups[g].first + k] + x]`, summed in the order
/// of k from zero.
#[derive(Debug)]
pub struct WeightedRows<'a> {
    /// What is summed.
    pub pixels: &'a [f32],
    /// Where each row begins.
    pub starts: &'a [usize],
    /// Weights of rows.
    pub groups: &'a [Group],
    /// Pixels of a row.
    pub width: usize,
    /// Out: sums of the groups, of the last perhaps only some, from the first pixel of the first to the last of the last.
    pub out: &'a mut [f32],
    /// From one sum to the next.
    pub stride: usize,
}

impl WeightedRows<'_> {
    pub(super) fn check(&self) {
        let inside = |&start: &usize| start <= self.pixels.len() && self.width <= self.pixels.len() - start;
        assert!(self.starts.iter().all(inside), "rows inside the pixels");
        let known = |group: &Group| {
            group.first <= self.starts.len() && group.weights.len() <= self.starts.len() - group.first
        };
        assert!(self.groups.iter().all(known), "a start for each row");
        assert!(0 < self.width && self.width <= self.stride, "rows beside each other");
        let before_last = self.out.len().checked_sub(self.width);
        let sums = before_last
            .filter(|cells| cells.is_multiple_of(self.stride))
            .map(|cells| cells / self.stride + 1);
        assert!(sums.is_some_and(|sums| sums.div_ceil(SUMS) == self.groups.len()), "sums of every group");
    }
}

/// Some columns of a group's sums.
struct Sums<'a> {
    pixels: &'a [f32],
    starts: &'a [usize],
    weights: &'a [[f32; SUMS]],
    columns: Range<usize>,
    out: &'a mut [f32],
    stride: usize,
}

impl WeightedRows<'_> {
    /// Some columns of the sums of every group.
    fn sums(&mut self, columns: Range<usize>) -> impl Iterator<Item = Sums<'_>> {
        let Self { pixels, starts, groups, ref mut out, stride, .. } = *self;
        groups.iter().zip(out.chunks_mut(SUMS * stride)).map(move |(group, out)| {
            let Group { first, weights } = group;
            let starts = &starts[*first..][..weights.len()];
            Sums { pixels, starts, weights, columns: columns.clone(), out, stride }
        })
    }
}

/// The columns that are left.
fn plain(group: &mut Sums<'_>) {
    for x in group.columns.clone() {
        let mut sums = [0.0_f32; SUMS];
        for (weights, &start) in group.weights.iter().zip(group.starts) {
            for (sum, &weight) in sums.iter_mut().zip(weights) {
                *sum += weight * group.pixels[start + x];
            }
        }
        for (out, sum) in group.out[x..].iter_mut().step_by(group.stride).zip(sums) {
            *out = sum;
        }
    }
}

/// The plain one.
pub(super) fn weighted_rows(call: &mut WeightedRows<'_>) {
    for mut group in call.sums(0..call.width) {
        plain(&mut group);
    }
}

/// A module with `weighted_rows` for registers of one instruction set, `$most` of them side by side for each sum.
macro_rules! registers {
    (
        $level:ident, $features:literal, $most:literal x $register:ident,
        $splat:ident, $load:ident, $store:ident, $multiply:ident, $add:ident, $arch:ident
    ) => {
        pub(super) mod $level {
            use std::arch::$arch::*;

            use super::{STRIP, SUMS, Sums, WeightedRows, plain};

            const LANES: usize = size_of::<$register>() / size_of::<f32>();

            /// See [`WeightedRows`].
            ///
            /// # Safety
            /// The processor has what the level proves, and `call.check` passed.
            #[target_feature(enable = $features)]
            pub unsafe fn weighted_rows(call: &mut WeightedRows<'_>) {
                for left in (0..call.width).step_by(STRIP) {
                    for mut group in call.sums(left..call.width.min(left + STRIP)) {
                        // SAFETY: the caller's promise.
                        unsafe {
                            stretches::<$most>(&mut group);
                            stretches::<2>(&mut group);
                            stretches::<1>(&mut group);
                        }
                        plain(&mut group);
                    }
                }
            }

            /// `REGISTERS` at a time of the columns that are left.
            ///
            /// # Safety
            /// As above.
            #[target_feature(enable = $features)]
            #[inline]
            unsafe fn stretches<const REGISTERS: usize>(group: &mut Sums<'_>) {
                let count = group.out.len().div_ceil(group.stride);
                while group.columns.len() >= REGISTERS * LANES {
                    let from = group.columns.start;
                    // SAFETY: columns are inside of every row and sum, and as many are left.
                    unsafe {
                        let mut sums = [[$splat(0.0); REGISTERS]; SUMS];
                        for k in 0..group.starts.len() {
                            let pixels = group.pixels.as_ptr().add(*group.starts.get_unchecked(k) + from);
                            let weights = group.weights.get_unchecked(k);
                            for j in 0..REGISTERS {
                                let pixels = $load(pixels.add(j * LANES));
                                for i in 0..SUMS {
                                    sums[i][j] = $add(sums[i][j], $multiply($splat(weights[i]), pixels));
                                }
                            }
                        }
                        let out = group.out.as_mut_ptr().add(from);
                        for i in 0..count {
                            for j in 0..REGISTERS {
                                $store(out.add(i * group.stride + j * LANES), sums[i][j]);
                            }
                        }
                    }
                    group.columns.start += REGISTERS * LANES;
                }
            }
        }
    };
}

#[cfg(target_arch = "x86_64")]
registers!(avx512, "avx512f", 4 x __m512, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_mul_ps, _mm512_add_ps, x86_64);
#[cfg(target_arch = "x86_64")]
registers!(avx2, "avx2", 2 x __m256, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_mul_ps, _mm256_add_ps, x86_64);
#[cfg(target_arch = "aarch64")]
registers!(neon, "neon", 4 x float32x4_t, vdupq_n_f32, vld1q_f32, vst1q_f32, vmulq_f32, vaddq_f32, aarch64);
