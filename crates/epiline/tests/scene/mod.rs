//! A small world of upright rectangles, a floor and a wall.
#![allow(dead_code, reason = "each test uses a part of it")]

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
}
