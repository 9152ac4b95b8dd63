//! A small world of upright rectangles, a floor and a wall, and its disparity map as a matcher would see it.

#![allow(dead_code, reason = "each test binary uses a part of it")]

use epiline::matching::{DisparityMap, Validity};
use epiline::rectification::RectifiedGeometry;

pub const WIDTH: usize = 320;
pub const HEIGHT: usize = 240;

pub fn geometry() -> RectifiedGeometry {
    RectifiedGeometry::new(WIDTH, HEIGHT, 300.0, 161.3, 118.6, 0.0, 0.12).expect("a rig")
}

/// An upright rectangle facing the camera; metres in the camera's frame, y down.
#[derive(Debug, Clone, Copy)]
pub struct Board {
    pub z: f64,
    pub left: f64,
    pub right: f64,
    pub top: f64,
    pub bottom: f64,
}

/// What there is to see.
#[derive(Debug, Clone, Default)]
pub struct World {
    pub boards: Vec<Board>,
    /// How far below the camera the floor is.
    pub floor_m: Option<f64>,
    /// A wall across the view: depth on the axis, and how much deeper it gets per metre to the right.
    pub wall: Option<(f64, f64)>,
}

impl World {
    /// Depth at a pixel; infinite where there is nothing.
    pub fn depth_m(&self, geometry: &RectifiedGeometry, x: usize, y: usize) -> f64 {
        let u = (x as f64 - geometry.cx_px) / geometry.focal_px;
        let v = (y as f64 - geometry.cy_px) / geometry.focal_px;
        let floor = self.floor_m.filter(|_| v > 0.0).map(|below| below / v);
        let wall = self.wall.map(|(z, slope)| z / (1.0 - slope * u)).filter(|z| *z > 0.0);
        let boards = self
            .boards
            .iter()
            .filter(|b| (b.left..=b.right).contains(&(u * b.z)) && (b.top..=b.bottom).contains(&(v * b.z)));
        boards.map(|b| b.z).chain(floor).chain(wall).fold(f64::INFINITY, f64::min)
    }
}

/// What is wrong with a matcher's answer.
#[derive(Debug, Clone, Copy)]
pub struct Flaws {
    /// Standard deviation of disparity, px; neighbours within 5 px share most of it.
    pub sigma_px: f64,
    /// Share of pixels with any disparity at all.
    pub mismatches: f64,
    /// Share of pixels without an answer.
    pub gaps: f64,
}

pub const NO_FLAWS: Flaws = Flaws { sigma_px: 0.0, mismatches: 0.0, gaps: 0.0 };
pub const ORDINARY: Flaws = Flaws { sigma_px: 0.25, mismatches: 0.02, gaps: 0.15 };

/// A generator good enough for noise (xorshift64).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..20).for_each(|_| _ = random.uniform());
        random
    }

    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub fn within(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.uniform()).ln()).sqrt() * (std::f64::consts::TAU * self.uniform()).cos()
    }
}

/// The map of a world, 64 disparities.
pub fn disparity_of(world: &World, geometry: &RectifiedGeometry, flaws: Flaws, seed: u64) -> DisparityMap {
    const REACH: usize = 2;
    let mut random = Random::new(seed);
    let (width, height) = (geometry.width, geometry.height);
    let padded = width + 2 * REACH;
    let noise: Vec<f64> = (0..padded * (height + 2 * REACH)).map(|_| random.normal()).collect();
    let side = 2 * REACH + 1;
    // The mean of n independent values has 1/√n of their deviation.
    let scale = flaws.sigma_px / side as f64;
    let mut map = DisparityMap::new(width, height);
    (map.min_disparity, map.num_disparities) = (0, 64);
    for y in 0..height {
        for x in 0..width {
            let shared: f64 = (0..side)
                .flat_map(|j| (0..side).map(move |i| (i, j)))
                .map(|(i, j)| noise[(y + j) * padded + x + i])
                .sum();
            let disparity_px = geometry.disparity_px(world.depth_m(geometry, x, y)) + scale * shared;
            let seen =
                if random.uniform() < flaws.mismatches { random.within(0.0, 63.0) } else { disparity_px };
            map.values.row_mut(y)[x] = (seen.clamp(0.0, 63.9) * 16.0).round() as u16;
            let missing = random.uniform() < flaws.gaps || seen > 63.5;
            map.validity.row_mut(y)[x] = if missing { Validity::LOW_TEXTURE } else { 0 };
        }
    }
    map
}
