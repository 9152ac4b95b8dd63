//! The disparity map of a world as a matcher would see it.

use epiline::matching::{DisparityMap, Validity};
use epiline::rectification::RectifiedGeometry;

use crate::scene::{Random, World};

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

fn normal(random: &mut Random) -> f64 {
    (-2.0 * (1.0 - random.uniform()).ln()).sqrt() * (std::f64::consts::TAU * random.uniform()).cos()
}

/// The map of a world, 64 disparities.
pub fn disparity_of(world: &World, geometry: &RectifiedGeometry, flaws: Flaws, seed: u64) -> DisparityMap {
    const REACH: usize = 2;
    let mut random = Random::new(seed);
    let (width, height) = (geometry.width, geometry.height);
    let padded = width + 2 * REACH;
    let noise: Vec<f64> = (0..padded * (height + 2 * REACH)).map(|_| normal(&mut random)).collect();
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
