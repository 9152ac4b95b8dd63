//! Sorting columns of pixels side by side.

use super::portable;

/// Columns sorted at once.
pub const LANES: usize = 32;

/// Sorts each lane by itself: afterwards `rows[i][lane] <= rows[i + 1][lane]`.
#[derive(Debug)]
pub struct SortColumns<'a> {
    /// Any number of rows.
    pub rows: &'a mut [[u16; LANES]],
}

/// Batcher's merge exchange (Knuth, The Art of Computer Programming 3, 5.2.2, algorithm M, whose letters these are).
///
/// Which rows are compared does not depend on what is in them: every comparison is a minimum and a maximum of all lanes.
#[inline(always)]
pub(super) fn sort_columns(columns: &mut SortColumns<'_>) {
    let rows = &mut *columns.rows;
    let largest = rows.len().next_power_of_two() / 2;
    let mut p = largest;
    while p > 0 {
        let (mut q, mut r, mut d) = (largest, 0, p);
        loop {
            // The rows `i` with `i & p == r`: every second stretch of p.
            for first in (r..rows.len() - d).step_by(2 * p) {
                let length = p.min(rows.len() - d - first);
                exchange(&mut rows[first..first + length + d], length, d);
            }
            if q == p {
                break;
            }
            (d, r) = (q - p, p);
            q /= 2;
        }
        p /= 2;
    }
}

/// Puts each of the first `length` rows and the one `d` below it in order; `length <= d`.
#[inline(always)]
fn exchange(rows: &mut [[u16; LANES]], length: usize, d: usize) {
    let (above, below) = rows.split_at_mut(d);
    for (above, below) in above[..length].iter_mut().zip(below) {
        for (less, more) in above.iter_mut().zip(below) {
            (*less, *more) = ((*less).min(*more), (*less).max(*more));
        }
    }
}

portable!(columns, sort_columns, SortColumns<'_>);
