//! Path sums of semi-global matching by their definition.

use epiline::image::Image;
use epiline::matching::{MatcherParams, Prefilter};

/// A pair and its masks.
#[derive(Debug)]
pub struct Scene {
    pub left: Image<u8>,
    pub right: Image<u8>,
    pub valid: Option<[Image<u8>; 2]>,
}

/// Repeatable pixels from a seed; few grey levels make ties, extreme ones the largest costs.
pub fn scene(width: usize, height: usize, levels: u8, masked: bool, seed: u64) -> Scene {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 32) as u8
    };
    let step = 255 / (levels - 1);
    let left = Image::from_fn(width, height, |_, _| next() % levels * step);
    let right = Image::from_fn(width, height, |x, y| {
        let shift = 1 + y / 5 + usize::from(x > width / 2) * 3;
        if next() < 30 { next() % levels * step } else { left.row(y)[(x + shift).min(width - 1)] }
    });
    let valid = masked.then(|| [0, 1].map(|_| Image::from_fn(width, height, |_, _| u8::from(next() > 40))));
    Scene { left, right, valid }
}

/// The definition, pixel by pixel; nothing is shared with the matcher but its parameters.
pub struct Oracle<'a> {
    pub params: &'a MatcherParams,
    pub scene: &'a Scene,
}

pub const NO_CANDIDATE: i32 = 255;

impl Oracle<'_> {
    pub fn size(&self) -> (isize, isize) {
        (self.scene.left.width() as isize, self.scene.left.height() as isize)
    }

    fn grey(&self, image: &Image<u8>, x: isize, y: isize) -> i32 {
        let (width, height) = self.size();
        image.row(y.clamp(0, height - 1) as usize)[x.clamp(0, width - 1) as usize].into()
    }

    fn filtered(&self, image: &Image<u8>, x: isize, y: isize) -> i32 {
        let (width, height) = self.size();
        let mirror = |i: isize, n: isize| if n == 1 { 0 } else { (n - 1) - ((n - 1) - i.abs()).abs() };
        let (x, y) = (x.clamp(0, width - 1), y.clamp(0, height - 1));
        if self.params.prefilter == Prefilter::None {
            return 0;
        }
        let at = |x: isize, y: isize| self.grey(image, mirror(x, width), mirror(y, height));
        let slope: i32 =
            [(-1, 1), (0, 2), (1, 1)].iter().map(|&(j, w)| w * (at(x + 1, y + j) - at(x - 1, y + j))).sum();
        let cap = i32::from(self.params.prefilter_cap);
        slope.clamp(-cap, cap) + cap
    }

    /// The value, and the interval of it and the means with its neighbours.
    fn interval(&self, x: isize, value: impl Fn(isize) -> i32) -> (i32, i32, i32) {
        let x = x.clamp(0, self.size().0 - 1);
        let own = value(x);
        let means = [value(x - 1), value(x + 1)].map(|other| (own + other + 1) / 2);
        (own, own.min(means[0]).min(means[1]), own.max(means[0]).max(means[1]))
    }

    fn birchfield_tomasi(&self, l: (i32, i32, i32), r: (i32, i32, i32)) -> i32 {
        let outside = |v: i32, low: i32, high: i32| (v - high).max(low - v).max(0);
        outside(l.0, r.1, r.2).min(outside(r.0, l.1, l.2))
    }

    fn pixel_cost(&self, x: isize, y: isize, d: isize) -> i32 {
        let Scene { left, right, .. } = self.scene;
        let (width, height) = self.size();
        let (x, y) = (x.clamp(0, width - 1), y.clamp(0, height - 1));
        let xr = (x - d).max(0);
        let filtered = self.birchfield_tomasi(
            self.interval(x, |x| self.filtered(left, x, y)),
            self.interval(xr, |x| self.filtered(right, x, y)),
        );
        let grey = self.birchfield_tomasi(
            self.interval(x, |x| self.grey(left, x, y)),
            self.interval(xr, |x| self.grey(right, x, y)),
        );
        let darker = |image: &Image<u8>, x: isize, i: isize, j: isize| {
            self.grey(image, x + i, y + j) < self.grey(image, x, y)
        };
        let around = (-2..=2).flat_map(|j| (-2..=2).map(move |i| (i, j)));
        let census = around.filter(|&(i, j)| darker(left, x, i, j) != darker(right, xr, i, j)).count();
        filtered + grey / 4 + census as i32
    }

    pub fn is_candidate(&self, x: isize, y: isize, d: isize) -> bool {
        let has_source = |side: usize, x: isize| {
            self.scene.valid.as_ref().is_none_or(|valid| valid[side].row(y as usize)[x as usize] != 0)
        };
        x >= d && has_source(0, x) && has_source(1, x - d)
    }

    fn cost(&self, x: isize, y: isize, d: isize) -> i32 {
        if !self.is_candidate(x, y, d) {
            return NO_CANDIDATE;
        }
        let r = (self.params.block_size / 2) as isize;
        let window = (-r..=r).flat_map(|j| (-r..=r).map(move |i| (i, j)));
        let sum: i32 = window.map(|(i, j)| self.pixel_cost(x + i, y + j, d)).sum();
        let area = (2 * r + 1) * (2 * r + 1);
        let reciprocal = (65_536 + area - 1) / area;
        ((i64::from(sum) * reciprocal.min(65_535) as i64) >> 16).min(127) as i32
    }

    fn p2(&self, a: i32, b: i32) -> i32 {
        let (p1, p2) = (f64::from(self.params.p1), f64::from(self.params.p2));
        let low = f64::from(self.params.p1 + (self.params.p2 - self.params.p1) / 8);
        assert!(low >= p1);
        (low + (p2 - low) * (-f64::from((a - b).abs()) / 15.0).exp()).round() as i32
    }

    /// Sums over the paths, `[y][x][d - min_disparity]`.
    pub fn sums(&self) -> Vec<Vec<Vec<i32>>> {
        let (width, height) = self.size();
        let (first, count) = (self.params.min_disparity as isize, self.params.num_disparities);
        let costs: Vec<Vec<Vec<i32>>> = (0..height)
            .map(|y| {
                (0..width)
                    .map(|x| (0..count).map(|i| self.cost(x, y, first + i as isize)).collect())
                    .collect()
            })
            .collect();
        let mut sums = vec![vec![vec![0; count]; width as usize]; height as usize];
        let directions = [(1, 0), (-1, 0), (0, 1), (0, -1)];
        for &(dx, dy) in &directions[..self.params.paths] {
            let mut paths = vec![vec![vec![0; count]; width as usize]; height as usize];
            let mut pixels: Vec<(isize, isize)> =
                (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).collect();
            if dx + dy < 0 {
                pixels.reverse();
            }
            for (x, y) in pixels {
                let (bx, by) = (x - dx, y - dy);
                for i in 0..count {
                    let mut cost = costs[y as usize][x as usize][i];
                    if (0..width).contains(&bx) && (0..height).contains(&by) {
                        let before: &Vec<i32> = &paths[by as usize][bx as usize];
                        let smallest = *before.iter().min().expect("a disparity");
                        let at = |i: usize| before.get(i).copied().unwrap_or(NO_CANDIDATE) - smallest;
                        let left = &self.scene.left;
                        let p2 = self.p2(self.grey(left, x, y), self.grey(left, bx, by));
                        let p1 = i32::from(self.params.p1);
                        cost += at(i).min(at(i.wrapping_sub(1)) + p1).min(at(i + 1) + p1).min(p2);
                    }
                    paths[y as usize][x as usize][i] = cost.min(NO_CANDIDATE);
                    sums[y as usize][x as usize][i] += cost;
                }
            }
        }
        sums
    }
}
