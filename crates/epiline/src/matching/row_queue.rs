//! Rows taken by threads from both ends.
//!
//! Window sums and vertical paths follow from those of the row before, so a thread keeps to neighbouring rows. Where two
//! threads share rows, one going down and one going up, they meet wherever they happen to: a thread that comes late, or is
//! slowed down, only takes fewer rows. All arithmetic is exact, so it does not show where they met.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use super::map::DisparityMap;

/// The way through rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Direction {
    Down,
    Up,
}

impl Direction {
    /// Workers are paired: one goes down, the next goes up.
    pub fn of_worker(worker: usize) -> Self {
        if worker.is_multiple_of(2) { Self::Down } else { Self::Up }
    }

    /// The row that enters windows which move to row `y`, and the one that leaves them.
    pub fn entering_and_leaving(self, y: usize, radius: usize) -> (isize, isize) {
        let (y, radius) = (y as isize, radius as isize);
        match self {
            Self::Down => (y + radius, y - radius - 1),
            Self::Up => (y - radius, y + radius + 1),
        }
    }

    /// The rows of windows before they move to row `y`.
    pub fn rows_before(self, y: usize, radius: usize) -> Range<isize> {
        let (y, radius) = (y as isize, radius as isize);
        match self {
            Self::Down => y - 1 - radius..y + radius,
            Self::Up => y + 1 - radius..y + 2 + radius,
        }
    }

    /// No rows, before `y` on the way.
    pub fn empty_before(self, y: usize) -> Range<usize> {
        match self {
            Self::Down => y..y,
            Self::Up => y + 1..y + 1,
        }
    }

    /// The next row on the way after `done` that `wanted` has.
    pub fn next_after(self, done: &Range<usize>, wanted: Range<usize>) -> Option<usize> {
        match self {
            Self::Down => Some(done.end).filter(|&row| row < wanted.end),
            Self::Up => done.start.checked_sub(1).filter(|&row| row >= wanted.start),
        }
    }

    /// Rows in the order of the way.
    pub fn through(self, rows: Range<usize>) -> impl Iterator<Item = usize> {
        let (first, last) = (rows.start, rows.end.saturating_sub(1));
        rows.map(move |y| if self == Self::Down { y } else { first + last - y })
    }

    /// The row after `y` on the way.
    pub fn after(self, y: usize) -> usize {
        match self {
            Self::Down => y + 1,
            Self::Up => y.wrapping_sub(1),
        }
    }
}

/// What belongs to some neighbouring rows.
pub(super) trait Rows: Sized + Send {
    /// What belongs to the first `count` of them, and to the rest.
    fn split(self, count: usize) -> (Self, Self);
}

/// Nothing does.
impl Rows for () {
    fn split(self, _: usize) -> (Self, Self) {
        ((), ())
    }
}

/// Rows of a disparity map.
pub(super) struct MapRows<'a> {
    pub width: usize,
    pub values: &'a mut [u16],
    pub bits: &'a mut [u8],
}

impl<'a> MapRows<'a> {
    /// All of them.
    pub fn of(map: &'a mut DisparityMap) -> Self {
        let width = map.width();
        Self { width, values: map.values.as_mut_slice(), bits: map.validity.as_mut_slice() }
    }
}

impl Rows for MapRows<'_> {
    fn split(self, count: usize) -> (Self, Self) {
        let width = self.width;
        let (values, next_values) = self.values.split_at_mut(count * width);
        let (bits, next_bits) = self.bits.split_at_mut(count * width);
        (Self { width, values, bits }, Self { width, values: next_values, bits: next_bits })
    }
}

/// Rows that nobody has taken, with what belongs to them.
pub(super) struct RowQueue<R> {
    left: Mutex<(Range<usize>, Option<R>)>,
}

impl<R: Rows> RowQueue<R> {
    pub fn new(rows: Range<usize>, data: R) -> Self {
        Self { left: Mutex::new((rows, Some(data))) }
    }

    /// Stripes of `0..height` for so many workers: worker `w` takes from stripe `w / 2`.
    pub fn stripes(height: usize, workers: usize, data: R) -> Stripes<R> {
        let end = |worker: usize| height * worker.min(workers) / workers;
        let mut rest = Some(data);
        let mut stripe = |worker: usize| {
            let rows = end(worker)..end(worker + 2);
            let own;
            (own, rest) = match rest.take().map(|rest| rest.split(rows.len())) {
                Some((own, rest)) => (Some(own), Some(rest)),
                None => (None, None),
            };
            Self { left: Mutex::new((rows, own)) }
        };
        Stripes { first: stripe(0), others: (2..workers).step_by(2).map(stripe).collect() }
    }

    /// The next rows on the way, at most `count`.
    pub fn take(&self, direction: Direction, count: usize) -> Option<(Range<usize>, R)> {
        let mut left = lock(&self.left);
        let (rows, data) = &mut *left;
        let count = count.min(rows.len());
        if count == 0 {
            return None;
        }
        let (own_rows, own, rest);
        match direction {
            Direction::Down => {
                (own, rest) = data.take()?.split(count);
                own_rows = rows.start..rows.start + count;
                rows.start += count;
            }
            Direction::Up => {
                (rest, own) = data.take()?.split(rows.len() - count);
                own_rows = rows.end - count..rows.end;
                rows.end -= count;
            }
        }
        *data = Some(rest);
        Some((own_rows, own))
    }

    /// The rows that are left.
    pub fn rest(&self) -> Range<usize> {
        lock(&self.left).0.clone()
    }
}

/// Several queues. One needs no memory of its own: that is what a single thread has.
pub(super) struct Stripes<R> {
    first: RowQueue<R>,
    others: Vec<RowQueue<R>>,
}

impl<R: Rows> Stripes<R> {
    /// That of a worker.
    pub fn of_worker(&self, worker: usize) -> &RowQueue<R> {
        worker.checked_sub(2).map_or(&self.first, |worker| &self.others[worker / 2])
    }
}

/// A panic while it was locked leaves nothing that the next frame does not set up again.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_taken_once() {
        for (height, workers, count) in [(1, 1, 1), (1, 2, 4), (7, 2, 3), (100, 3, 1), (97, 8, 5)] {
            let mut map = DisparityMap::new(3, height);
            let stripes = RowQueue::stripes(height, workers, MapRows::of(&mut map));
            std::thread::scope(|scope| {
                for worker in 0..workers {
                    let stripes = &stripes;
                    scope.spawn(move || {
                        let direction = Direction::of_worker(worker);
                        while let Some((rows, own)) = stripes.of_worker(worker).take(direction, count) {
                            own.values.iter_mut().for_each(|value| *value += 1 + rows.start as u16);
                            own.bits.fill(rows.len() as u8);
                        }
                    });
                }
            });
            let mut y = 0;
            while y < height {
                let taken = usize::from(map.validity.row(y)[0]);
                assert!((1..=count).contains(&taken), "{height} rows, {workers} workers");
                for row in y..y + taken {
                    assert_eq!(map.values.row(row), [1 + y as u16; 3], "{height} rows, {workers} workers");
                }
                y += taken;
            }
        }
    }

    #[test]
    fn windows_hold_the_same_rows_either_way() {
        for (y, radius) in [(0, 0), (5, 3), (2, 7)] {
            for direction in [Direction::Down, Direction::Up] {
                let mut rows: Vec<isize> = direction.rows_before(y, radius).collect();
                let (entering, leaving) = direction.entering_and_leaving(y, radius);
                rows.retain(|&row| row != leaving);
                rows.push(entering);
                rows.sort_unstable();
                let (y, radius) = (y as isize, radius as isize);
                assert_eq!(rows, (y - radius..=y + radius).collect::<Vec<_>>(), "{direction:?} {y} {radius}");
            }
        }
    }
}
