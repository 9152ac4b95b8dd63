//! The nearest surface of a region.
//!
//! ```text
//! for each column: the nearest 1-px window of disparity with enough pixels in this and 5 columns on either side
//! seed   = the column whose window is nearest in metres
//! plane  = disparity over column and row, fitted to the seed's pixels
//! repeat: extend left and right while columns hold pixels of the plane; fit again
//! look closer: fit to the near end alone
//! answer = the range on the plane that as many of its pixels as are demanded for support reach
//! ```
//!
//! A fitted surface, not the smallest of many noisy values: the smallest of 320 columns would be 2–3 sigma too near.
//! The plane follows a floor or a wall seen at an angle to its nearest edge, where an average would report its middle.

use std::ops::RangeInclusive;

use super::Region;
use super::plane::{Member, Plane, Scene, TOLERANCE_PX};
use super::profile::ProfileParams;
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
    /// Standard deviation of `range_m`, metres: of the surface's disparity there and of the calibration. Of a disparity's
    /// variance a good half stays however many pixels are averaged, for what they share (window, texture, light); the
    /// rest falls with their number.
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
/// How far a window's mean disparity may be off its surface's, px.
const WINDOW_ERROR_PX: f64 = 0.5;
/// How much disparity the near end of a surface spans, px.
const NEAR_END_PX: f64 = 2.0;
/// Share of a disparity's variance that a surface keeps, and how many pixels have as much again between them. Of 304
/// regions in metres on ten rendered rooms, 83 % lay within the sigma of a single pixel.
const KEPT_VARIANCE: f64 = 0.6;
const PIXELS_OF_ONE_VARIANCE: f64 = 60.0;
/// Pixels looked at to fit a plane, and to say where it ends.
const FOR_A_FIT: usize = 6000;
const MAX_FITS: usize = 16;
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
}

impl Window {
    /// Takes the pair under `bin`, which holds `count` pixels, enough of them, if it is the first or clearly fuller than
    /// the one just before: the first to qualify may hold only the near tail of a surface's scatter.
    fn offer(&mut self, bin: usize, count: u32) {
        if self.count == 0 {
            *self = Self { first: bin, bin, count };
        } else if self.bin == bin + 1 && self.first - bin <= 2 && 4 * count > 5 * self.count {
            (self.bin, self.count) = (bin, count);
        }
    }

    /// Mean disparity of the pixels in and next to the window, which is that of column `x`, px.
    fn mean_px(self, x: usize, u_disparity: &UDisparity) -> f64 {
        let counts = u_disparity.counts();
        let columns = x.saturating_sub(REACH)..(x + REACH + 1).min(counts.width());
        let (mut count, mut sum_px) = (0.0, 0.0);
        for k in self.bin.saturating_sub(2)..(self.bin + 2).min(counts.height()) {
            let pixels: u32 = counts.row(k)[columns.clone()].iter().map(|&n| u32::from(n)).sum();
            count += f64::from(pixels);
            sum_px += f64::from(pixels) * UDisparity::center_px(k);
        }
        sum_px / count
    }
}

/// A pixel of a surface: what the surface's disparity is there, and how near that is ([`Scene::distance`]).
#[derive(Debug, Clone, Copy)]
struct Point {
    x: usize,
    y: usize,
    disparity_px: f64,
    distance: f64,
}

/// Finds nearest surfaces; keeps its buffers from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceFinder {
    windows: Vec<Window>,
    /// Pixels of each column in two neighbouring bins.
    pairs: Vec<u32>,
    /// Distance of each column's window; NaN where there is none, or a surface has taken it.
    distances: Vec<f64>,
    members: Vec<Member>,
    points: Vec<Point>,
}

impl SurfaceFinder {
    /// The nearest surface of a region that lies in the map, whose pixels `u_disparity` counts.
    pub fn nearest(
        &mut self,
        u_disparity: &UDisparity,
        disparity: &DisparityMap,
        geometry: Option<&RectifiedGeometry>,
        region: &Region,
        params: &ProfileParams,
    ) -> Option<NearestSurface> {
        let scene = Scene { disparity, geometry, region, params, u_disparity };
        let support = (SURFACE_SUPPORT * params.min_support).min(region.width * region.height / 4).max(1);
        self.find_windows(u_disparity, support as u32);
        self.distances.clear();
        for x in 0..region.width {
            let found = self.windows[x].count > 0;
            let distance = if found { self.window_distance(&scene, x, 0.0) } else { f64::NAN };
            self.distances.push(distance);
        }

        let mut nearest: Option<(Point, usize)> = None;
        for _ in 0..MAX_SURFACES {
            let seed = (0..region.width)
                .filter(|&x| self.distances[x].is_finite())
                .min_by(|&one, &other| self.distances[one].total_cmp(&self.distances[other]));
            let Some(seed) = seed else { break };
            let at_best = self.window_distance(&scene, seed, WINDOW_ERROR_PX);
            if nearest.is_some_and(|(point, _)| at_best > point.distance) {
                break;
            }
            if let Some(found) = self.grow(&scene, seed, support)
                && nearest.is_none_or(|(point, _)| found.0.distance < point.distance)
            {
                nearest = Some(found);
            }
        }
        nearest.map(|(point, support)| describe(&scene, point, support))
    }

    /// For each column the nearest pair of bins with `support` pixels within [`REACH`] columns.
    fn find_windows(&mut self, u_disparity: &UDisparity, support: u32) {
        let counts = u_disparity.counts();
        let width = counts.width();
        self.windows.clear();
        self.windows.resize(width, Window::default());
        // Zeros on either side stand for the columns beyond the region.
        self.pairs.clear();
        self.pairs.resize(width + 2 * REACH, 0);
        for bin in (1..counts.height()).rev() {
            let inside = &mut self.pairs[REACH..REACH + width];
            for ((pair, &upper), &lower) in inside.iter_mut().zip(counts.row(bin)).zip(counts.row(bin - 1)) {
                *pair = u32::from(upper) + u32::from(lower);
            }
            if self.pairs.iter().sum::<u32>() < support {
                continue;
            }
            let mut sum: u32 = self.pairs[..2 * REACH].iter().sum();
            let ends = self.pairs[2 * REACH..].iter().zip(&self.pairs);
            for (window, (&entering, &leaving)) in self.windows.iter_mut().zip(ends) {
                sum += entering;
                if sum >= support {
                    window.offer(bin, sum);
                }
                sum -= leaving;
            }
        }
    }

    /// Distance of a column's window if its disparity were `more_px` larger than it seems.
    fn window_distance(&self, scene: &Scene<'_>, x: usize, more_px: f64) -> f64 {
        let middle_row = scene.region.y as f64 + 0.5 * (scene.region.height - 1) as f64;
        scene.distance(
            self.windows[x].mean_px(x, scene.u_disparity) + more_px,
            (scene.region.x + x) as f64,
            middle_row,
        )
    }

    /// Nearest point of the surface at column `seed` of the region, and how many pixels the surface has; takes away
    /// the windows of the columns it covers.
    fn grow(&mut self, scene: &Scene<'_>, seed: usize, support: usize) -> Option<(Point, usize)> {
        let seed_px = self.windows[seed].mean_px(seed, scene.u_disparity);
        self.distances[seed] = f64::NAN;
        let first = scene.region.x;
        let last = first + scene.region.width - 1;
        let columns = (first + seed).saturating_sub(REACH).max(first)..=(first + seed + REACH).min(last);
        // A window is 1 px wide and its centre uncertain by a fraction: the first look is wider.
        scene.collect(columns.clone(), &Plane::level(seed_px), 1.0, FOR_A_FIT, &mut self.members);
        let start = Plane::fit(&self.members, scene.params.disparity_sigma_px)?;

        let (plane, grown) = self.extend(scene, start, columns.clone());
        self.take_windows(scene, &plane, grown.clone());
        let of_seed = self.near_end(scene, &start, columns, support);
        let of_grown = self.near_end(scene, &plane, grown, support);
        match (of_seed, of_grown) {
            // Where surfaces bend or crowd, a plane may grow into something farther than what it began with. Else the
            // larger is the better measured one.
            (Some((seed, _)), Some((grown, _))) => {
                let farther_px = seed.disparity_px - WINDOW_ERROR_PX;
                let farther = scene.distance(farther_px, seed.x as f64, seed.y as f64);
                if grown.distance > farther { of_seed } else { of_grown }
            }
            _ => of_seed.or(of_grown),
        }
    }

    /// Extends a plane over neighbouring columns that hold its pixels, fitting again each time.
    fn extend(
        &mut self,
        scene: &Scene<'_>,
        mut plane: Plane,
        columns: RangeInclusive<usize>,
    ) -> (Plane, RangeInclusive<usize>) {
        let (mut left, mut right) = columns.into_inner();
        let end = scene.region.x + scene.region.width;
        let mut members_before = 0;
        for _ in 0..MAX_FITS {
            // Twice as wide at most before the next fit: slopes found on few columns do not carry far.
            let limit = right - left + 1;
            let holds = |x: &usize| scene.column_holds(*x, &plane);
            let more_left = (scene.region.x..left).rev().take(limit).take_while(holds).count();
            let more_right = (right + 1..end).take(limit).take_while(holds).count();
            (left, right) = (left - more_left, right + more_right);
            let step = scene.collect(left..=right, &plane, TOLERANCE_PX, FOR_A_FIT, &mut self.members);
            let Some(fitted) = Plane::fit(&self.members, scene.params.disparity_sigma_px) else { break };
            plane = fitted;
            // A surface at an angle also gains rows as its slope comes out.
            let members = step * self.members.len();
            let settled = members.abs_diff(members_before) <= members / 100;
            if more_left + more_right == 0 && settled {
                break;
            }
            members_before = members;
        }
        (plane, left..=right)
    }

    /// Takes away the windows that look at a surface: they would only lead to it again.
    fn take_windows(&mut self, scene: &Scene<'_>, plane: &Plane, columns: RangeInclusive<usize>) {
        let Region { x: first, y: top, height, .. } = *scene.region;
        for x in columns {
            let ends = [plane.at(x, top), plane.at(x, top + height - 1)];
            let (far, near) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
            let window_px = self.windows[x - first].mean_px(x - first, scene.u_disparity);
            if (far - 1.0..=near + 1.0).contains(&window_px) {
                self.distances[x - first] = f64::NAN;
            }
        }
    }

    /// Nearest point of a surface, fitted again to its near end alone, and how many pixels the whole has.
    ///
    /// What bends, or blends into another surface far behind, is still a plane at its near end.
    fn near_end(
        &mut self,
        scene: &Scene<'_>,
        plane: &Plane,
        columns: RangeInclusive<usize>,
        support: usize,
    ) -> Option<(Point, usize)> {
        let step = scene.collect(columns.clone(), plane, TOLERANCE_PX, FOR_A_FIT, &mut self.members);
        let pixels = step * self.members.len();
        let support = support.div_ceil(step);
        let near_end_px = self.nearest_point(scene, plane, support)?.disparity_px - NEAR_END_PX;
        self.members.retain(|member| plane.at(member.x, member.y) >= near_end_px);
        let plane = Plane::fit(&self.members, scene.params.disparity_sigma_px)?;
        scene.collect(columns, &plane, TOLERANCE_PX, FOR_A_FIT, &mut self.members);
        self.members.retain(|member| plane.at(member.x, member.y) >= near_end_px);
        self.nearest_point(scene, &plane, support).map(|point| (point, pixels))
    }

    /// The point of the plane that `support` of the members are at least as near as; `None` if there are fewer.
    fn nearest_point(&mut self, scene: &Scene<'_>, plane: &Plane, support: usize) -> Option<Point> {
        self.points.clear();
        for &Member { x, y, .. } in &self.members {
            let disparity_px = plane.at(x, y);
            let distance = scene.distance(disparity_px, x as f64, y as f64);
            if distance.is_finite() {
                self.points.push(Point { x, y, disparity_px, distance });
            }
        }
        if self.points.len() < support {
            return None;
        }
        let by_distance = |one: &Point, other: &Point| one.distance.total_cmp(&other.distance);
        Some(*self.points.select_nth_unstable_by(support - 1, by_distance).1)
    }
}

fn describe(scene: &Scene<'_>, point: Point, support: usize) -> NearestSurface {
    let (depth_m, range_m, sigma_m) = scene.geometry.map_or((f64::NAN, f64::NAN, f64::NAN), |geometry| {
        let depth_m = geometry.depth_m(point.disparity_px);
        let ray = geometry.range_per_depth(point.x as f64, point.y as f64);
        let share_of_variance = KEPT_VARIANCE + PIXELS_OF_ONE_VARIANCE / support as f64;
        let disparity_sigma_px = share_of_variance.sqrt() * scene.params.disparity_sigma_px;
        let sigma_m = ray * depth_sigma_m(geometry, depth_m, disparity_sigma_px);
        (depth_m, depth_m * ray, sigma_m)
    });
    let disparity_px = point.disparity_px;
    NearestSurface { disparity_px, depth_m, range_m, sigma_m, at: (point.x, point.y), support }
}
