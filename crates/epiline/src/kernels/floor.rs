//! A row of disparities against the floor: where the floor goes on, and what stands on it.

use super::portable;

const MOST_AHEAD: f32 = 1e6;

/// A value that changes linearly along a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linear {
    /// At the first element.
    pub at_first: f32,
    /// More for each element on.
    pub per_place: f32,
}

impl Linear {
    /// The same value everywhere.
    pub const fn constant(value: f32) -> Self {
        Self { at_first: value, per_place: 0.0 }
    }

    /// So many times as much.
    pub fn times(self, factor: f32) -> Self {
        Self { at_first: factor * self.at_first, per_place: factor * self.per_place }
    }

    #[inline(always)]
    fn at(self, place: f32) -> f32 {
        self.at_first + self.per_place * place
    }
}

/// Follows the floor and picks out obstacles, disparities in sixteenths of a pixel counted from infinity.
///
/// ```text
/// seen = raw + doffs                                where bits are 0
/// floor:     below <= seen < low·ground, where low·ground exceeds the ground by at least the noise
/// goes on:   floor, and row >= next_row             -> last_row = row, next_row = row - hidden
/// obstacle:  low·ground <= seen, ground + noise <= seen, least <= seen <= most -> ahead = seen·per_forward, rounded,
///            where 0 < seen·per_forward <= largest_ahead
/// ```
#[derive(Debug)]
pub struct FloorRow<'a> {
    /// Disparities as stored.
    pub raws: &'a [u16],
    /// Not zero where a disparity was not measured.
    pub bits: &'a [u8],
    /// 0, 1, 2 … as numbers.
    pub places: &'a [f32],
    /// Added to disparities.
    pub doffs_raw: f32,
    /// Disparity of the floor.
    pub ground: Linear,
    /// From here on, as a multiple of `ground`, something is too high to be the floor.
    pub low: f32,
    /// Down to here, as a multiple of `ground`, something is not too low to be the floor.
    pub below: f32,
    /// What disparities may differ by though nothing is there.
    pub noise_raw: f32,
    /// Least and most disparity of an obstacle, besides.
    pub least: Linear,
    /// See `least`.
    pub most: Linear,
    /// Disparity by distance ahead instead of depth, as a multiple.
    pub per_forward: Linear,
    /// Obstacles whose disparity ahead exceeds this are none.
    pub largest_ahead: f32,
    /// Number of the row, or minus infinity where there is no floor to follow.
    pub row: f32,
    /// Rows that the next gap may have.
    pub hidden: Linear,
    /// Row that the floor was seen in last; in and out, as the next three.
    pub last_row: &'a mut [f32],
    /// Disparity there, the floor's at least.
    pub last_raw: &'a mut [f32],
    /// The floor goes on only if it is seen by this row.
    pub next_row: &'a mut [f32],
    /// Disparity ahead of an obstacle, or -1. Out only.
    pub ahead: &'a mut [i32],
}

impl FloorRow<'_> {
    pub(super) fn check(&self) {
        let len = self.raws.len();
        let floats = [self.places.len(), self.last_row.len(), self.last_raw.len(), self.next_row.len()];
        assert!(
            floats.iter().all(|&l| l == len) && self.bits.len() == len && self.ahead.len() == len,
            "lengths"
        );
    }
}

#[inline(always)]
pub(super) fn floor_row(row: &mut FloorRow<'_>) {
    let len = row.raws.len();
    // One length for all lets the compiler leave bounds checks out.
    let (raws, bits, places) = (&row.raws[..len], &row.bits[..len], &row.places[..len]);
    let (last_row, last_raw) = (&mut row.last_row[..len], &mut row.last_raw[..len]);
    let (next_row, aheads) = (&mut row.next_row[..len], &mut row.ahead[..len]);
    for i in 0..len {
        let place = places[i];
        let is_measured = bits[i] == 0;
        let seen = f32::from(raws[i]) + row.doffs_raw;
        let ground = row.ground.at(place);
        let low = ground * row.low;
        let lowest = -larger(-ground * row.below, row.noise_raw - ground);
        let is_floor = is_measured & (seen < low) & (seen >= lowest) & (low - ground >= row.noise_raw);
        let goes_on = is_floor & (row.row >= next_row[i]);
        last_row[i] = if goes_on { row.row } else { last_row[i] };
        last_raw[i] = if goes_on { larger(seen, ground) } else { last_raw[i] };
        next_row[i] = if goes_on { row.row - row.hidden.at(place) } else { next_row[i] };
        let ahead = seen * row.per_forward.at(place);
        let is_obstacle = is_measured
            & (seen >= low)
            & (seen >= ground + row.noise_raw)
            & (seen >= row.least.at(place))
            & (seen <= row.most.at(place))
            & (ahead > 0.0)
            & (ahead <= row.largest_ahead);
        aheads[i] = rounded_or_none(ahead, is_obstacle);
    }
}

/// A disparity ahead in whole sixteenths, at most a million of them, or -1.
#[inline(always)]
pub(crate) fn rounded_or_none(ahead: f32, is_obstacle: bool) -> i32 {
    let value = if is_obstacle { ahead + 0.5 } else { -1.0 };
    let value = if value < MOST_AHEAD { value } else { MOST_AHEAD };
    let value = if value > -1.0 { value } else { -1.0 };
    // SAFETY: between -1 and a million. `as` would ask each lane by itself whether it is out of range.
    unsafe { value.to_int_unchecked() }
}

/// `f32::max` without its care for NaN, which costs instructions.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

portable!(row, floor_row, FloorRow<'_>);
