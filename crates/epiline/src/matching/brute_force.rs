//! The definition of the matcher, computed directly: no running sums, no lanes.
//!
//! Time grows with `width · height · num_disparities · block_size²`; for tests on small images. Nothing here is shared
//! with the matcher but the types. All methods but [`Method::Sgm`].

use super::map::{DisparityMap, Validity};
use super::matcher::require_sizes;
use super::params::{MatcherParams, Method, Prefilter};
use crate::error::{Error, Result};
use crate::image::{Image, ImageRef};
use crate::kernels::select::Subpixel;

/// What [`StereoMatcher::compute_masked`](super::StereoMatcher::compute_masked) must compute without coarse costs.
pub fn compute_masked(
    params: &MatcherParams,
    left: ImageRef<'_, u8>,
    right: ImageRef<'_, u8>,
    left_valid: Option<ImageRef<'_, u8>>,
    right_valid: Option<ImageRef<'_, u8>>,
) -> Result<DisparityMap> {
    compute_guided(params, left, right, left_valid, right_valid, &|_, _, _| 0)
}

/// The same with something added to the cost of each candidate, given by its column, row and disparity.
pub fn compute_guided(
    params: &MatcherParams,
    left: ImageRef<'_, u8>,
    right: ImageRef<'_, u8>,
    left_valid: Option<ImageRef<'_, u8>>,
    right_valid: Option<ImageRef<'_, u8>>,
    added: &dyn Fn(usize, usize, usize) -> i64,
) -> Result<DisparityMap> {
    params.validate()?;
    if params.method == Method::Sgm {
        return Err(Error::invalid("method", params.method.name(), "must be one that sums over windows"));
    }
    require_sizes(left, right, left_valid, right_valid)?;
    params.require_width(left.width())?;
    let derivative = derivative(left, params.prefilter_cap);
    let grey = [left, right]
        .map(|image| Image::from_fn(image.width(), image.height(), |x, y| image.at(x, y).into()));
    let pair = match params.prefilter {
        Prefilter::None => grey.clone(),
        Prefilter::XSobel => [derivative.clone(), self::derivative(right, params.prefilter_cap)],
    };
    let images = Images { params, pair: &pair, grey: &grey };
    let pixels = (0..left.height()).flat_map(|y| (0..left.width()).map(move |x| (x, y)));
    let disparities = params.min_disparity..params.min_disparity + params.num_disparities;
    let differences = pixels
        .flat_map(|(x, y)| disparities.clone().map(move |d| (x, x.saturating_sub(d), y)))
        .map(|(x, right_x, y)| images.difference(x, right_x, y))
        .collect();
    let costs = Costs { params, pair: &pair, differences, left_valid, right_valid, added };
    let mut map = DisparityMap::new(left.width(), left.height());
    map.min_disparity = params.min_disparity;
    map.num_disparities = params.num_disparities;
    for y in 0..left.height() {
        for x in 0..left.width() {
            let (value, bits) = match costs.best(x, y) {
                Some(best) => costs.judge(x, y, best, &derivative),
                None => (0, costs.why_not(x, y)),
            };
            map.values.row_mut(y)[x] = value;
            map.validity.row_mut(y)[x] = bits;
        }
    }
    if params.speckle_size > 0 {
        mark_speckles(&mut map, params.speckle_size, params.speckle_range);
    }
    Ok(map)
}

/// Horizontal Sobel derivative, mirrored at the borders and clipped.
fn derivative(image: ImageRef<'_, u8>, cap: u8) -> Image<i32> {
    let mirrored = |i: isize, n: usize| {
        let n = n as isize;
        let i = if i < 0 {
            -i
        } else if i >= n {
            2 * (n - 1) - i
        } else {
            i
        };
        i.clamp(0, n - 1) as usize
    };
    let at =
        |x: isize, y: isize| i32::from(image.at(mirrored(x, image.width()), mirrored(y, image.height())));
    Image::from_fn(image.width(), image.height(), |x, y| {
        let (x, y) = (x as isize, y as isize);
        let sum: i32 =
            [(-1, 1), (0, 2), (1, 1)].iter().map(|&(j, w)| w * (at(x + 1, y + j) - at(x - 1, y + j))).sum();
        sum.clamp(-i32::from(cap), cap.into())
    })
}

/// Whether each of the 24 pixels around one is darker than it; beyond the image, its border pixels are repeated.
fn census(image: &Image<i32>, x: usize, y: usize) -> impl Iterator<Item = bool> {
    let at = move |i: isize, j: isize| {
        let (x, y) = (x as isize + i, y as isize + j);
        let (x, y) = (x.clamp(0, image.width() as isize - 1), y.clamp(0, image.height() as isize - 1));
        image.row(y as usize)[x as usize]
    };
    (-2..=2).flat_map(move |j| (-2..=2).map(move |i| at(i, j) < at(0, 0)))
}

/// How far each of two pixels lies outside what the other and the means with its neighbours, rounded up, span; the smaller
/// of both.
fn birchfield_tomasi([left, right]: &[Image<i32>; 2], x: usize, right_x: usize, y: usize) -> i64 {
    let around = |row: &[i32], x: usize| {
        let mean = |other: usize| (row[x] + row[other] + 1).div_euclid(2);
        [row[x], mean(x.saturating_sub(1)), mean((x + 1).min(row.len() - 1))]
    };
    let outside = |value: i32, around: [i32; 3]| {
        let nearest =
            value.clamp(around[0].min(around[1]).min(around[2]), around[0].max(around[1]).max(around[2]));
        i64::from((value - nearest).abs())
    };
    let (left, right) = (left.row(y), right.row(y));
    outside(left[x], around(right, right_x)).min(outside(right[right_x], around(left, x)))
}

/// What is compared.
struct Images<'a> {
    params: &'a MatcherParams,
    /// Prefiltered.
    pair: &'a [Image<i32>; 2],
    grey: &'a [Image<i32>; 2],
}

impl Images<'_> {
    /// What two pixels of row `y` differ by.
    fn difference(&self, x: usize, right_x: usize, y: usize) -> i64 {
        let (params, [left, right]) = (self.params, self.pair);
        let cost = match params.method {
            Method::Sad | Method::Sad5 => i64::from((left.row(y)[x] - right.row(y)[right_x]).abs()),
            Method::Census => {
                let [left, right] = self.grey;
                census(left, x, y).zip(census(right, right_x, y)).map(|(l, r)| i64::from(l != r)).sum()
            }
            Method::Bt => {
                let grey = match params.prefilter {
                    Prefilter::None => 0,
                    Prefilter::XSobel => birchfield_tomasi(self.grey, x, right_x, y) / 4,
                };
                birchfield_tomasi(self.pair, x, right_x, y) + grey
            }
            Method::Sgm => unreachable!("refused above"),
        };
        // So much fits 16 bits as often as the cost sums it.
        let pixels = params.block_size * params.block_size;
        match params.method {
            Method::Sad5 => cost.min(65_534 / (3 * pixels as i64)),
            Method::Census | Method::Bt => cost.min(65_534 / pixels as i64),
            Method::Sad | Method::Sgm => cost,
        }
    }
}

struct Costs<'a> {
    params: &'a MatcherParams,
    pair: &'a [Image<i32>; 2],
    /// Of every pixel and disparity.
    differences: Vec<i64>,
    left_valid: Option<ImageRef<'a, u8>>,
    right_valid: Option<ImageRef<'a, u8>>,
    added: &'a dyn Fn(usize, usize, usize) -> i64,
}

impl Costs<'_> {
    /// Pixels of the window around `(x, y)`, clamped to the image.
    fn window(&self, x: usize, y: usize) -> impl Iterator<Item = (usize, usize)> {
        let (width, height) = (self.pair[0].width() as isize, self.pair[0].height() as isize);
        let (x, y, r) = (x as isize, y as isize, self.params.radius() as isize);
        (-r..=r).flat_map(move |j| {
            let row = (y + j).clamp(0, height - 1) as usize;
            (-r..=r).map(move |i| ((x + i).clamp(0, width - 1) as usize, row))
        })
    }

    /// Eq. 5 with the method's differences.
    fn window_sum(&self, x: usize, y: usize, d: usize) -> i64 {
        let count = self.params.num_disparities;
        let at = |(x, y)| (y * self.pair[0].width() + x) * count + d - self.params.min_disparity;
        self.window(x, y).map(|pixel| self.differences[at(pixel)]).sum()
    }

    /// The method's cost, or `None` if the pair `(x, d)` is not a candidate.
    fn cost(&self, x: usize, y: usize, d: usize) -> Option<i64> {
        let right_x = x.checked_sub(d)?;
        let has_source = |mask: Option<ImageRef<'_, u8>>, x| mask.is_none_or(|mask| mask.at(x, y) != 0);
        let in_range =
            (self.params.min_disparity..self.params.min_disparity + self.params.num_disparities).contains(&d);
        if !in_range || !has_source(self.left_valid, x) || !has_source(self.right_valid, right_x) {
            return None;
        }
        let mut cost = self.window_sum(x, y, d);
        if self.params.method == Method::Sad5 {
            let (radius, [left, _]) = (self.params.radius(), self.pair);
            let columns = [x.saturating_sub(radius), (x + radius).min(left.width() - 1)];
            let rows = [y.saturating_sub(radius), (y + radius).min(left.height() - 1)];
            let mut corners: Vec<i64> =
                columns.iter().flat_map(|&x| rows.map(|y| self.window_sum(x, y, d))).collect();
            corners.sort_unstable();
            cost += corners[0] + corners[1];
        }
        Some(cost + (self.added)(x, y, d))
    }

    fn disparities(&self) -> std::ops::Range<usize> {
        self.params.min_disparity..self.params.min_disparity + self.params.num_disparities
    }

    /// The cheapest candidate; of equals, the largest disparity.
    fn best(&self, x: usize, y: usize) -> Option<(usize, i64)> {
        let candidates = self.disparities().filter_map(|d| Some((d, self.cost(x, y, d)?)));
        candidates.min_by_key(|&(d, cost)| (cost, std::cmp::Reverse(d)))
    }

    fn why_not(&self, x: usize, y: usize) -> u8 {
        let border = if x < self.params.min_disparity { Validity::BORDER } else { Validity::NO_SOURCE };
        let left_has_source = self.left_valid.is_none_or(|mask| mask.at(x, y) != 0);
        border | if left_has_source { 0 } else { Validity::NO_SOURCE }
    }

    fn judge(&self, x: usize, y: usize, (d, best): (usize, i64), derivative: &Image<i32>) -> (u16, u8) {
        let params = self.params;
        let beside = |d: Option<usize>| d.and_then(|d| self.cost(x, y, d));
        let (smaller, larger) = (beside(d.checked_sub(1)), beside(Some(d + 1)));
        let mut value_256 = 256 * d as i64;
        if let (Some(smaller), Some(larger)) = (smaller, larger)
            && smaller.max(larger) > best
        {
            value_256 += match params.subpixel {
                Subpixel::Off => 0,
                Subpixel::VFit => (smaller - larger) * 256 / (2 * (smaller.max(larger) - best)),
                Subpixel::Parabola => (smaller - larger) * 256 / (2 * (smaller + larger - 2 * best)),
            };
        }
        let mut bits = 0;
        if params.uniqueness_ratio > 0 {
            let limit = best + best * i64::from(params.uniqueness_ratio) / 100;
            let rival = |other: usize| {
                other.abs_diff(d) > 1 && self.cost(x, y, other).is_some_and(|cost| cost <= limit)
            };
            if self.disparities().any(rival) {
                bits |= Validity::NOT_UNIQUE;
            }
        }
        if let Some(max_diff) = params.left_right_max_diff {
            let right_x = x - d;
            let of_right = |d: usize| {
                let x = right_x + d;
                if x < self.pair[0].width() { self.cost(x, y, d) } else { None }
            };
            let own = self.disparities().filter_map(of_right).min();
            let near = d.saturating_sub(max_diff.into())..=d + usize::from(max_diff);
            if near.filter_map(of_right).min() != own {
                bits |= Validity::LEFT_RIGHT;
            }
        }
        let texture: i64 = self.window(x, y).map(|(x, y)| i64::from(derivative.row(y)[x].abs())).sum();
        if texture < params.texture_threshold.into() {
            bits |= Validity::LOW_TEXTURE;
        }
        (((value_256 + 15) >> 4) as u16, bits)
    }
}

/// Flood fill from every pixel not yet visited.
fn mark_speckles(map: &mut DisparityMap, size: usize, range_px: u16) {
    let (width, height) = (map.width(), map.height());
    let mut visited = Image::<u8>::new(width, height);
    for start in (0..width * height).map(|i| (i % width, i / width)) {
        let mut island = vec![start];
        let mut next = 0;
        if visited.row(start.1)[start.0] != 0 || !Validity::has_value(map.validity.row(start.1)[start.0]) {
            continue;
        }
        visited.row_mut(start.1)[start.0] = 1;
        while let Some(&(x, y)) = island.get(next) {
            next += 1;
            let around = [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)];
            for (nx, ny) in around.into_iter().filter(|&(nx, ny)| nx < width && ny < height) {
                let close = u32::from(map.values.row(y)[x].abs_diff(map.values.row(ny)[nx]))
                    <= u32::from(range_px) * u32::from(DisparityMap::SCALE);
                if close && visited.row(ny)[nx] == 0 && Validity::has_value(map.validity.row(ny)[nx]) {
                    visited.row_mut(ny)[nx] = 1;
                    island.push((nx, ny));
                }
            }
        }
        if island.len() <= size {
            island.iter().for_each(|&(x, y)| map.validity.row_mut(y)[x] |= Validity::SPECKLE);
        }
    }
}
