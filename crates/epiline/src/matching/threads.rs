//! How many threads, and which rows each takes.

use std::ops::Range;

use crate::error::{Error, Result};
use crate::image::Image;

/// The environment variable that caps the number of threads.
const CAP: &str = "EPILINE_THREADS";

/// Threads to use: those asked for or all cores, capped by `EPILINE_THREADS`.
///
/// Fails if the variable is set to something other than a positive whole number.
pub(super) fn thread_count(asked: Option<usize>) -> Result<usize> {
    let all = || std::thread::available_parallelism().map_or(1, usize::from);
    let cap = match std::env::var(CAP) {
        Err(_) => usize::MAX,
        Ok(value) => value
            .trim()
            .parse()
            .ok()
            .filter(|&cap| cap > 0)
            .ok_or_else(|| Error::invalid(CAP, value, "must be a positive whole number, or unset"))?,
    };
    Ok(asked.unwrap_or_else(all).min(cap))
}

/// Fewer rows than this are not worth a thread: a window's rows must be summed before the first.
const MIN_ROWS: usize = 32;

/// The rows of each of at most `threads` stripes, as even as possible.
pub(super) fn stripes(height: usize, threads: usize) -> impl ExactSizeIterator<Item = Range<usize>> {
    let count = threads.min(height.div_ceil(MIN_ROWS));
    (0..count).map(move |i| height * i / count..height * (i + 1) / count)
}

/// Runs the jobs at the same time, the first on this thread.
pub(super) fn run_all(mut jobs: impl Iterator<Item = impl FnOnce() + Send>) {
    let Some(own) = jobs.next() else { return };
    let mut others = jobs.peekable();
    if others.peek().is_none() {
        own();
        return;
    }
    rayon::in_place_scope(|scope| {
        others.for_each(|job| scope.spawn(move |_| job()));
        own();
    });
}

/// Runs a job per stripe of an image's rows, each with its own part of two images of that height.
pub(super) fn share_rows<A, B>(
    threads: usize,
    first: &mut Image<A>,
    second: &mut Image<B>,
    job: impl Fn(Range<usize>, &mut [A], &mut [B]) + Sync,
) where
    A: Copy + Default + Send,
    B: Copy + Default + Send,
{
    let (height, widths) = (first.height(), [first.width(), second.width()]);
    let (mut first, mut second) = (first.as_mut_slice(), second.as_mut_slice());
    let job = &job;
    run_all(stripes(height, threads).map(|rows| {
        let (own_first, own_second);
        (own_first, first) = std::mem::take(&mut first).split_at_mut(rows.len() * widths[0]);
        (own_second, second) = std::mem::take(&mut second).split_at_mut(rows.len() * widths[1]);
        move || job(rows, own_first, own_second)
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stripes_cover_every_row_once() {
        for height in [1, 2, 31, 33, 64, 97, 1080] {
            for threads in [1, 2, 3, 7, 64] {
                let rows: Vec<usize> = stripes(height, threads).flatten().collect();
                assert_eq!(rows, (0..height).collect::<Vec<_>>(), "{height} rows, {threads} threads");
                assert!(stripes(height, threads).count() <= threads);
            }
        }
    }
}
