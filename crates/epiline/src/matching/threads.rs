//! Which rows each job takes.

use std::ops::Range;

use super::crew::Crew;
use crate::image::Image;

/// Fewer rows than this are not worth a job.
const MIN_ROWS: usize = 16;

/// The rows of each of at most `jobs` stripes, as even as possible.
pub(super) fn stripes(height: usize, jobs: usize) -> impl ExactSizeIterator<Item = Range<usize>> {
    let count = jobs.min(height.div_ceil(MIN_ROWS));
    (0..count).map(move |i| height * i / count..height * (i + 1) / count)
}

/// How many jobs a stage is cut into that can be cut anywhere: some are done while a helper is still on its way.
pub(super) fn jobs_for(crew: &Crew) -> usize {
    if crew.size() == 1 { 1 } else { 4 * crew.size() }
}

/// Runs a job per stripe of an image's rows, each with its own part of two images of that height.
pub(super) fn share_rows<A, B>(
    crew: &Crew,
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
    crew.run_all(stripes(height, jobs_for(crew)).map(|rows| {
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
            for jobs in [1, 2, 3, 7, 64] {
                let rows: Vec<usize> = stripes(height, jobs).flatten().collect();
                assert_eq!(rows, (0..height).collect::<Vec<_>>(), "{height} rows, {jobs} jobs");
                assert!(stripes(height, jobs).count() <= jobs);
            }
        }
    }
}
