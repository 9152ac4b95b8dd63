//! An answer everywhere: what is missing is taken from the background, and single outliers are removed.

use super::crew::Crew;
use super::edges::EdgeSharpener;
use super::map::{DisparityMap, Validity};
use super::threads::share_rows;
use crate::image::{Image, ImageRef};

/// Fills maps; its buffers are kept from frame to frame.
#[derive(Debug, Default)]
pub(super) struct Filler {
    filled: Image<u16>,
    sharpener: EdgeSharpener,
}

impl Filler {
    /// Gives every pixel without a value the smaller of its row's nearest values to the left and to the right: what one
    /// camera does not see lies behind what hides it. Rows without any value take the row above, the first ones the
    /// first row that has one; a map without any value stays as it is. Filled pixels are [`Validity::FILLED`] and lose
    /// the reasons why they had none.
    ///
    /// Then a median over 3x3 pixels, the border repeated; and steps of disparity are drawn to the edges of the image
    /// `guide`, which has the map's size.
    pub fn fill(&mut self, crew: &Crew, map: &mut DisparityMap, guide: ImageRef<'_, u8>) {
        let (width, height) = (map.width(), map.height());
        let Self { filled, sharpener } = self;
        share_rows(crew, &mut map.values, &mut map.validity, |_, values, bits| {
            values
                .chunks_exact_mut(width)
                .zip(bits.chunks_exact_mut(width))
                .for_each(|(values, bits)| fill_row(values, bits));
        });
        let is_filled = |map: &DisparityMap, y: usize| Validity::has_value(map.validity.row(y)[0]);
        let Some(first) = (0..height).find(|&y| is_filled(map, y)) else {
            return;
        };
        for y in (0..first).rev() {
            copy_row(map, y + 1, y);
        }
        for y in first + 1..height {
            if !is_filled(map, y) {
                copy_row(map, y - 1, y);
            }
        }
        filled.resize(width, height);
        filled.as_mut_slice().copy_from_slice(map.values.as_slice());
        share_rows(crew, &mut map.values, &mut map.validity, |rows, values, _| {
            for (y, values) in rows.zip(values.chunks_exact_mut(width)) {
                let around = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|y| filled.row(y));
                median_row(around, values);
            }
        });
        sharpener.sharpen(crew, map, guide);
    }
}

/// Fills a row from its own values, if it has any.
fn fill_row(values: &mut [u16], bits: &mut [u8]) {
    let mut nearest_left = None;
    let mut x = 0;
    while x < values.len() {
        if Validity::has_value(bits[x]) {
            nearest_left = Some(values[x]);
            x += 1;
            continue;
        }
        let end = bits[x..].iter().position(|&bits| Validity::has_value(bits)).map(|len| x + len);
        let nearest_right = end.map(|end| values[end]);
        let Some(value) = nearest_left.into_iter().chain(nearest_right).min() else {
            return;
        };
        let end = end.unwrap_or(values.len());
        values[x..end].fill(value);
        bits[x..end].fill(Validity::FILLED);
        x = end;
    }
}

fn copy_row(map: &mut DisparityMap, from: usize, to: usize) {
    let width = map.width();
    map.values.as_mut_slice().copy_within(from * width..(from + 1) * width, to * width);
    map.validity.row_mut(to).fill(Validity::FILLED);
}

/// The middle of three.
fn middle([a, b, c]: [u16; 3]) -> u16 {
    a.min(b).max(a.max(b).min(c))
}

/// Medians of 3x3 values. The median of nine is the middle of: the largest of the columns' smallest, the middle of their
/// middles, the smallest of their largest (Paeth, Graphics Gems, 1990).
fn median_row(rows: [&[u16]; 3], median: &mut [u16]) {
    let last = median.len() - 1;
    let sorted = |x: usize| {
        let [a, b, c] = rows.map(|row| row[x]);
        [a.min(b).min(c), middle([a, b, c]), a.max(b).max(c)]
    };
    let mut columns = [sorted(0), sorted(0), sorted(last.min(1))];
    for (x, median) in median.iter_mut().enumerate() {
        let [smallest, middles, largest] = [0, 1, 2].map(|i| columns.map(|column| column[i]));
        *median = middle([
            smallest.into_iter().fold(0, u16::max),
            middle(middles),
            largest.into_iter().fold(u16::MAX, u16::min),
        ]);
        columns = [columns[1], columns[2], sorted((x + 2).min(last))];
    }
}
