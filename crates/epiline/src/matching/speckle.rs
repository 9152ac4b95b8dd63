//! Small islands of disparity.

use std::ops::Range;

use super::crew::Crew;
use super::map::{DisparityMap, Validity};
use super::threads::stripes;
use crate::kernels::Kernels;
use crate::kernels::islands::BreaksRow;

/// Pixels of one row that hang together: columns `start..end`.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: usize,
    end: usize,
}

/// Islands as trees of runs.
#[derive(Debug, Default)]
struct Forest {
    /// Per run: another run of the same island, or itself. Never a later one.
    parent: Vec<u32>,
    /// Per run that is its own parent: pixels of the island.
    pixels: Vec<u32>,
}

impl Forest {
    fn clear(&mut self) {
        self.parent.clear();
        self.pixels.clear();
    }

    /// An island of one run.
    fn plant(&mut self, run: Run) {
        self.parent.push(self.parent.len() as u32);
        self.pixels.push((run.end - run.start) as u32);
    }

    /// Adds islands whose runs follow all others.
    fn append(&mut self, other: &Self) {
        let first = self.parent.len() as u32;
        self.parent.extend(other.parent.iter().map(|parent| parent + first));
        self.pixels.extend_from_slice(&other.pixels);
    }

    fn root(&self, mut run: u32) -> u32 {
        while self.parent[run as usize] != run {
            run = self.parent[run as usize];
        }
        run
    }

    /// The same, and halves the way there, so that chains stay short.
    fn find(&mut self, mut run: u32) -> u32 {
        while self.parent[run as usize] != run {
            let grandparent = self.parent[self.parent[run as usize] as usize];
            self.parent[run as usize] = grandparent;
            run = grandparent;
        }
        run
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        if a != b {
            let (parent, child) = (a.min(b), a.max(b));
            self.parent[child as usize] = parent;
            self.pixels[parent as usize] += self.pixels[child as usize];
        }
    }
}

/// The runs of a stripe of rows, and how they hang together within it.
#[derive(Debug, Default)]
struct StripeRuns {
    runs: Vec<Run>,
    /// Index of the first run of each row, and the number of runs.
    row_starts: Vec<usize>,
    forest: Forest,
    /// Per column: whether a run ends before it.
    breaks: Vec<u8>,
}

impl StripeRuns {
    fn find(&mut self, kernels: &Kernels, map: &DisparityMap, rows: Range<usize>, range: u16) {
        self.runs.clear();
        self.row_starts.clear();
        self.row_starts.push(0);
        self.forest.clear();
        for y in rows.clone() {
            let first = self.runs.len();
            self.find_row(kernels, map.values.row(y), map.validity.row(y), range);
            self.runs[first..].iter().for_each(|&run| self.forest.plant(run));
            self.row_starts.push(self.runs.len());
            if y > rows.start {
                let row = y - rows.start;
                let (above, first) = (self.row_starts[row - 1], self.row_starts[row]);
                let (upper, lower) = (&self.runs[above..first], &self.runs[first..]);
                each_touching(upper, lower, map.values.row(y - 1), map.values.row(y), range, |a, b| {
                    self.forest.join((above + a) as u32, (first + b) as u32);
                });
            }
        }
    }

    /// Adds the runs of one row.
    fn find_row(&mut self, kernels: &Kernels, values: &[u16], bits: &[u8], range: u16) {
        let Self { runs, breaks, .. } = self;
        breaks.resize(values.len(), 0);
        kernels.breaks(&mut BreaksRow { values, bits, except: !Validity::FILLED, range, breaks });
        let mut start = 0;
        let mut close = |end: usize| {
            if Validity::has_value(bits[start]) {
                runs.push(Run { start, end });
            }
            start = end;
        };
        // Eight columns at a time: runs are long, most words are zero.
        let (words, rest) = breaks.as_chunks::<8>();
        for (i, word) in words.iter().enumerate() {
            let mut word = u64::from_le_bytes(*word);
            while word != 0 {
                close(8 * i + word.trailing_zeros() as usize / 8);
                word &= word - 1;
            }
        }
        for (i, _) in rest.iter().enumerate().filter(|&(_, &is_break)| is_break != 0) {
            close(8 * words.len() + i);
        }
        close(values.len());
    }

    /// Indices of a row's runs.
    fn row(&self, row: usize) -> Range<usize> {
        self.row_starts[row]..self.row_starts[row + 1]
    }

    /// Marks the runs of small islands; the stripe's first run is number `first` in the whole forest.
    fn mark(&self, forest: &Forest, first: usize, size: usize, width: usize, bits: &mut [u8]) {
        for (row, bits) in bits.chunks_exact_mut(width).enumerate() {
            for index in self.row(row) {
                let island = forest.root((first + index) as u32);
                if forest.pixels[island as usize] as usize <= size {
                    let Run { start, end } = self.runs[index];
                    bits[start..end].iter_mut().for_each(|bits| *bits |= Validity::SPECKLE);
                }
            }
        }
    }
}

/// Calls `join` with the numbers of runs of neighbouring rows that hang together.
fn each_touching(
    upper: &[Run],
    lower: &[Run],
    above: &[u16],
    below: &[u16],
    range: u16,
    mut join: impl FnMut(usize, usize),
) {
    let (mut a, mut b) = (0, 0);
    while a < upper.len() && b < lower.len() {
        let (from, to) = (upper[a], lower[b]);
        let shared = from.start.max(to.start)..from.end.min(to.end);
        let touches = |(&p, &q): (&u16, &u16)| p.abs_diff(q) <= range;
        if !shared.is_empty() && above[shared.clone()].iter().zip(&below[shared]).any(touches) {
            join(a, b);
        }
        if from.end <= to.end {
            a += 1;
        } else {
            b += 1;
        }
    }
}

/// Finds connected components of runs; its buffers are kept from frame to frame.
///
/// Two neighbours (left–right, above–below) hang together if both have a value and their disparities differ by no more
/// than a given range: the components of OpenCV's `filterSpeckles`. Every thread joins the runs of a stripe of rows; what
/// touches across the seams is joined afterwards. The islands do not depend on where the seams are.
#[derive(Debug, Default)]
pub(super) struct SpeckleFilter {
    stripes: Vec<StripeRuns>,
    forest: Forest,
}

impl SpeckleFilter {
    /// Marks islands of at most `size` pixels among some rows; disparities within `range_px` hang together.
    pub fn mark(
        &mut self,
        kernels: &Kernels,
        crew: &Crew,
        map: &mut DisparityMap,
        rows: Range<usize>,
        size: usize,
        range_px: u16,
    ) {
        let width = map.width();
        let range = range_px.saturating_mul(DisparityMap::SCALE);
        let first_row = rows.start;
        let stripes = || {
            let stripes = stripes(rows.len(), crew.size());
            stripes.map(|rows| first_row + rows.start..first_row + rows.end)
        };
        self.stripes.resize_with(stripes().count(), StripeRuns::default);
        let whole = &*map;
        crew.run_all(
            stripes()
                .zip(&mut self.stripes)
                .map(|(rows, stripe)| move || stripe.find(kernels, whole, rows, range)),
        );
        self.join_stripes(whole, range, stripes().map(|rows| rows.end));

        let forest = &self.forest;
        let (mut bits, mut first) = (&mut map.validity.as_mut_slice()[first_row * width..], 0);
        crew.run_all(stripes().zip(&self.stripes).map(|(rows, stripe)| {
            let own;
            (own, bits) = std::mem::take(&mut bits).split_at_mut(rows.len() * width);
            let own_first = first;
            first += stripe.runs.len();
            move || stripe.mark(forest, own_first, size, width, own)
        }));
    }

    /// Makes one forest of those of the stripes, which end before the rows `ends`.
    fn join_stripes(&mut self, map: &DisparityMap, range: u16, ends: impl Iterator<Item = usize>) {
        self.forest.clear();
        let mut before: Option<&StripeRuns> = None;
        let mut seam = 0;
        for (stripe, end) in self.stripes.iter().zip(ends) {
            let first = self.forest.parent.len();
            self.forest.append(&stripe.forest);
            if let Some(before) = before {
                let last = before.row(before.row_starts.len() - 2);
                let (upper, lower) = (&before.runs[last.clone()], &stripe.runs[stripe.row(0)]);
                let above = first - last.len();
                let (over, under) = (map.values.row(seam - 1), map.values.row(seam));
                each_touching(upper, lower, over, under, range, |a, b| {
                    self.forest.join((above + a) as u32, (first + b) as u32);
                });
            }
            (before, seam) = (Some(stripe), end);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kernels::Level;

    fn map(rows: &[&str]) -> DisparityMap {
        let mut map = DisparityMap::new(rows[0].len(), rows.len());
        for (y, row) in rows.iter().enumerate() {
            for (x, letter) in row.bytes().enumerate() {
                let value = letter.checked_sub(b'0');
                map.values.row_mut(y)[x] = u16::from(value.unwrap_or(0)) * 16;
                map.validity.row_mut(y)[x] = if letter == b'.' { Validity::NO_SOURCE } else { 0 };
            }
        }
        map
    }

    fn speckles(rows: &[&str], size: usize, range_px: u16) -> Vec<String> {
        let mut map = map(rows);
        let kernels = Kernels::new(Level::SCALAR);
        Crew::assemble(1, |crew| {
            SpeckleFilter::default().mark(&kernels, crew, &mut map, 0..rows.len(), size, range_px)
        });
        let show = |&bits: &u8| if bits & Validity::SPECKLE != 0 { 's' } else { '-' };
        (0..map.height()).map(|y| map.validity.row(y).iter().map(show).collect()).collect()
    }

    #[test]
    fn islands_bend_around_and_diagonals_do_not_connect() {
        let rows = ["5.555", "5.5.5", "555.5", "...5.", "9.5.."];
        assert_eq!(speckles(&rows, 1, 0), ["-----", "-----", "-----", "---s-", "s-s--"]);
        assert_eq!(speckles(&rows, 10, 0), ["-----", "-----", "-----", "---s-", "s-s--"]);
        assert_eq!(speckles(&rows, 11, 0), ["s-sss", "s-s-s", "sss-s", "---s-", "s-s--"]);
    }

    #[test]
    fn disparities_within_the_range_hang_together() {
        let rows = ["0123456789"];
        assert_eq!(speckles(&rows, 9, 1), ["----------"]);
        assert_eq!(speckles(&rows, 9, 0), ["ssssssssss"]);
    }

    #[test]
    fn an_empty_map_has_no_islands() {
        assert_eq!(speckles(&["..", ".."], 100, 1), ["--", "--"]);
    }

    /// Islands wind through every seam, and threads must not show.
    #[test]
    fn seams_of_stripes_do_not_show() {
        let (width, height) = (53, 231);
        let mut state = 7_u32;
        let mut scene = DisparityMap::new(width, height);
        for (value, bits) in scene.values.as_mut_slice().iter_mut().zip(scene.validity.as_mut_slice()) {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *value = if (state >> 20) % 16 < 10 { 160 } else { 320 };
            *bits = if state >> 28 == 0 { Validity::LOW_TEXTURE } else { 0 };
        }
        for kernels in Level::available().map(Kernels::new) {
            let of = |threads: usize| {
                let mut map = scene.clone();
                Crew::assemble(threads, |crew| {
                    SpeckleFilter::default().mark(&kernels, crew, &mut map, 0..height, 30, 0);
                });
                map
            };
            let alone = of(1);
            let marked = alone.validity.as_slice().iter().filter(|&&bits| bits & Validity::SPECKLE != 0);
            assert!((500..width * height - 500).contains(&marked.count()), "some islands are small");
            (2..9).for_each(|threads| assert!(of(threads) == alone, "{threads} threads"));
        }
    }
}
