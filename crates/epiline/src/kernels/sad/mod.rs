//! Sums of absolute differences over square windows (eq. 5 of the paper), one image row at a time.
//!
//! # Definitions
//!
//! `C(x, y, d) = Σ_{i, j = -r..r} |L(x', y') - R(x' - d, y')|` with `x' = clamp(x + i)`, `y' = clamp(y + j)`: the window
//! is clamped to the left image, so its outermost pixels stand for those beyond, and the right pixel is the one
//! opposite, clamped too. Something may be added to it that is known from elsewhere ([`SadRow::coarse`]). The pair `(x, d)` is a *candidate* if the window's centre lies in the right image,
//! `0 <= x - d`, and neither centre is blocked.
//!
//! # Layout
//!
//! Costs of one pixel lie side by side, **largest disparity first**: lane `k` is `d = d_0 - k`. Right pixels then are
//! read upward, in lane order, and "first lane with the smallest cost" prefers the larger disparity, as OpenCV does.
//! Right rows are padded on the left so that the right pixel of column `c`, lane `k` is `right[c + k]`.
//!
//! # Bounds
//!
//! [`fits_u16`] says when 16-bit sums are enough. All sums are exact in either width: they are non-negative, and
//! differences of two of them wrap and unwrap.

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512;
#[cfg(target_arch = "aarch64")]
pub(super) mod neon;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod picked;
pub mod reference;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) mod ring;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(super) mod vector;

use super::portable;

/// An unsigned integer wide enough for the costs of a setting.
pub trait Cost: Copy + Ord + Default + std::fmt::Debug + Send + Sync + 'static {
    /// The cost of what is not a candidate; more than any window's.
    const BLOCKED: Self;
    /// The cost of equal windows.
    const ZERO: Self;
    /// Widens what fits 16 bits.
    fn from_u16(value: u16) -> Self;
    /// Widens a difference of two pixels.
    fn from_difference(difference: u8) -> Self;
    /// A lane's number, which is below 1024.
    fn from_lane(lane: usize) -> Self;
    /// `self + entering - leaving`, which is not negative although parts of it may be.
    fn slide(self, entering: Self, leaving: Self) -> Self;
    /// The value.
    fn to_u32(self) -> u32;
}

macro_rules! cost {
    ($int:ty) => {
        impl Cost for $int {
            const BLOCKED: Self = <$int>::MAX;
            const ZERO: Self = 0;

            #[inline(always)]
            fn from_u16(value: u16) -> Self {
                value.into()
            }

            #[inline(always)]
            fn from_difference(difference: u8) -> Self {
                difference.into()
            }

            #[inline(always)]
            fn from_lane(lane: usize) -> Self {
                lane as Self
            }

            #[inline(always)]
            fn slide(self, entering: Self, leaving: Self) -> Self {
                self.wrapping_add(entering).wrapping_sub(leaving)
            }

            #[inline(always)]
            fn to_u32(self) -> u32 {
                self.into()
            }
        }
    };
}
cost!(u16);
cost!(u32);

/// Whether window sums of differences up to `largest_difference`, and at most `coarse` more, stay below
/// [`Cost::BLOCKED`] of `u16`.
///
/// x-Sobel with a cap of 31 (differences up to 62) fits every window up to 31: `62·31² = 59 582`. Raw pixels fit up to
/// 15: `255·15² = 57 375`; a cap of 63 up to 21: `126·21² = 55 566`. Beyond, sums are 32 bits wide: `255·31² < 2³²`.
pub fn fits_u16(largest_difference: u8, block_size: usize, coarse: usize) -> bool {
    usize::from(largest_difference) * block_size * block_size + coarse < usize::from(u16::BLOCKED)
}

/// The next number of lanes that kernels are built for: 1, 2, 3, 4, 6, 8, 16, 32 or 64 blocks.
pub(super) fn padded_lanes(num_disparities: usize, lane_block: usize) -> usize {
    let blocks = num_disparities.div_ceil(lane_block);
    let power = blocks.next_power_of_two();
    let between = power / 4 * 3;
    lane_block * if blocks <= between && power <= 8 { between } else { power }
}

/// A row of both images.
#[derive(Debug, Clone, Copy)]
pub struct RowPair<'a> {
    /// `width` pixels.
    pub left: &'a [u8],
    /// `width + lanes - 1` pixels, the first ones copies of the image's first: that of column `c`, lane `k` is
    /// `right[c + k]`.
    pub right: &'a [u8],
}

impl RowPair<'_> {
    fn check(&self, width: usize, lanes: usize) {
        assert!(self.left.len() == width && self.right.len() == width + lanes - 1, "a row's length");
    }
}

/// Columns that are looked at together for whether some of their candidates are blocked.
pub const GROUP: usize = 16;

/// For each [`GROUP`] of columns 1 if a candidate of theirs is blocked by its left or its right pixel, else 0. Most rows
/// have such columns near their ends only.
pub fn blocked_groups(left: &[u8], right: &[u8], lanes: usize, groups: &mut Vec<u8>) {
    groups.clear();
    let mut next_right = 0;
    for (i, left) in left.chunks(GROUP).enumerate() {
        let rights = i * GROUP..i * GROUP + left.len() + lanes - 1;
        next_right = first_set(right, next_right.max(rights.start));
        groups.push(u8::from(next_right < rights.end || first_set(left, 0) < left.len()));
    }
}

/// Where the first cell from `from` on is that is not 0.
fn first_set(cells: &[u8], from: usize) -> usize {
    let cells = &cells[from..];
    let (words, rest) = cells.as_chunks::<8>();
    let zeros = 8 * words.iter().take_while(|&&word| word == [0; 8]).count();
    let of_word = |word: &[u8; 8]| u64::from_le_bytes(*word).trailing_zeros() as usize / 8;
    let clear = rest.iter().take_while(|&&cell| cell == 0).count();
    from + zeros + words.get(zeros / 8).map_or(clear, of_word)
}

/// Adds the differences of one row to the column sums: `sums[c][k] += |left[c] - right[c + k]|`.
#[derive(Debug)]
pub struct AddRow<'a, C> {
    /// Lanes per column.
    pub lanes: usize,
    /// The row.
    pub row: RowPair<'a>,
    /// `width * lanes` sums; the lanes of a column in the order of the kernels' level.
    pub column_sums: &'a mut [C],
}

impl<C> AddRow<'_, C> {
    pub(super) fn check(&self) {
        assert!(self.lanes > 0 && self.column_sums.len() == self.row.left.len() * self.lanes, "column sums");
        self.row.check(self.row.left.len(), self.lanes);
    }
}

/// The best of a column's lanes, with its surroundings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(C)]
pub struct Choice<C> {
    /// Cost of the lane before, one more disparity; blocked if there is none.
    pub before: C,
    /// The smallest cost.
    pub best: C,
    /// Cost of the lane after, one less disparity; blocked if there is none.
    pub after: C,
    /// The first lane with the smallest cost.
    pub lane: C,
}

impl<C: Cost> Choice<C> {
    /// No candidate.
    pub const NONE: Self = Self { before: C::BLOCKED, best: C::BLOCKED, after: C::BLOCKED, lane: C::ZERO };
}

/// What is the same for every row of an image.
#[derive(Debug, Clone, Copy)]
pub struct RowShape {
    /// Columns of the image.
    pub width: usize,
    /// Costs per pixel, from [`Kernels::lanes`](super::Kernels::lanes).
    pub lanes: usize,
    /// Half the window: its side is `2 * radius + 1`.
    pub radius: usize,
    /// The largest difference of two pixels.
    pub largest_difference: u8,
    /// Percent above the best cost within which candidates are counted; 0 counts none.
    pub uniqueness_ratio: u32,
    /// For the left–right test: how far around the best lane [`SadRow::nearby`] looks.
    pub left_right_reach: Option<usize>,
}

/// One row of window sums, and what the tests need to know about them.
#[derive(Debug)]
pub struct SadRow<'a, C> {
    /// Sizes and settings.
    pub shape: RowShape,
    /// The row that enters the window.
    pub entering: RowPair<'a>,
    /// The row that leaves it.
    pub leaving: RowPair<'a>,
    /// Per left column: 0, or 255 if it has no source.
    pub blocked_left: &'a [u8],
    /// Per padded right column (indexed as [`RowPair::right`]): 0, or 255 if outside or without source.
    pub blocked_right: &'a [u8],
    /// What [`blocked_groups`] says of both.
    pub blocked_groups: &'a [u8],
    /// Per lane: 0, or 255 where it is not a disparity asked for.
    pub blocked_lanes: &'a [u8],
    /// Added to the window sums, or empty. Columns `2i` and `2i + 1` share `lanes` cells: first those of the even lanes,
    /// then those of the odd ones.
    pub coarse: &'a [u16],
    /// In: sums over the window above. Out: over this row's window. `width * lanes`.
    pub column_sums: &'a mut [C],
    /// As many cells as [`CostKernels::scratch_len`](super::CostKernels::scratch_len) says, all [`Cost::BLOCKED`]
    /// before the first row and left alone between rows.
    pub scratch: &'a mut [C],
    /// Out, per column.
    pub chosen: &'a mut [Choice<C>],
    /// Out, per column, if `uniqueness_ratio` is not 0: how many lanes cost at most
    /// `best + best * uniqueness_ratio / 100`.
    pub rivals: &'a mut [u16],
    /// Out, per column, if `left_right_reach` is set: the smallest cost among those of the same right pixel whose
    /// disparity differs by at most the reach.
    pub nearby: &'a mut [C],
    /// Out, per padded right column, if `left_right_reach` is set: the smallest cost of all its candidates.
    pub right_best: &'a mut [C],
}

impl<C> SadRow<'_, C> {
    /// Panics unless every slice has the length the shape demands: what makes unchecked kernels sound.
    pub(super) fn check(&self, scratch_len: usize) {
        let RowShape { width, lanes, left_right_reach, .. } = self.shape;
        assert!(width > 0 && lanes > 0, "an empty row");
        self.entering.check(width, lanes);
        self.leaving.check(width, lanes);
        assert!(self.blocked_left.len() == width, "blocked_left");
        assert!(self.blocked_right.len() == width + lanes - 1, "blocked_right");
        assert!(self.blocked_groups.len() == width.div_ceil(GROUP), "blocked_groups");
        assert!(self.blocked_lanes.len() == lanes, "blocked_lanes");
        assert!(self.column_sums.len() == width * lanes, "column_sums");
        assert!(self.coarse.is_empty() || self.coarse.len() == width.div_ceil(2) * lanes, "coarse");
        assert!(self.scratch.len() == scratch_len, "scratch");
        assert!(self.chosen.len() == width, "chosen");
        assert!(self.rivals.len() == width, "rivals");
        if left_right_reach.is_some() {
            assert!(self.nearby.len() == width && self.right_best.len() == width + lanes - 1, "left-right");
        }
    }
}

portable!(add_u32, reference::add_row, AddRow<'_, u32>);
portable!(sad_u32, reference::sad_row, SadRow<'_, u32>);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_bits_are_enough_exactly_where_stated() {
        for (difference, largest_block) in [(62, 31), (126, 21), (255, 15)] {
            assert!(fits_u16(difference, largest_block, 0), "{difference} {largest_block}");
            assert!(!fits_u16(difference, largest_block + 2, 0), "{difference} {}", largest_block + 2);
            let rest = 65_534 - usize::from(difference) * largest_block * largest_block;
            assert!(
                fits_u16(difference, largest_block, rest) && !fits_u16(difference, largest_block, rest + 1)
            );
        }
    }

    #[test]
    fn groups_tell_of_every_blocked_candidate() {
        let mut state = 1_u32;
        for case in 0..2000 {
            let mut next = |n: usize| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (state >> 16) as usize % n
            };
            let (width, lanes) = (1 + next(70), 16 * (1 + next(3)));
            let (mut left, mut right) = (vec![0; width], vec![0; width + lanes - 1]);
            (0..next(3)).for_each(|_| left[next(width)] = 255);
            (0..next(3)).for_each(|_| right[next(width + lanes - 1)] = 255);
            let mut groups = vec![9];
            blocked_groups(&left, &right, lanes, &mut groups);
            for (group, &blocked) in groups.iter().enumerate() {
                let mut columns = group * GROUP..((group + 1) * GROUP).min(width);
                let any = columns.any(|x| left[x] != 0 || (0..lanes).any(|k| right[x + k] != 0));
                assert_eq!(blocked, u8::from(any), "case {case}, group {group}");
            }
            assert_eq!(groups.len(), width.div_ceil(GROUP));
        }
    }

    #[test]
    fn lanes_cover_the_disparities() {
        for block in [16, 32, 64] {
            for n in 1..=1024_usize {
                let lanes = padded_lanes(n, block);
                assert!(lanes >= n && lanes.is_multiple_of(block), "{n} in {lanes}");
                assert!(lanes < 2 * n + block, "{n} in {lanes}");
            }
        }
    }
}
