//! The nearest surface of a region.
//!
//! ```text
//! for each column: the nearest 1-px window of disparity with enough pixels in this and 5 columns on either side
//! seed   = the column whose window is nearest in metres
//! plane  = d(x, y) fitted to the seed's pixels                 (a plane in space is one in disparity)
//! repeat: extend left and right while columns hold pixels of the plane; fit again
//! answer = the range on the plane that as many of its pixels as are demanded for support reach
//! ```
//!
//! A fitted surface, not the smallest of many noisy values: the smallest of 320 columns would be 2–3 sigma too near.
//! The plane follows a floor or a wall seen at an angle to its nearest edge, where an average would report its middle.

use nalgebra::{Matrix3, Vector3};

use super::Region;
use super::profile::{ProfileParams, finite_range_m};
use super::u_disparity::UDisparity;
use crate::matching::DisparityMap;
use crate::range::depth_sigma_m;
use crate::rectification::RectifiedGeometry;

/// The nearest surface of a region that enough pixels of neighbouring columns belong to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestSurface {
    /// Disparity of its nearest point, px.
    pub disparity_px: f64,
    /// Z of that point, metres; NaN without geometry, as the next two.
    pub depth_m: f64,
    /// Euclidean range, metres.
    pub range_m: f64,
    /// Standard deviation of `range_m`, metres: that of a single pixel there. No credit is taken for the many
    /// pixels averaged, for they share their matching windows and the calibration.
    pub sigma_m: f64,
    /// Where it is, column and row of the image.
    pub at: (usize, usize),
    /// Pixels of the surface.
    pub support: usize,
}

/// Columns on either side that support a column.
const REACH: usize = 5;
/// A surface needs this many times a column's support.
const SURFACE_SUPPORT: usize = 10;
/// Pixels this far off the plane do not belong to it, px.
const TOLERANCE_PX: f64 = 0.75;
/// Prior for the plane's slopes, as pixels of evidence: holds a surface of a few pixels level.
const SLOPE_PRIOR: f64 = 1.0;
/// How far a window's mean disparity may be off its surface's, px.
const WINDOW_ERROR_PX: f64 = 0.5;
/// Surfaces fitted: among those equally near within [`WINDOW_ERROR_PX`] only the fit can tell.
const MAX_SURFACES: usize = 4;

/// A column's nearest supported window of disparity while bins are visited from near to far.
#[derive(Debug, Clone, Copy, Default)]
struct Window {
    /// Upper bin of the first pair with enough pixels; meaningless while `count` is 0, as the next.
    first: usize,
    /// The upper of its two bins.
    bin: usize,
    count: u32,
    settled: bool,
}

/// A pixel of a surface, and the range the surface has there.
#[derive(Debug, Clone, Copy)]
struct Member {
    x: usize,
    y: usize,
    disparity_px: f64,
    /// What is smaller where the surface is nearer: range in metres, or minus disparity without geometry.
    distance: f64,
}

/// `d = offset + by_x·(x - center.0) + by_y·(y - center.1)`.
#[derive(Debug, Clone, Copy)]
struct Plane {
    center: (f64, f64),
    coefficients: Vector3<f64>,
}

impl Plane {
    fn at(&self, x: usize, y: usize) -> f64 {
        let [offset, by_x, by_y] = self.coefficients.into();
        offset + by_x * (x as f64 - self.center.0) + by_y * (y as f64 - self.center.1)
    }

    /// Least squares; `None` without pixels.
    fn fit(members: &[Member]) -> Option<Self> {
        if members.is_empty() {
            return None;
        }
        let count = members.len() as f64;
        let mean = |of: fn(&Member) -> f64| members.iter().map(of).sum::<f64>() / count;
        let center = (mean(|m| m.x as f64), mean(|m| m.y as f64));
        let mut normal = Matrix3::from_diagonal(&Vector3::new(0.0, SLOPE_PRIOR, SLOPE_PRIOR));
        let mut right_side = Vector3::zeros();
        for member in members {
            let row = Vector3::new(1.0, member.x as f64 - center.0, member.y as f64 - center.1);
            normal += row * row.transpose();
            right_side += row * member.disparity_px;
        }
        normal.cholesky().map(|factor| Self { center, coefficients: factor.solve(&right_side) })
    }
}

/// Finds nearest surfaces; keeps its buffers from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceFinder {
    u_disparity: UDisparity,
    windows: Vec<Window>,
    /// Distance of each column's window; NaN where there is none, or a surface has taken it.
    distances: Vec<f64>,
    members: Vec<Member>,
}

impl SurfaceFinder {
    /// The nearest surface of a region that lies in the map.
    pub fn nearest(
        &mut self,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        region: &Region,
        params: &ProfileParams,
    ) -> Option<NearestSurface> {
        let support = (SURFACE_SUPPORT * params.min_support).min(region.width * region.height / 4).max(1);
        self.u_disparity.count(disparity, region);
        self.find_windows(support as u32);
        self.measure_windows(geometry, region);

        let mut nearest: Option<(f64, NearestSurface)> = None;
        for _ in 0..MAX_SURFACES {
            let seed = (0..region.width)
                .filter(|&x| self.distances[x].is_finite())
                .min_by(|&one, &other| self.distances[one].total_cmp(&self.distances[other]));
            let Some(seed) = seed else { break };
            let at_best = self.window_distance(geometry, region, seed, WINDOW_ERROR_PX);
            if nearest.is_some_and(|(distance, _)| at_best > distance) {
                break;
            }
            if let Some(found) = self.fit(disparity, geometry, region, params, seed, support)
                && nearest.is_none_or(|(distance, _)| found.0 < distance)
            {
                nearest = Some(found);
            }
        }
        nearest.map(|(_, surface)| surface)
    }

    /// For each column the nearest pair of bins with `support` pixels within [`REACH`] columns.
    fn find_windows(&mut self, support: u32) {
        let counts = self.u_disparity.counts();
        let width = counts.width();
        self.windows.clear();
        self.windows.resize(width, Window::default());
        for bin in (1..counts.height()).rev() {
            let (upper, lower) = (counts.row(bin), counts.row(bin - 1));
            let pair = |x: usize| u32::from(upper[x]) + u32::from(lower[x]);
            let mut sum: u32 = (0..REACH.min(width)).map(pair).sum();
            for (x, window) in self.windows.iter_mut().enumerate() {
                if x + REACH < width {
                    sum += pair(x + REACH);
                }
                if x > REACH {
                    sum -= pair(x - REACH - 1);
                }
                if window.settled {
                    continue;
                }
                if window.count == 0 {
                    if sum >= support {
                        *window = Window { first: bin, bin, count: sum, settled: false };
                    }
                } else if 4 * sum > 5 * window.count && window.first - bin <= 2 {
                    // The first window to qualify may hold only the near tail of a surface's scatter.
                    (window.bin, window.count) = (bin, sum);
                } else {
                    window.settled = true;
                }
            }
        }
    }

    /// Mean disparity of the pixels in and next to a column's window, px.
    fn window_px(&self, x: usize) -> f64 {
        let counts = self.u_disparity.counts();
        let bin = self.windows[x].bin;
        let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(counts.width());
        let (mut count, mut sum_px) = (0.0, 0.0);
        for k in bin.saturating_sub(2)..(bin + 2).min(counts.height()) {
            let pixels: u32 = counts.row(k)[columns.clone()].iter().map(|&n| u32::from(n)).sum();
            count += f64::from(pixels);
            sum_px += f64::from(pixels) * UDisparity::center_px(k);
        }
        sum_px / count
    }

    fn measure_windows(&mut self, geometry: Option<&RectifiedGeometry>, region: &Region) {
        self.distances.clear();
        for x in 0..region.width {
            let found = self.windows[x].count > 0;
            self.distances.push(if found {
                self.window_distance(geometry, region, x, 0.0)
            } else {
                f64::NAN
            });
        }
    }

    /// Distance of a column's window if its disparity were `more_px` larger than it seems.
    fn window_distance(
        &self,
        geometry: Option<&RectifiedGeometry>,
        region: &Region,
        x: usize,
        more_px: f64,
    ) -> f64 {
        let middle_row = region.y as f64 + 0.5 * (region.height - 1) as f64;
        distance(geometry, self.window_px(x) + more_px, (region.x + x) as f64, middle_row)
    }

    /// Grows the surface at column `seed`, takes its columns' windows away, and finds its nearest point.
    fn fit(
        &mut self,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        region: &Region,
        params: &ProfileParams,
        seed: usize,
        support: usize,
    ) -> Option<(f64, NearestSurface)> {
        let seed_px = self.window_px(seed);
        let mut left = seed.saturating_sub(REACH);
        let mut right = (seed + REACH).min(region.width - 1);
        let mut plane = Plane { center: (0.0, 0.0), coefficients: Vector3::new(seed_px, 0.0, 0.0) };
        // A window is 1 px wide and its centre uncertain by a fraction: the first look is wider.
        let mut tolerance_px = 1.0;
        loop {
            self.members.clear();
            for x in left..=right {
                collect(disparity, region, x, &plane, tolerance_px, &mut self.members);
            }
            let Some(fitted) = Plane::fit(&self.members) else { break };
            plane = fitted;
            tolerance_px = TOLERANCE_PX;
            // Twice as wide at most before the next fit: slopes found on few columns do not carry far.
            let limit = right - left + 1;
            let holds = |x: usize| {
                let mut pixels = 0;
                for_each_member(disparity, region, x, &plane, tolerance_px, |_| pixels += 1);
                pixels >= params.min_support
            };
            let more_left = (0..left).rev().take(limit).take_while(|&x| holds(x)).count();
            let more_right = (right + 1..region.width).take(limit).take_while(|&x| holds(x)).count();
            (left, right) = (left - more_left, right + more_right);
            if more_left + more_right == 0 {
                break;
            }
        }
        self.members.clear();
        for x in left..=right {
            collect(disparity, region, x, &plane, tolerance_px, &mut self.members);
        }
        for x in left..=right {
            if (plane.at(region.x + x, region.y + region.height / 2) - self.window_px(x)).abs() < 1.0 {
                self.distances[x] = f64::NAN;
            }
        }
        self.distances[seed] = f64::NAN;

        self.members.retain_mut(|member| {
            member.disparity_px = plane.at(member.x, member.y);
            member.distance = distance(geometry, member.disparity_px, member.x as f64, member.y as f64);
            member.distance.is_finite()
        });
        if self.members.len() < support {
            return None;
        }
        let by_distance = |one: &Member, other: &Member| one.distance.total_cmp(&other.distance);
        let (_, point, _) = self.members.select_nth_unstable_by(support - 1, by_distance);
        let point = *point;
        let (depth_m, range_m, sigma_m) = geometry.map_or((f64::NAN, f64::NAN, f64::NAN), |geometry| {
            let depth_m = geometry.depth_m(point.disparity_px);
            let ray = geometry.range_per_depth(point.x as f64, point.y as f64);
            (depth_m, depth_m * ray, ray * depth_sigma_m(geometry, depth_m, params.disparity_sigma_px))
        });
        let (at, support) = ((point.x, point.y), self.members.len());
        let disparity_px = point.disparity_px;
        Some((point.distance, NearestSurface { disparity_px, depth_m, range_m, sigma_m, at, support }))
    }
}

/// What is smaller where a surface is nearer; NaN where it has no place in front of the cameras.
fn distance(geometry: Option<&RectifiedGeometry>, disparity_px: f64, x: f64, y: f64) -> f64 {
    geometry.map_or(-disparity_px, |geometry| finite_range_m(geometry, disparity_px, x, y))
}

/// Calls `visit` with each pixel of a region's column that lies within `tolerance_px` of the plane.
fn for_each_member(
    disparity: &DisparityMap,
    region: &Region,
    column: usize,
    plane: &Plane,
    tolerance_px: f64,
    mut visit: impl FnMut(Member),
) {
    let x = region.x + column;
    for y in region.y..region.y + region.height {
        if let Some(disparity_px) = disparity.at(x, y).map(f64::from)
            && (disparity_px - plane.at(x, y)).abs() <= tolerance_px
        {
            visit(Member { x, y, disparity_px, distance: f64::NAN });
        }
    }
}

fn collect(
    disparity: &DisparityMap,
    region: &Region,
    column: usize,
    plane: &Plane,
    tolerance_px: f64,
    members: &mut Vec<Member>,
) {
    for_each_member(disparity, region, column, plane, tolerance_px, |member| members.push(member));
}
