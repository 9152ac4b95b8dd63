//! Steps of disparity drawn to where the image has its edges.

use super::crew::Crew;
use super::map::{DisparityMap, Validity};
use super::threads::share_rows;
use crate::image::{Image, ImageRef};

/// Steps between neighbours larger than this are edges, 1/16 px.
const STEP: u16 = DisparityMap::SCALE;
/// Offsets of the samples, in rows and in columns.
const OFFSETS: [isize; 3] = [-4, 0, 4];
const SAMPLES: usize = OFFSETS.len() * OFFSETS.len();
/// How fast a sample's weight falls with the difference of grey values.
const CONTRAST: f64 = 12.0;
/// The weight of an equal grey value. All samples together weigh less than 2¹⁶.
const LARGEST_WEIGHT: f64 = 1024.0;
/// Pairs to compare, and exchange, so that nine numbers are in order: a sorting network has no branches to mispredict.
#[rustfmt::skip]
const NETWORK: [(usize, usize); 25] = [
    (0, 3), (1, 7), (2, 5), (4, 8), (0, 7), (2, 4), (3, 8), (5, 6), (0, 2), (1, 3), (4, 5), (7, 8), (1, 4),
    (3, 6), (5, 7), (0, 1), (2, 4), (3, 5), (6, 8), (2, 3), (4, 5), (6, 7), (1, 2), (3, 4), (5, 6),
];

/// Sharpens filled maps; its buffers are kept from frame to frame.
#[derive(Debug)]
pub(super) struct EdgeSharpener {
    before: Image<u16>,
    /// Per pixel: whether it or one beside it is an edge or was filled.
    uncertain: Image<u8>,
    /// The same, of the pixel only; then of the rows beside it too.
    marks: Image<u8>,
    /// By the difference of grey values.
    weights: [u16; 256],
}

impl Default for EdgeSharpener {
    fn default() -> Self {
        let weight =
            |difference: usize| (LARGEST_WEIGHT * (-(difference as f64) / CONTRAST).exp()).round() as u16;
        Self {
            before: Image::default(),
            uncertain: Image::default(),
            marks: Image::default(),
            weights: std::array::from_fn(weight),
        }
    }
}

impl EdgeSharpener {
    /// At every pixel that was filled or lies at a step of disparity, and at those around it, takes the weighted median
    /// of 3x3 samples over 9x9 pixels, weighted by `exp(-|ΔI| / 12)`: the value of the surface it looks like. Where
    /// the samples differ by no more than a pixel, the value stays. The image's border is repeated; every pixel of the
    /// map has a value.
    pub fn sharpen(&mut self, crew: &Crew, map: &mut DisparityMap, guide: ImageRef<'_, u8>) {
        let (width, height) = (map.width(), map.height());
        let Self { before, uncertain, marks, weights } = self;
        before.resize(width, height);
        before.as_mut_slice().copy_from_slice(map.values.as_slice());
        uncertain.resize(width, height);
        marks.resize(width, height);
        let whole = &*map;
        share_rows(crew, uncertain, marks, |rows, uncertain, marks| {
            let both = uncertain.chunks_exact_mut(width).zip(marks.chunks_exact_mut(width));
            rows.zip(both).for_each(|(y, (uncertain, marks))| mark(whole, y, uncertain, marks));
        });
        let (before, uncertain, weights) = (&*before, &*uncertain, &*weights);
        share_rows(crew, &mut map.values, marks, |rows, values, marks| {
            let both = values.chunks_exact_mut(width).zip(marks.chunks_exact_mut(width));
            for (y, (sharpened, marks)) in rows.zip(both) {
                let around = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|y| uncertain.row(y));
                for (mark, ((a, b), c)) in
                    marks.iter_mut().zip(around[0].iter().zip(around[1]).zip(around[2]))
                {
                    *mark = a | b | c;
                }
                let sources = OFFSETS.map(|offset| y.saturating_add_signed(offset).min(height - 1));
                let (values, greys) = (sources.map(|y| before.row(y)), sources.map(|y| guide.row(y)));
                for (first, marks) in (0..width).step_by(8).zip(marks.chunks(8)) {
                    // Surfaces are larger than edges are long: most groups have no mark.
                    if marks.iter().all(|&mark| mark == 0) {
                        continue;
                    }
                    for x in (first..).zip(marks).filter(|&(_, &mark)| mark != 0).map(|(x, _)| x) {
                        if let Some(value) = weighted_median(weights, values, greys, x) {
                            sharpened[x] = value;
                        }
                    }
                }
            }
        });
    }
}

/// Finds what is uncertain in a row; `marks` is of the pixels only.
fn mark(map: &DisparityMap, y: usize, uncertain: &mut [u8], marks: &mut [u8]) {
    let row = map.values.row(y);
    for (mark, bits) in marks.iter_mut().zip(map.validity.row(y)) {
        *mark = u8::from(bits & Validity::FILLED != 0);
    }
    for other in [y.saturating_sub(1), (y + 1).min(map.height() - 1)] {
        mark_steps(row, map.values.row(other), marks);
    }
    let last = row.len() - 1;
    mark_steps(&row[1..], &row[..last], &mut marks[1..]);
    mark_steps(&row[..last], &row[1..], &mut marks[..last]);
    uncertain.copy_from_slice(marks);
    uncertain[1..].iter_mut().zip(&marks[..last]).for_each(|(mark, before)| *mark |= before);
    uncertain[..last].iter_mut().zip(&marks[1..]).for_each(|(mark, after)| *mark |= after);
}

fn mark_steps(values: &[u16], others: &[u16], marks: &mut [u8]) {
    for ((mark, &a), &b) in marks.iter_mut().zip(values).zip(others) {
        *mark |= u8::from(a.abs_diff(b) > STEP);
    }
}

/// The smallest sample that, with those below it, has half the weight; `None` if samples hardly differ. `values` and
/// `greys` are the samples' rows; the middle one is the pixel's.
fn weighted_median(weights: &[u16; 256], values: [&[u16]; 3], greys: [&[u8]; 3], x: usize) -> Option<u16> {
    let last = values[0].len() - 1;
    let columns = OFFSETS.map(|offset| x.saturating_add_signed(offset).min(last));
    let centre = greys[1][x];
    // A sample and its weight in one number, in the order of samples.
    let mut samples = [0_u32; SAMPLES];
    for (i, sample) in samples.iter_mut().enumerate() {
        let (row, column) = (i / OFFSETS.len(), columns[i % OFFSETS.len()]);
        let weight = weights[usize::from(greys[row][column].abs_diff(centre))];
        *sample = u32::from(values[row][column]) << 16 | u32::from(weight);
    }
    for (a, b) in NETWORK {
        (samples[a], samples[b]) = (samples[a].min(samples[b]), samples[a].max(samples[b]));
    }
    if (samples[SAMPLES - 1] >> 16) - (samples[0] >> 16) <= STEP.into() {
        return None;
    }
    let total: u32 = samples.iter().map(|sample| sample & 0xffff).sum();
    let mut sum = 0;
    samples.iter().find_map(|&sample| {
        sum += sample & 0xffff;
        (2 * sum >= total).then_some((sample >> 16) as u16)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of disparity two columns beside that of the image.
    fn shifted_step() -> (DisparityMap, Image<u8>) {
        let mut map = DisparityMap::new(40, 12);
        map.validity.fill(0);
        for y in 0..12 {
            for x in 0..40 {
                map.values.row_mut(y)[x] = if x < 23 { 160 } else { 320 };
            }
        }
        (map, Image::from_fn(40, 12, |x, _| if x < 25 { 30 } else { 200 }))
    }

    /// A network that orders all zeros and ones orders all numbers (Knuth).
    #[test]
    fn the_network_sorts() {
        for bits in 0..1_u32 << SAMPLES {
            let mut numbers: [u32; SAMPLES] = std::array::from_fn(|i| bits >> i & 1);
            for (a, b) in NETWORK {
                (numbers[a], numbers[b]) = (numbers[a].min(numbers[b]), numbers[a].max(numbers[b]));
            }
            assert!(numbers.is_sorted(), "{bits:b}");
        }
    }

    #[test]
    fn steps_move_to_the_edges_of_the_image() {
        let (mut map, guide) = shifted_step();
        let edge = |map: &DisparityMap| map.values.row(6).iter().position(|&d| d == 320).expect("a step");
        assert_eq!(edge(&map), 23);
        Crew::assemble(1, |crew| EdgeSharpener::default().sharpen(crew, &mut map, guide.view()));
        assert_eq!(edge(&map), 25);
        assert!(map.values.as_slice().iter().all(|d| [160, 320].contains(d)));
    }

    #[test]
    fn values_are_weighted_medians_of_their_surroundings() {
        let (mut map, guide) = shifted_step();
        for (i, value) in map.values.as_mut_slice().iter_mut().enumerate() {
            *value += (i * 7 % 13) as u16;
        }
        let before = map.values.clone();
        Crew::assemble(1, |crew| EdgeSharpener::default().sharpen(crew, &mut map, guide.view()));
        for (x, y) in [(21, 0), (22, 5), (24, 11), (23, 3)] {
            let mut samples = Vec::new();
            for (i, j) in (-4..=4).step_by(4).flat_map(|j| (-4..=4).step_by(4).map(move |i| (i, j))) {
                let (sx, sy) = ((x + i).clamp(0, 39), (y + j).clamp(0, 11));
                let grey = |x: i32, y: i32| f64::from(guide.row(y as usize)[x as usize]);
                let weight = (1024.0 * (-(grey(sx, sy) - grey(x, y)).abs() / 12.0).exp()).round();
                samples.push((before.row(sy as usize)[sx as usize], weight));
            }
            samples.sort_by(|a, b| a.partial_cmp(b).expect("finite"));
            let half = samples.iter().map(|s| s.1).sum::<f64>() / 2.0;
            let below = |value: u16| samples.iter().filter(|s| s.0 <= value).map(|s| s.1).sum::<f64>();
            let expected = samples.iter().find(|s| below(s.0) >= half).expect("a median").0;
            assert_eq!(map.values.row(y as usize)[x as usize], expected, "{x} {y}");
        }
    }

    #[test]
    fn surfaces_far_from_steps_stay() {
        let (mut map, guide) = shifted_step();
        let before = map.clone();
        Crew::assemble(1, |crew| EdgeSharpener::default().sharpen(crew, &mut map, guide.view()));
        let away = |x: &usize| !(21..=24).contains(x);
        for y in 0..12 {
            (0..40).filter(away).for_each(|x| assert_eq!(map.values.row(y)[x], before.values.row(y)[x]));
        }
    }
}
