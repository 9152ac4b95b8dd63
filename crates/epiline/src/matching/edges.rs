//! Steps of disparity drawn to where the image has its edges.

use super::map::{DisparityMap, Validity};
use crate::image::{Image, ImageRef};

/// Steps between neighbours larger than this are edges, 1/16 px.
const STEP: u16 = DisparityMap::SCALE;
/// Offsets of the samples, in rows and in columns.
const OFFSETS: [isize; 5] = [-4, -2, 0, 2, 4];
/// How fast a sample's weight falls with the difference of grey values.
const CONTRAST: f64 = 12.0;
/// The weight of an equal grey value. All samples together weigh less than 2¹⁶.
const LARGEST_WEIGHT: f64 = 1024.0;

/// Sharpens filled maps; its buffers are kept from frame to frame.
#[derive(Debug)]
pub(super) struct EdgeSharpener {
    before: Image<u16>,
    /// Per pixel: whether it is an edge or was filled.
    uncertain: Image<u8>,
    /// By the difference of grey values.
    weights: [u16; 256],
}

impl Default for EdgeSharpener {
    fn default() -> Self {
        let weight =
            |difference: usize| (LARGEST_WEIGHT * (-(difference as f64) / CONTRAST).exp()).round() as u16;
        Self { before: Image::default(), uncertain: Image::default(), weights: std::array::from_fn(weight) }
    }
}

impl EdgeSharpener {
    /// At every pixel that was filled or lies at a step of disparity, and at those around it, takes the weighted median
    /// of 5x5 samples over 9x9 pixels, weighted by `exp(-|ΔI| / 12)`: the value of the surface it looks like. Where
    /// the samples differ by no more than a pixel, the value stays. Every pixel of the map has a value.
    pub fn sharpen(&mut self, map: &mut DisparityMap, guide: ImageRef<'_, u8>) {
        let (width, height) = (map.width(), map.height());
        self.before.resize(width, height);
        self.before.as_mut_slice().copy_from_slice(map.values.as_slice());
        self.mark(map);
        for y in 0..height {
            let around = [y.saturating_sub(1), y, (y + 1).min(height - 1)].map(|y| self.uncertain.row(y));
            for x in 0..width {
                let columns = x.saturating_sub(1)..=(x + 1).min(width - 1);
                if around.iter().any(|row| row[columns.clone()].contains(&1))
                    && let Some(value) = self.weighted_median(guide, x, y)
                {
                    map.values.row_mut(y)[x] = value;
                }
            }
        }
    }

    /// Finds what is uncertain.
    fn mark(&mut self, map: &DisparityMap) {
        let height = map.height();
        self.uncertain.resize(map.width(), height);
        for y in 0..height {
            let uncertain = self.uncertain.row_mut(y);
            let row = map.values.row(y);
            for (uncertain, &bits) in uncertain.iter_mut().zip(map.validity.row(y)) {
                *uncertain = u8::from(bits & Validity::FILLED != 0);
            }
            for other in [y.saturating_sub(1), (y + 1).min(height - 1)] {
                for ((uncertain, &a), &b) in uncertain.iter_mut().zip(row).zip(map.values.row(other)) {
                    *uncertain |= u8::from(a.abs_diff(b) > STEP);
                }
            }
            for x in 1..row.len() {
                let is_step = u8::from(row[x].abs_diff(row[x - 1]) > STEP);
                uncertain[x - 1] |= is_step;
                uncertain[x] |= is_step;
            }
        }
    }

    /// The smallest sample that, with those below it, has half the weight; `None` if samples hardly differ.
    fn weighted_median(&self, guide: ImageRef<'_, u8>, x: usize, y: usize) -> Option<u16> {
        let (width, height) = (guide.width(), guide.height());
        let centre = guide.row(y)[x];
        // A sample and its weight in one number, in the order of samples.
        let mut samples = [0_u32; OFFSETS.len() * OFFSETS.len()];
        let (mut count, mut total) = (0, 0);
        for row in OFFSETS.iter().filter_map(|&offset| y.checked_add_signed(offset)).filter(|&y| y < height) {
            let (values, greys) = (self.before.row(row), guide.row(row));
            for &offset in &OFFSETS {
                if let Some(x) = x.checked_add_signed(offset).filter(|&x| x < width) {
                    let weight = u32::from(self.weights[usize::from(greys[x].abs_diff(centre))]);
                    samples[count] = u32::from(values[x]) << 16 | weight;
                    total += weight;
                    count += 1;
                }
            }
        }
        let samples = &mut samples[..count];
        let (smallest, largest) =
            samples.iter().fold((u32::MAX, 0), |(low, high), &s| (low.min(s >> 16), high.max(s >> 16)));
        if largest - smallest <= STEP.into() {
            return None;
        }
        samples.sort_unstable();
        let mut sum = 0;
        samples.iter().find_map(|&sample| {
            sum += sample & 0xffff;
            (2 * sum >= total).then_some((sample >> 16) as u16)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of disparity three columns beside that of the image.
    fn shifted_step() -> (DisparityMap, Image<u8>) {
        let mut map = DisparityMap::new(40, 12);
        map.validity.fill(0);
        for y in 0..12 {
            for x in 0..40 {
                map.values.row_mut(y)[x] = if x < 23 { 160 } else { 320 };
            }
        }
        (map, Image::from_fn(40, 12, |x, _| if x < 20 { 30 } else { 200 }))
    }

    #[test]
    fn steps_move_to_the_edges_of_the_image() {
        let (mut map, guide) = shifted_step();
        let edge = |map: &DisparityMap| map.values.row(6).iter().position(|&d| d == 320).expect("a step");
        assert_eq!(edge(&map), 23);
        EdgeSharpener::default().sharpen(&mut map, guide.view());
        assert!((20..22).contains(&edge(&map)), "{}", edge(&map));
        assert!(map.values.as_slice().iter().all(|d| [160, 320].contains(d)));
    }

    #[test]
    fn values_are_weighted_medians_of_their_surroundings() {
        let (mut map, guide) = shifted_step();
        for (i, value) in map.values.as_mut_slice().iter_mut().enumerate() {
            *value += (i * 7 % 13) as u16;
        }
        let before = map.values.clone();
        EdgeSharpener::default().sharpen(&mut map, guide.view());
        for (x, y) in [(21, 0), (22, 5), (24, 11), (23, 3)] {
            let mut samples = Vec::new();
            for (i, j) in (-4..=4).step_by(2).flat_map(|j| (-4..=4).step_by(2).map(move |i| (i, j))) {
                let (sx, sy) = (x + i, y + j);
                if (0..40).contains(&sx) && (0..12).contains(&sy) {
                    let grey = |x: i32, y: i32| f64::from(guide.row(y as usize)[x as usize]);
                    let weight = (1024.0 * (-(grey(sx, sy) - grey(x, y)).abs() / 12.0).exp()).round();
                    samples.push((before.row(sy as usize)[sx as usize], weight));
                }
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
        EdgeSharpener::default().sharpen(&mut map, guide.view());
        let away = |x: &usize| !(21..=24).contains(x);
        for y in 0..12 {
            (0..40).filter(away).for_each(|x| assert_eq!(map.values.row(y)[x], before.values.row(y)[x]));
        }
    }
}
