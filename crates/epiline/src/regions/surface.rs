//! The nearest surface of a region.
//!
//! ```text
//! for each column: the nearest 1-px window of disparity with enough pixels in this and 5 columns on either side
//! seed   = the column whose window is nearest in metres
//! plane  = disparity over column and row, fitted to the seed's pixels
//! repeat: extend left and right while columns hold pixels of the plane; fit again
//! look closer: fit to the near end alone
//! answer = the range on the plane that a third as many of its pixels as are demanded for support reach
//! ```
//!
//! Where the image ends, a matcher's window is cut, and answers for what is inside: the disparities of a floor's last rows
//! are a quarter of a pixel too small, and the last columns mostly have none. Nothing is fitted there; a surface that
//! reaches this margin is taken to go on to the end.
//!
//! A fitted surface, not the smallest of many noisy values: the smallest of 320 columns would be 2–3 sigma too near.
//! The plane follows a floor or a wall seen at an angle to its nearest edge, where an average would report its middle.

use std::ops::{Range, RangeInclusive};

use super::Region;
use super::plane::{Moments, Plane, Scene};
use super::u_disparity::UDisparity;
use super::windows::Windows;
use crate::kernels::Kernels;
use crate::kernels::planes::{NearTile, PlaneSums, PlaneTile};
use crate::kernels::sort::LANES;
use crate::range::depth_sigma_m;

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

/// A surface needs this many times a column's support.
const SURFACE_SUPPORT: usize = 10;
/// Of the pixels that make a surface, one in so many must be as near as its nearest point: on a fitted plane pixels are
/// in order without noise, and the more are asked for the farther that point is.
const SUPPORT_PER_PLACE: usize = 3;
/// How far a window's mean disparity may be off its surface's, px.
const WINDOW_ERROR_PX: f64 = 0.5;
/// How much disparity the near end of a surface spans, px.
const NEAR_END_PX: f64 = 2.0;
/// Pixels this far off a plane do not belong to it, px.
const TOLERANCE_PX: f64 = 0.75;
/// A column is on the plane if its pixels near it are no farther off in the mean, px.
const ON_PLANE_PX: f32 = 0.5;
/// Share of a disparity's variance that a surface keeps, and how many pixels have as much again between them: between
/// what the rendered rooms of `benchmarks/region_sigma.py` and the courses of `epiline evaluate --obstacles` ask for.
const KEPT_VARIANCE: f64 = 0.5;
const PIXELS_OF_ONE_VARIANCE: f64 = 60.0;
/// Pixels looked at to fit a plane.
const FOR_A_FIT: usize = 16_384;
const MAX_FITS: usize = 16;
/// Surfaces fitted: among those equally near within [`WINDOW_ERROR_PX`] only the fit can tell.
const MAX_SURFACES: usize = 4;
/// Columns and rows at the edge of the image where a matcher's window may be cut.
const MARGIN_PX: usize = 5;
/// Rows of a tile looked at together for the nearest point.
const ROWS_AT_ONCE: usize = 8;

/// A place on a surface: what the surface's disparity is there, and how near that is ([`Scene::distance`]).
#[derive(Debug, Clone, Copy)]
struct Point {
    x: usize,
    y: usize,
    disparity_px: f64,
    distance: f64,
}

/// What is fitted to: which pixels near a plane.
#[derive(Debug, Clone)]
struct Look {
    plane: Plane,
    /// Rows of the region.
    rows: Range<usize>,
    tolerance_px: f64,
    /// Not where the plane has less disparity, px.
    least_px: f64,
}

impl Look {
    fn at(plane: Plane, rows: Range<usize>) -> Self {
        Self { plane, rows, tolerance_px: TOLERANCE_PX, least_px: f64::NEG_INFINITY }
    }
}

/// Finds nearest surfaces; keeps its buffers from frame to frame.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceFinder {
    windows: Windows,
    /// Of each tile, as far as they were looked at.
    sums: Vec<PlaneSums>,
    points: Vec<Point>,
    /// `1 + u²` of each column, by tile.
    column_terms: Vec<[f32; LANES]>,
    /// Tiles, and how near a surface is in the middle of them.
    order: Vec<(f64, usize)>,
    /// The region, and what of it is not in the image's margin.
    whole: Part,
    inner: Part,
}

/// Some columns and rows of a region.
#[derive(Debug, Clone, Default)]
struct Part {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Part {
    /// What of a region is outside the image's margin; possibly nothing.
    fn inside_margin(region: &Region, image_size: (usize, usize)) -> Self {
        let along = |from: usize, length: usize, size: usize| {
            let end = size.saturating_sub(MARGIN_PX).saturating_sub(from).min(length);
            MARGIN_PX.saturating_sub(from).min(end)..end
        };
        Self {
            columns: along(region.x, region.width, image_size.0),
            rows: along(region.y, region.height, image_size.1),
        }
    }
}

impl SurfaceFinder {
    /// The nearest surface of a region, whose pixels `u_disparity` counts.
    pub fn nearest(
        &mut self,
        kernels: &Kernels,
        scene: &Scene<'_>,
        u_disparity: &UDisparity,
        image_size: (usize, usize),
    ) -> Option<NearestSurface> {
        let region = scene.region;
        let support =
            (SURFACE_SUPPORT * scene.params.min_support).min(region.width * region.height / 4).max(1);
        self.whole = Part { columns: 0..region.width, rows: 0..region.height };
        self.inner = Part::inside_margin(region, image_size);
        self.prepare(scene);
        self.windows.find(kernels, scene, u_disparity, support as u32);

        let mut nearest: Option<(Point, usize)> = None;
        for _ in 0..MAX_SURFACES {
            let Some((seed, seed_px)) = self.windows.nearest() else { break };
            let at_best = scene.distance_of_column(seed, seed_px + WINDOW_ERROR_PX);
            if nearest.is_some_and(|(point, _)| at_best > point.distance) {
                break;
            }
            self.windows.remove(seed);
            if let Some(found) = self.grow(kernels, scene, seed, seed_px, support)
                && nearest.is_none_or(|(point, _)| found.0.distance < point.distance)
            {
                nearest = Some(found);
            }
        }
        nearest.map(|(point, support)| describe(scene, point, support))
    }

    /// Works out what depends on where the columns are.
    fn prepare(&mut self, scene: &Scene<'_>) {
        self.sums.resize(scene.tiles.len(), PlaneSums::default());
        self.column_terms.clear();
        self.column_terms.extend((0..scene.tiles.len()).map(|tile| {
            std::array::from_fn(|lane| {
                let u = scene.slope_of_column(scene.region.x + tile * LANES + lane);
                (1.0 + u * u) as f32
            })
        }));
    }

    /// Nearest point of the surface at column `seed` of the region, and how many pixels the surface has; takes away
    /// the windows of the columns it covers.
    fn grow(
        &mut self,
        kernels: &Kernels,
        scene: &Scene<'_>,
        seed: usize,
        seed_px: f64,
        support: usize,
    ) -> Option<(Point, usize)> {
        let columns =
            seed.saturating_sub(Windows::REACH)..=(seed + Windows::REACH).min(self.whole.columns.end - 1);
        // A window is 1 px wide and its centre uncertain by a fraction: the first look is wider.
        let first_look =
            Look { tolerance_px: 1.0, ..Look::at(Plane::level(seed_px), self.whole.rows.clone()) };
        let (start, of_start) =
            self.fit(kernels, scene, &first_look, &Plane::level(seed_px), columns.clone())?;
        let (plane, of_grown, grown) = self.extend(kernels, scene, start, columns.clone());
        self.windows.remove_on(scene, &plane, grown.clone());
        let seed = self.near_end(kernels, scene, start, columns, support).map(|point| (point, of_start));
        let grown = self.near_end(kernels, scene, plane, grown, support).map(|point| (point, of_grown));
        match (seed, grown) {
            // Where surfaces bend or crowd, a plane may grow into something farther than what it began with. Else the
            // larger is the better measured one.
            (Some((point, _)), Some((other, _))) => {
                let farther_px = point.disparity_px - WINDOW_ERROR_PX;
                let farther = scene.distance(farther_px, point.x as f64, point.y as f64);
                if other.distance > farther { seed } else { grown }
            }
            _ => seed.or(grown),
        }
    }

    /// Extends a plane over neighbouring columns that hold its pixels, fitting again each time; returns also how many
    /// pixels it has.
    fn extend(
        &mut self,
        kernels: &Kernels,
        scene: &Scene<'_>,
        mut plane: Plane,
        columns: RangeInclusive<usize>,
    ) -> (Plane, usize, RangeInclusive<usize>) {
        let (mut left, mut right) = columns.into_inner();
        let whole = self.whole.clone();
        let mut members = 0;
        for _ in 0..MAX_FITS {
            // Twice as wide at most before the next fit: slopes found on few columns do not carry far.
            let limit = right - left + 1;
            let wide = left.saturating_sub(limit)..=(right + limit).min(whole.columns.end - 1);
            let step = self.look(kernels, scene, &Look::at(plane, whole.rows.clone()), wide.clone());
            let needed = scene.params.min_support.div_ceil(step).max(1) as f32;
            // Enough pixels near the plane, and those on it in the mean: of another surface just behind, only the near
            // tail of the scatter is near, all on one side.
            let holds = |x: &usize| {
                let (sums, lane) = (&self.sums[x / LANES], x % LANES);
                sums.count[lane] >= needed && sums.r[lane].abs() <= ON_PLANE_PX * sums.count[lane]
            };
            let more_left = (*wide.start()..left).rev().take_while(holds).count();
            let more_right = (right + 1..*wide.end() + 1).take_while(holds).count();
            (left, right) = (left - more_left, right + more_right);
            let moments = self.moments(scene, left..=right);
            let origin = origin(scene, &plane);
            let level = Plane::level(0.0);
            let Some(fitted) = moments.fit(&plane, &level, origin, step, scene.params.disparity_sigma_px)
            else {
                break;
            };
            plane = fitted;
            // A surface at an angle also gains rows as its slope comes out.
            let before = std::mem::replace(&mut members, step * moments.count as usize);
            if more_left + more_right == 0 && members.abs_diff(before) <= members / 100 {
                break;
            }
        }
        (plane, members, left..=right)
    }

    /// Nearest point of a surface, fitted again to its near end alone.
    ///
    /// What bends, or blends into another surface far behind, is still a plane at its near end.
    fn near_end(
        &mut self,
        kernels: &Kernels,
        scene: &Scene<'_>,
        plane: Plane,
        columns: RangeInclusive<usize>,
        support: usize,
    ) -> Option<Point> {
        // Outside the margin if there is enough of the surface.
        [self.inner.clone(), self.whole.clone()].iter().find_map(|measured| {
            let columns = (*columns.start()).max(measured.columns.start)
                ..=(*columns.end()).min(measured.columns.end.checked_sub(1)?);
            let look = Look::at(plane, measured.rows.clone());
            if columns.is_empty() || look.rows.is_empty() {
                return None;
            }
            let nearest = self.nearest_point(kernels, scene, &look, columns.clone(), measured, support)?;
            let look = Look { least_px: nearest.disparity_px - NEAR_END_PX, ..look };
            // Few pixels say little about slopes: those of the surface stay unless its near end clearly has others.
            let (plane, _) = self.fit(kernels, scene, &look, &plane, columns.clone())?;
            let whole = self.whole.clone();
            self.nearest_point(
                kernels,
                scene,
                &Look { plane, ..look },
                columns,
                &whole,
                support.div_ceil(SUPPORT_PER_PLACE),
            )
        })
    }

    /// The plane through what is looked at in some columns, and how many pixels that is.
    fn fit(
        &mut self,
        kernels: &Kernels,
        scene: &Scene<'_>,
        look: &Look,
        prior: &Plane,
        columns: RangeInclusive<usize>,
    ) -> Option<(Plane, usize)> {
        let step = self.look(kernels, scene, look, columns.clone());
        let moments = self.moments(scene, columns);
        let plane = moments.fit(
            &look.plane,
            prior,
            origin(scene, &look.plane),
            step,
            scene.params.disparity_sigma_px,
        )?;
        Some((plane, step * moments.count as usize))
    }

    /// Sums up what is looked at in the tiles of some columns; where there are more pixels than enough, only every so
    /// manieth row is looked at, which is returned.
    fn look(
        &mut self,
        kernels: &Kernels,
        scene: &Scene<'_>,
        look: &Look,
        columns: RangeInclusive<usize>,
    ) -> usize {
        let (first, last) = (*columns.start(), *columns.end());
        let rows = rows_above(scene, look, [first, last]);
        let step = ((last + 1 - first) * rows.len()).div_ceil(FOR_A_FIT).max(1);
        let (_, origin_row) = origin(scene, &look.plane);
        for tile in first / LANES..=last / LANES {
            kernels.plane(&mut PlaneTile {
                rows: &scene.tiles.tile(tile)[rows.clone()],
                step,
                first_row: ((scene.region.y + rows.start) as f64 - origin_row) as f32,
                plane: look.plane.of_tile(scene.region.x + tile * LANES, origin_row),
                tolerance_px: look.tolerance_px as f32,
                least_px: look.least_px as f32,
                sums: &mut self.sums[tile],
            });
        }
        step
    }

    /// What was last looked at in some columns, all together; counted from the [`origin`].
    fn moments(&self, scene: &Scene<'_>, columns: RangeInclusive<usize>) -> Moments {
        let mut all = Moments::default();
        let origin_column = scene.region.x as f64;
        for column in columns {
            let (sums, lane) = (&self.sums[column / LANES], column % LANES);
            let of = |sums: &[f32; LANES]| f64::from(sums[lane]);
            let x = (scene.region.x + column) as f64 - origin_column;
            let (w, wr, wy) = (of(&sums.w), of(&sums.wr), of(&sums.wy));
            all.count += of(&sums.count);
            all.w += w;
            all.wx += w * x;
            all.wy += wy;
            all.wxx += w * x * x;
            all.wxy += wy * x;
            all.wyy += of(&sums.wyy);
            all.wr += wr;
            all.wxr += wr * x;
            all.wyr += of(&sums.wyr);
        }
        all
    }

    /// The place on the plane that `support` of its pixels are at least as near as; `None` if there are fewer. Where
    /// `carried` goes beyond what is measured, every pixel beside one of the plane counts.
    fn nearest_point(
        &mut self,
        kernels: &Kernels,
        scene: &Scene<'_>,
        look: &Look,
        columns: RangeInclusive<usize>,
        carried: &Part,
        support: usize,
    ) -> Option<Point> {
        self.points.clear();
        let mut search = Search { scene, look, support, nearness: 0.0, points: &mut self.points };
        let rows = look.rows.clone();
        let (first, last) = (*columns.start(), *columns.end());
        // From near to far, so that most pixels are soon known to be too far.
        let region = scene.region;
        let near_row = if look.plane.by_y < 0.0 { carried.rows.start } else { carried.rows.end - 1 };
        self.order.clear();
        self.order.extend((first / LANES..=last / LANES).map(|tile| {
            let middle = (tile * LANES + LANES / 2).clamp(first, last);
            (search.nearness_at(middle, near_row), tile)
        }));
        self.order.sort_unstable_by(|one, other| other.0.total_cmp(&one.0));
        let mut masks = [0_u32; ROWS_AT_ONCE];
        for &(_, tile) in &self.order {
            let left = tile * LANES;
            let lanes = lanes_between(first.max(left) - left, last.min(left + LANES - 1) - left);
            let near = |values: Range<usize>, below: f64, nearness: f64, masks: &mut [u32]| {
                let (v, per_row) = scene.slopes_of_rows(region.y);
                kernels.near(&mut NearTile {
                    rows: &scene.tiles.tile(tile)[values.clone()],
                    first_row: values.start as f32,
                    below: below as f32,
                    plane: look.plane.of_tile(region.x + left, region.y as f64),
                    tolerance_px: look.tolerance_px as f32,
                    least_px: look.least_px as f32,
                    doffs_px: scene.doffs_px() as f32,
                    column_terms: &self.column_terms[tile],
                    v: (v as f32, per_row as f32),
                    // The kernel rounds; what it lets pass is worked out again.
                    nearness: (nearness * (1.0 - 1e-5)) as f32,
                    masks,
                });
            };
            let groups = rows.len().div_ceil(ROWS_AT_ONCE);
            let beyond = (carried.rows.start..rows.start).chain(rows.end..carried.rows.end);
            for y in beyond {
                let inside = y.clamp(rows.start, rows.end - 1);
                near(inside..inside + 1, y as f64 - inside as f64, search.nearness, &mut masks[..1]);
                search.offer(left, y, masks[0] & lanes);
            }
            for group in 0..groups {
                let group = if look.plane.by_y < 0.0 { group } else { groups - 1 - group };
                let from = rows.start + group * ROWS_AT_ONCE;
                let values = from..rows.end.min(from + ROWS_AT_ONCE);
                let masks = &mut masks[..values.len()];
                near(values.clone(), 0.0, search.nearness, masks);
                for (y, &mask) in values.zip(masks.iter()) {
                    search.offer(left, y, mask & lanes);
                }
            }
        }
        // To both ends of what is carried to, from where the margin begins.
        if first == self.inner.columns.start {
            search.offer_beside(first, carried.columns.start..first, &carried.rows);
        }
        if last + 1 == self.inner.columns.end {
            search.offer_beside(last, last + 1..carried.columns.end, &carried.rows);
        }
        search.finish()
    }
}

/// Pixels of a surface, of which the nearest are kept.
struct Search<'a> {
    scene: &'a Scene<'a>,
    look: &'a Look,
    support: usize,
    /// What a point must at least have to be among the nearest known: the square of disparity from infinity over the
    /// length of the ray, px².
    nearness: f64,
    points: &'a mut Vec<Point>,
}

impl Search<'_> {
    /// How near the plane is at a column and row of the region; negative where it does not lie ahead.
    fn nearness_at(&self, x: usize, y: usize) -> f64 {
        let (x, y) = (self.scene.region.x + x, self.scene.region.y + y);
        let from_infinity = self.look.plane.at(x as f64, y as f64) + self.scene.doffs_px();
        let (u, v) = (self.scene.slope_of_column(x), self.scene.slopes_of_rows(y).0);
        from_infinity.signum() * from_infinity * from_infinity / (1.0 + u * u + v * v)
    }

    /// Takes the pixels of a row of the region that a mask names, counted from `left`.
    fn offer(&mut self, left: usize, y: usize, mut mask: u32) {
        while mask != 0 {
            self.offer_one(left + mask.trailing_zeros() as usize, y);
            mask &= mask - 1;
        }
        if self.points.len() > 4 * self.support + LANES {
            self.cut();
        }
    }

    fn offer_one(&mut self, x: usize, y: usize) {
        let nearness = self.nearness_at(x, y);
        if nearness <= 0.0 || nearness < self.nearness {
            return;
        }
        let (x, y) = (self.scene.region.x + x, self.scene.region.y + y);
        let disparity_px = self.look.plane.at(x as f64, y as f64);
        self.points.push(Point { x, y, disparity_px, distance: -nearness });
    }

    /// Takes the pixels of columns beyond a column, in the rows where that is on the plane.
    fn offer_beside(&mut self, column: usize, beyond: Range<usize>, carried: &Range<usize>) {
        if beyond.is_empty() {
            return;
        }
        let Look { plane, ref rows, tolerance_px, least_px } = *self.look;
        let image_x = |x: usize| (self.scene.region.x + x) as f64;
        for y in carried.clone() {
            let inside = y.clamp(rows.start, rows.end - 1);
            let Some(disparity_px) = self.scene.tiles.at(column, inside) else { continue };
            let image_y = (self.scene.region.y + inside) as f64;
            if (disparity_px - plane.at(image_x(column), image_y)).abs() <= tolerance_px {
                for x in beyond.clone() {
                    if plane.at(image_x(x), (self.scene.region.y + y) as f64) >= least_px {
                        self.offer_one(x, y);
                    }
                }
            }
            if self.points.len() > 4 * self.support + LANES {
                self.cut();
            }
        }
    }

    /// Keeps the nearest.
    fn cut(&mut self) {
        if self.points.len() < self.support {
            return;
        }
        let by_distance = |one: &Point, other: &Point| one.distance.total_cmp(&other.distance);
        self.points.select_nth_unstable_by(self.support - 1, by_distance);
        self.points.truncate(self.support);
        self.nearness = -self.points[self.support - 1].distance;
    }

    fn finish(mut self) -> Option<Point> {
        if self.points.len() < self.support {
            return None;
        }
        self.cut();
        let Point { x, y, disparity_px, .. } = self.points[self.support - 1];
        let distance = self.scene.distance(disparity_px, x as f64, y as f64);
        Some(Point { x, y, disparity_px, distance })
    }
}

/// Where the sums of a plane's pixels are counted from, column and row of the image: rows from where the plane's centre
/// is, for what is as small as pixels are to be told by numbers of 32 bits.
fn origin(scene: &Scene<'_>, plane: &Plane) -> (f64, f64) {
    let row = if plane.center.1 > 0.0 { plane.center.1 } else { scene.middle_row() };
    (scene.region.x as f64, row.round())
}

/// The rows looked at where the plane reaches the least disparity in any of the columns between two ends.
fn rows_above(scene: &Scene<'_>, look: &Look, ends: [usize; 2]) -> Range<usize> {
    let (rows, Plane { by_y, .. }) = (&look.rows, look.plane);
    if by_y == 0.0 || look.least_px == f64::NEG_INFINITY {
        return rows.clone();
    }
    let top = scene.region.y as f64;
    let at_top = ends.map(|x| look.plane.at((scene.region.x + x) as f64, top));
    // The row of the region where the plane has the least disparity, in the column where that is soonest.
    let row = (look.least_px - at_top[0].max(at_top[1])) / by_y;
    if by_y > 0.0 {
        (row.floor().max(0.0) as usize).clamp(rows.start, rows.end)..rows.end
    } else {
        rows.start..((row.ceil().max(0.0) as usize).saturating_add(1)).clamp(rows.start, rows.end)
    }
}

/// Bits of the lanes between two, which belong to them.
fn lanes_between(first: usize, last: usize) -> u32 {
    (u32::MAX << first) & (u32::MAX >> (LANES - 1 - last))
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
