//! A scan as `sensor_msgs/LaserScan` has it: one range for each of equal angles.

use super::{Scan, Seen};

/// What goes into a `sensor_msgs/LaserScan`, whose frame is the robot's, moved to [`Scan::origin_m`].
///
/// Non-finite ranges mean what REP 117 says: `-Inf` too close to measure, `+Inf` nothing within range, `NaN` unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct LaserScan {
    /// Direction of the first range, radians.
    pub angle_min_rad: f64,
    /// Direction of the last range, radians.
    pub angle_max_rad: f64,
    /// From one range to the next, counter-clockwise, radians.
    pub angle_increment_rad: f64,
    /// No range is nearer, metres.
    pub range_min_m: f64,
    /// No range is farther, metres.
    pub range_max_m: f64,
    /// Metres over the floor.
    pub ranges_m: Vec<f32>,
}

impl Scan {
    /// Obstacles: the nearest of the directions at each angle. `+Inf` only where every one of them is free as far as
    /// was looked; `-Inf` nearer than `range_min_m`.
    ///
    /// A costmap marks with it and must not clear with it: it holds obstacles with unknown space before them.
    pub fn to_laser_scan(&self, range_min_m: f64) -> LaserScan {
        let range_min_m = range_min_m.max(self.blind_m);
        self.at_equal_angles(range_min_m, |rays| {
            let nearest_m = rays.clone().map(|i| self.nearest_m[i]).fold(f32::NAN, f32::min);
            if f64::from(nearest_m) < range_min_m {
                f32::NEG_INFINITY
            } else if nearest_m.is_finite() {
                nearest_m
            } else if rays.clone().all(|i| self.seen[i] == Seen::Nothing as u8) {
                f32::INFINITY
            } else {
                f32::NAN
            }
        })
    }

    /// Free space: how far every direction at each angle is free; `+Inf` as far as was looked, NaN where nothing is
    /// known to be free.
    ///
    /// A costmap clears with it and must not mark with it: the end of what is free need not be an obstacle.
    /// `range_min_m` is where the free stretches begin at the latest.
    pub fn to_clearing_scan(&self) -> LaserScan {
        let begin_m = self.free_from_m.iter().copied().fold(0.0, f32::max);
        self.at_equal_angles(f64::from(begin_m), |rays| {
            let known = rays.clone().all(|i| self.free_to_m[i] > begin_m);
            let free_to_m = rays.map(|i| self.free_to_m[i]).fold(f32::INFINITY, f32::min);
            match known {
                false => f32::NAN,
                true if f64::from(free_to_m) >= self.max_range_m => f32::INFINITY,
                true => free_to_m,
            }
        })
    }

    /// `range` of the directions nearest to each of equal angles, of which there is at least one.
    fn at_equal_angles(&self, range_min_m: f64, range: impl Fn(std::ops::Range<usize>) -> f32) -> LaserScan {
        let angle_min_rad = self.angle_rad.first().map_or(0.0, |&angle| f64::from(angle));
        let widest = self.angle_rad.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f32::max);
        // A little more than the widest step: no angle is without a direction.
        let angle_increment_rad = f64::from(widest).max(1e-6) * (1.0 + 1e-3);
        let mut ranges_m = Vec::new();
        let mut begin = 0;
        while begin < self.len() {
            let edge_rad = angle_min_rad + (ranges_m.len() as f64 + 0.5) * angle_increment_rad;
            let inside = self.angle_rad[begin..].iter().take_while(|&&angle| f64::from(angle) < edge_rad);
            let end = begin + inside.count();
            ranges_m.push(if end > begin { range(begin..end) } else { f32::NAN });
            begin = end;
        }
        let steps = ranges_m.len().saturating_sub(1) as f64;
        LaserScan {
            angle_min_rad,
            angle_max_rad: angle_min_rad + steps * angle_increment_rad,
            angle_increment_rad,
            range_min_m,
            range_max_m: self.max_range_m,
            ranges_m,
        }
    }
}
