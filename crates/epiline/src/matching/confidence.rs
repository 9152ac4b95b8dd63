//! How far each disparity can be trusted, told from the map alone.
//!
//! Wrong disparities do not continue the surface around them, and cluster where the matcher's tests reject: at
//! occlusions, in the dark, without texture. So the error to be expected grows with
//!
//! - the *bend* `|d(p - o) + d(p + o) - 2 d(p)|`, truncated, over opposite neighbours `p ± o` in four directions at three
//!   distances: zero on any plane, however slanted;
//! - the closeness of the nearest pixel without value.
//!
//! Confidence is one less the weighted sum. The weights were chosen to order pixels by their error on every second of 27
//! public scenes, over all methods together; `benchmarks/confidence.py` prints both halves.

use super::map::DisparityMap;
use crate::image::Image;

/// Distances of the neighbours a disparity is compared with, px; where a bend is truncated, 1/16 px; its weight.
const BENDS: [(usize, i32, f32); 3] = [(3, 32, 0.36), (6, 48, 0.4), (12, 64, 0.29)];
/// City-block distance at which the closeness of a pixel without value has fallen to `1/e`, px.
const EDGE_FALL: f64 = 8.0;
/// Weight of a pixel without value right here.
const EDGE_WEIGHT: f32 = 1.0;

/// Stands for a disparity that is not there: no bend with it is below a truncation.
const MISSING: i32 = 1 << 20;

impl DisparityMap {
    /// How far each disparity can be trusted, 0 to 255; 0 where none was measured, filled pixels among them.
    ///
    /// It orders pixels by the error to be expected, for any method; it is no probability.
    pub fn confidence(&self) -> Image<u8> {
        let (width, height) = (self.width(), self.height());
        let (bends, distance) = (Bends::of(self), distance_to_hole(self));
        let closeness: Vec<f32> =
            (0..=u8::MAX).map(|d| EDGE_WEIGHT * (-f64::from(d) / EDGE_FALL).exp() as f32).collect();
        let largest: f32 = BENDS.iter().map(|&(_, limit, weight)| weight * limit as f32 / 16.0).sum();
        let scale = 255.0 / (largest + EDGE_WEIGHT);
        let mut confidence = Image::new(width, height);
        let mut doubt = vec![0.0; width];
        for y in 0..height {
            doubt.fill(0.0);
            bends.add(y, &mut doubt);
            let measured = self.validity.row(y).iter().zip(distance.row(y)).zip(&doubt);
            for (confidence, ((&bits, &distance), &doubt)) in confidence.row_mut(y).iter_mut().zip(measured) {
                let doubt = doubt + closeness[usize::from(distance)];
                *confidence = if bits == 0 { (255.0 - scale * doubt).round() as u8 } else { 0 };
            }
        }
        confidence
    }
}

/// Disparities with a margin of missing ones.
struct Bends {
    values: Vec<i32>,
    stride: usize,
}

impl Bends {
    /// The largest distance.
    const MARGIN: usize = BENDS[BENDS.len() - 1].0;

    fn of(map: &DisparityMap) -> Self {
        let stride = map.width() + 2 * Self::MARGIN;
        let mut values = vec![MISSING; stride * (map.height() + 2 * Self::MARGIN)];
        for (y, row) in values.chunks_exact_mut(stride).skip(Self::MARGIN).take(map.height()).enumerate() {
            let measured = map.values.row(y).iter().zip(map.validity.row(y));
            for (padded, (&value, &bits)) in row[Self::MARGIN..].iter_mut().zip(measured) {
                *padded = if bits == 0 { value.into() } else { MISSING };
            }
        }
        Self { values, stride }
    }

    /// Adds the weighted mean of the truncated bends of row `y`, px.
    fn add(&self, y: usize, doubt: &mut [f32]) {
        let width = doubt.len();
        let first = (y + Self::MARGIN) * self.stride + Self::MARGIN;
        let centre = &self.values[first..first + width];
        for (reach, limit, weight) in BENDS {
            let weight = weight / (4.0 * 16.0);
            for offset in [reach, reach * self.stride, reach * (self.stride + 1), reach * (self.stride - 1)] {
                let (before, after) =
                    (&self.values[first - offset..][..width], &self.values[first + offset..][..width]);
                for x in 0..width {
                    let bend = (before[x] + after[x] - 2 * centre[x]).abs().min(limit);
                    doubt[x] += weight * bend as f32;
                }
            }
        }
    }
}

/// City-block distance to the nearest pixel without value, at most 255 px.
fn distance_to_hole(map: &DisparityMap) -> Image<u8> {
    let (width, height) = (map.width(), map.height());
    let far = |bits: u8| if bits == 0 { u8::MAX } else { 0 };
    let mut distance = Image::from_fn(width, height, |x, y| far(map.validity.row(y)[x]));
    for y in 0..height {
        for x in 0..width {
            let left = x.checked_sub(1).map_or(u8::MAX, |x| distance.row(y)[x]);
            let above = y.checked_sub(1).map_or(u8::MAX, |y| distance.row(y)[x]);
            let here = &mut distance.row_mut(y)[x];
            *here = left.min(above).saturating_add(1).min(*here);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            let right = if x + 1 < width { distance.row(y)[x + 1] } else { u8::MAX };
            let below = if y + 1 < height { distance.row(y + 1)[x] } else { u8::MAX };
            let here = &mut distance.row_mut(y)[x];
            *here = right.min(below).saturating_add(1).min(*here);
        }
    }
    distance
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matching::Validity;

    fn map(width: usize, height: usize, f: impl Fn(usize, usize) -> Option<u16>) -> DisparityMap {
        let values = Image::from_fn(width, height, |x, y| f(x, y).unwrap_or(999));
        let validity =
            Image::from_fn(width, height, |x, y| if f(x, y).is_some() { 0 } else { Validity::NOT_UNIQUE });
        DisparityMap::from_parts(values, validity, 0, 64).expect("legal")
    }

    #[test]
    fn a_plane_is_trusted_fully_and_alike_away_from_its_ends() {
        let map = map(60, 50, |x, y| Some((100 + 5 * x + 3 * y) as u16));
        let confidence = map.confidence();
        for y in 12..38 {
            assert!(confidence.row(y)[12..48].iter().all(|&c| c == 255), "row {y}");
        }
        assert!(confidence.row(0)[30] < 255, "half the neighbours of the first row are missing");
    }

    #[test]
    fn outliers_edges_and_surroundings_of_holes_are_trusted_less() {
        let hole = |x: usize, y: usize| (40..50).contains(&x) && (20..30).contains(&y);
        let map = map(80, 50, |x, y| match (x, y) {
            (20, 25) => Some(400),
            _ if hole(x, y) => None,
            _ => Some(200),
        });
        let confidence = map.confidence();
        let at = |x: usize, y: usize| confidence.row(y)[x];
        assert!(at(20, 25) < at(26, 25), "an outlier");
        assert!(at(39, 25) < at(35, 25) && at(35, 25) < at(31, 40), "the closer to the hole the less");
        assert_eq!(at(45, 25), 0, "nothing was measured");
    }

    /// Pixel by pixel; rejected ones keep a value that continues the surface, and must count as missing all the same.
    #[test]
    fn confidence_follows_its_definition() {
        let (width, height) = (41_isize, 33_isize);
        let value = |x: isize, y: isize| 160 + 4 * x + 3 * y + (x * 7 + y * 5) % 9 * 3;
        let bits = |x: isize, y: isize| match (x * 11 + y * 17) % 29 {
            0 => Validity::SPECKLE,
            1 => Validity::FILLED,
            _ => 0,
        };
        let mut map = map(41, 33, |x, y| Some(value(x as isize, y as isize) as u16));
        map.validity = Image::from_fn(41, 33, |x, y| bits(x as isize, y as isize));
        let inside = |x: isize, y: isize| (0..width).contains(&x) && (0..height).contains(&y);
        let at = |x: isize, y: isize| (inside(x, y) && bits(x, y) == 0).then(|| value(x, y));
        let confidence = map.confidence();
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            let actual = f64::from(confidence.row(y as usize)[x as usize]);
            let Some(own) = at(x, y) else {
                assert!(actual == 0.0, "({x}, {y}) has no value");
                continue;
            };
            let (mut doubt, mut largest) = (0.0, 1.0);
            for (reach, limit, weight) in [(3, 2.0, 0.36), (6, 3.0, 0.4), (12, 4.0, 0.29)] {
                largest += weight * limit;
                for (i, j) in [(1, 0), (0, 1), (1, 1), (-1, 1)].map(|(i, j)| (i * reach, j * reach)) {
                    let bend = match (at(x - i, y - j), at(x + i, y + j)) {
                        (Some(before), Some(after)) => (before + after - 2 * own).abs() as f64 / 16.0,
                        _ => limit,
                    };
                    doubt += weight / 4.0 * bend.min(limit);
                }
            }
            let holes = (0..height).flat_map(|v| (0..width).map(move |u| (u, v)));
            let nearest =
                holes.filter(|&(u, v)| bits(u, v) != 0).map(|(u, v)| (u - x).abs() + (v - y).abs()).min();
            doubt += (-(nearest.expect("a hole") as f64) / 8.0).exp();
            let expected = 255.0 * (1.0 - doubt / largest);
            assert!((actual - expected).abs() <= 0.51, "({x}, {y}): {actual}, not {expected}");
        }
    }

    #[test]
    fn distances_are_those_of_a_search() {
        let map = map(23, 17, |x, y| ((x * 7 + y * 13) % 41 != 0).then_some(16));
        let distance = distance_to_hole(&map);
        for y in 0..17 {
            for x in 0..23 {
                let holes = (0..17).flat_map(|v| (0..23).map(move |u| (u, v)));
                let nearest = holes
                    .filter(|&(u, v)| map.validity.row(v)[u] != 0)
                    .map(|(u, v): (usize, usize)| u.abs_diff(x) + v.abs_diff(y))
                    .min();
                assert_eq!(Some(usize::from(distance.row(y)[x])), nearest, "({x}, {y})");
            }
        }
    }

    #[test]
    fn filled_pixels_count_as_missing() {
        let mut map = map(80, 80, |_, _| Some(160));
        map.validity.row_mut(40)[40] = Validity::FILLED;
        let confidence = map.confidence();
        assert_eq!(confidence.row(40)[40], 0);
        assert!(confidence.row(40)[41] < confidence.row(20)[20]);
    }
}
