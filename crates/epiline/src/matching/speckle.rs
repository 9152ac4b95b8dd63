//! Small islands of disparity.

use super::map::{DisparityMap, Validity};

/// Pixels of one row that hang together: columns `start..end`.
#[derive(Debug, Clone, Copy)]
struct Run {
    start: usize,
    end: usize,
}

/// Finds connected components of runs; its buffers are kept from frame to frame.
///
/// Two neighbours (left–right, above–below) hang together if both have a value and their disparities differ by no more
/// than a given range: the components of OpenCV's `filterSpeckles`.
#[derive(Debug, Default)]
pub(super) struct SpeckleFilter {
    runs: Vec<Run>,
    /// Index of the first run of each row, and the number of runs.
    row_starts: Vec<usize>,
    /// Per run: another run of the same island, or itself. Never a later one.
    parent: Vec<u32>,
    /// Per run that is its own parent: pixels of the island.
    pixels: Vec<u32>,
    /// Per column: whether a run ends before it.
    breaks: Vec<u8>,
}

impl SpeckleFilter {
    /// Marks islands of at most `size` pixels; disparities within `range_px` hang together.
    pub fn mark(&mut self, map: &mut DisparityMap, size: usize, range_px: u16) {
        let range = range_px.saturating_mul(DisparityMap::SCALE);
        self.find_runs(map, range);
        self.join_rows(map, range);
        for y in 0..map.height() {
            let bits = map.validity.row_mut(y);
            for index in self.row_starts[y]..self.row_starts[y + 1] {
                let island = self.root(index as u32);
                if self.pixels[island as usize] as usize <= size {
                    let Run { start, end } = self.runs[index];
                    bits[start..end].iter_mut().for_each(|bits| *bits |= Validity::SPECKLE);
                }
            }
        }
    }

    fn find_runs(&mut self, map: &DisparityMap, range: u16) {
        let width = map.width();
        self.runs.clear();
        self.row_starts.clear();
        for y in 0..map.height() {
            self.row_starts.push(self.runs.len());
            let (values, bits) = (map.values.row(y), map.validity.row(y));
            find_breaks(values, bits, range, &mut self.breaks);
            let mut start = 0;
            let mut close = |end: usize| {
                if Validity::has_value(bits[start]) {
                    self.runs.push(Run { start, end });
                }
                start = end;
            };
            // Eight columns at a time: runs are long, most words are zero.
            let (words, rest) = self.breaks.as_chunks::<8>();
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
            close(width);
        }
        self.row_starts.push(self.runs.len());
        self.parent.clear();
        self.parent.extend(0..self.runs.len() as u32);
        self.pixels.clear();
        self.pixels.extend(self.runs.iter().map(|run| (run.end - run.start) as u32));
    }

    fn join_rows(&mut self, map: &DisparityMap, range: u16) {
        for y in 1..map.height() {
            let (above, below) = (map.values.row(y - 1), map.values.row(y));
            let (first, end) = (self.row_starts[y], self.row_starts[y + 1]);
            let (mut a, mut b) = (self.row_starts[y - 1], first);
            while a < first && b < end {
                let (upper, lower) = (self.runs[a], self.runs[b]);
                let shared = upper.start.max(lower.start)..upper.end.min(lower.end);
                let touches = |(&p, &q): (&u16, &u16)| p.abs_diff(q) <= range;
                if !shared.is_empty() && above[shared.clone()].iter().zip(&below[shared]).any(touches) {
                    self.join(a as u32, b as u32);
                }
                if upper.end <= lower.end {
                    a += 1;
                } else {
                    b += 1;
                }
            }
        }
    }

    fn root(&mut self, mut run: u32) -> u32 {
        while self.parent[run as usize] != run {
            // Path halving keeps the chains short.
            let grandparent = self.parent[self.parent[run as usize] as usize];
            self.parent[run as usize] = grandparent;
            run = grandparent;
        }
        run
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        if a != b {
            let (parent, child) = (a.min(b), a.max(b));
            self.parent[child as usize] = parent;
            self.pixels[parent as usize] += self.pixels[child as usize];
        }
    }
}

/// `breaks[x]`: 1 if column `x` does not continue what column `x - 1` is, a stretch of linked values or of none.
fn find_breaks(values: &[u16], bits: &[u8], range: u16, breaks: &mut Vec<u8>) {
    breaks.clear();
    breaks.push(0);
    let pairs = values.iter().zip(&values[1..]).zip(bits.iter().zip(&bits[1..]));
    breaks.extend(pairs.map(|((&value, &next), (&bits, &next_bits))| {
        let (has, next_has) = (Validity::has_value(bits), Validity::has_value(next_bits));
        u8::from((has != next_has) | (has & (value.abs_diff(next) > range)))
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

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
        SpeckleFilter::default().mark(&mut map, size, range_px);
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
}
