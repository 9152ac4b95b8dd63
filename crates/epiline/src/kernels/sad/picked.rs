//! Which of two neighbouring lanes is best, and what lies around it, for many pixels at once.

#![expect(
    clippy::needless_range_loop,
    reason = "iterator adaptors do not inherit the instruction set, loops do"
)]

use super::{Choice, Cost, GROUP};

/// Pixels at a time of what is decided for many at once, a batch after their costs are computed.
pub(super) const BATCH: usize = GROUP;

/// Numbers assembled by [`choose`] as what they stand for.
#[inline(always)]
pub(super) fn as_choices(mut choices: [u64; BATCH]) -> [Choice<u16>; BATCH] {
    for i in 0..BATCH {
        choices[i] = choices[i].to_le();
    }
    // SAFETY: a choice is four 16-bit numbers in the layout of C, the first in the lowest bits.
    unsafe { std::mem::transmute(choices) }
}

/// Copies a batch that may be cut short.
#[inline(always)]
pub(super) fn put<T: Copy>(batch: &[T; BATCH], to: &mut [T]) {
    if let Ok(to) = <&mut [T; BATCH]>::try_from(&mut *to) {
        *to = *batch;
    } else {
        to.copy_from_slice(&batch[..to.len()]);
    }
}

/// Where the best costs of two batches are, and the costs around them; what belongs to column `x` lies at `x` modulo
/// their length.
pub(super) struct Picked {
    /// Half of the best lane, rounded down.
    pub(super) at: [u16; 2 * BATCH],
    /// What [`SplitLanes::pick`] gives for it.
    pub(super) costs: [u64; 2 * BATCH],
    /// The same lanes of column `x - 1`, where the right pixels opposite `x` have larger disparities.
    pub(super) larger: [u64; 2 * BATCH],
    /// The same lanes of column `x + 1`, where they have smaller ones.
    pub(super) smaller: [u64; 2 * BATCH],
}

impl Default for Picked {
    fn default() -> Self {
        let none = [u64::MAX; 2 * BATCH];
        Self { at: [0; 2 * BATCH], costs: none, larger: none, smaller: none }
    }
}

/// The costs of a batch from those of two.
#[inline(always)]
fn batch_of<T: Copy>(both: &[T; 2 * BATCH], first: usize) -> &[T; BATCH] {
    &both.as_chunks().0[first / BATCH % 2]
}

impl Picked {
    /// Decides between the even and the odd lane; see [`choose`].
    #[inline(always)]
    pub(super) fn choose(&self, lanes: usize, first: usize) -> [u64; BATCH] {
        let (at, costs) = (batch_of(&self.at, first), batch_of(&self.costs, first));
        let mut choices = [0; BATCH];
        for i in 0..BATCH {
            choices[i] = choose(costs[i], at[i], lanes);
        }
        choices
    }

    /// See [`SadRow::nearby`].
    #[inline(always)]
    pub(super) fn nearby(
        &self,
        lanes: usize,
        first: usize,
        reach: usize,
        choices: &[u64; BATCH],
    ) -> [u16; BATCH] {
        let (larger, smaller) = (batch_of(&self.larger, first), batch_of(&self.smaller, first));
        // Nothing is near at a reach of 0.
        let none = if reach == 0 { BLOCKED } else { 0 };
        let mut nearby = [0; BATCH];
        for i in 0..BATCH {
            let (best, lane) = (choices[i] >> 16 & BLOCKED, choices[i] >> 48);
            let shift = 16 * (lane & 1);
            // One lane up in the column before, one down in the column after.
            let up = larger[i] >> (32 + shift) & BLOCKED;
            let down = smaller[i] >> shift & BLOCKED;
            let up = if lane + 1 == lanes as u64 { BLOCKED } else { up | none };
            let down = if lane == 0 { BLOCKED } else { down | none };
            let other = if up < down { up } else { down };
            nearby[i] = if other < best { other } else { best } as u16;
        }
        nearby
    }
}

/// A blocked cost among others.
const BLOCKED: u64 = u16::BLOCKED as u64;

/// The [`Choice`] among lanes `2 * at` and `2 * at + 1`, given their costs and those beside them; lowest bits first.
#[inline(always)]
fn choose(costs: u64, at: u16, lanes: usize) -> u64 {
    let (even, odd) = (costs >> 16 & BLOCKED, costs >> 32 & BLOCKED);
    // Of equal costs, the first lane's.
    let is_odd = u64::from(odd < even);
    let lane = 2 * u64::from(at) + is_odd;
    let around = costs >> (16 * is_odd) & 0x0000_FFFF_FFFF_FFFF;
    let before = if lane == 0 { BLOCKED } else { 0 };
    let after = if lane + 1 == lanes as u64 { BLOCKED << 32 } else { 0 };
    around | before | after | lane << 48
}
