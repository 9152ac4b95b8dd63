//! How many threads, and which rows each takes.

use std::ops::Range;

use crate::error::{Error, Result};

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
