//! Matching of some boxes of the image only, with exactly the answers that matching all of it gives.
//!
//! A pixel's disparity depends on a neighbourhood: its candidates' windows, and for the left–right test those of the
//! right pixel's other candidates. A crop of both images that holds the neighbourhood of a box therefore answers the box
//! as the images would. What is planned here is which crops, so that nothing asked for is computed twice:
//!
//! 1. The boxes' union is cut into disjoint rectangles: rows where the same columns are asked for.
//! 2. Rectangles are joined while a crop of both costs no more than a crop of each; every crop has margins, neighbours
//!    share theirs.
//!
//! Speckle alone has no bounded neighbourhood: how large an island is may be decided far from the box. Islands that leave
//! what was computed are followed until they are complete or too large ([`RegionMap::undecided`]).

use std::ops::Range;

use super::map::{DisparityMap, Validity};
use super::params::{MatcherParams, Method};
use crate::error::{Error, Result};
use crate::image::Image;

/// A box of the left image to be matched: columns `x..x + width` of rows `y..y + height`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MatchRegion {
    /// Leftmost column.
    pub x: usize,
    /// Topmost row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Smallest disparity and how many, px; `None` is the matcher's own range.
    pub disparities: Option<(usize, usize)>,
}

impl MatchRegion {
    /// Most boxes in one call.
    pub const MAX_COUNT: usize = 256;

    /// The matcher's parameters with this box's range; fails, naming the box, unless it is not empty, lies inside an
    /// image of this size and its range is legal there.
    pub(super) fn params_inside(
        &self,
        params: &MatcherParams,
        image_width: usize,
        image_height: usize,
    ) -> Result<MatcherParams> {
        let Self { x, y, width, height, disparities } = *self;
        let inside = |from: usize, length: usize, limit: usize| {
            length > 0 && from.checked_add(length).is_some_and(|end| end <= limit)
        };
        if !(inside(x, width, image_width) && inside(y, height, image_height)) {
            let expected =
                format!("must not be empty and must lie inside the image of {image_width}x{image_height} px");
            return Err(Error::invalid("regions", format!("{width}x{height} px at ({x}, {y})"), expected));
        }
        let (min_disparity, num_disparities) =
            disparities.unwrap_or((params.min_disparity, params.num_disparities));
        if min_disparity.saturating_add(num_disparities) > MatcherParams::MAX_DISPARITY {
            return Err(Error::invalid(
                "regions",
                format!("{num_disparities} disparities from {min_disparity} px on at ({x}, {y})"),
                format!("must not exceed {} px", MatcherParams::MAX_DISPARITY),
            ));
        }
        let params = MatcherParams { min_disparity, num_disparities, ..*params };
        params.validate()?;
        params.require_width(image_width)?;
        Ok(params)
    }

    fn rect(&self) -> Rect {
        Rect { columns: self.x..self.x + self.width, rows: self.y..self.y + self.height }
    }
}

/// Columns and rows.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct Rect {
    pub columns: Range<usize>,
    pub rows: Range<usize>,
}

impl Rect {
    fn hull(&self, other: &Self) -> Self {
        let hull = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        Self { columns: hull(&self.columns, &other.columns), rows: hull(&self.rows, &other.rows) }
    }
}

/// Boxes that share a range of disparities.
#[derive(Debug)]
pub(super) struct Group {
    pub params: MatcherParams,
    /// Disjoint rectangles of pixels that are answered with this range.
    pub asked: Vec<Rect>,
}

/// The groups of some regions. A pixel in several regions belongs to the first of them.
pub(super) fn groups(
    regions: &[MatchRegion],
    params: &MatcherParams,
    width: usize,
    height: usize,
) -> Result<Vec<Group>> {
    if regions.is_empty() || regions.len() > MatchRegion::MAX_COUNT {
        let expected = format!("must be 1 to {} boxes", MatchRegion::MAX_COUNT);
        return Err(Error::invalid("regions", format!("{} boxes", regions.len()), expected));
    }
    let mut groups: Vec<Group> = Vec::new();
    let mut members: Vec<(Rect, usize)> = Vec::new();
    for region in regions {
        let params = region.params_inside(params, width, height)?;
        let group = groups.iter().position(|group| group.params == params).unwrap_or(groups.len());
        if group == groups.len() {
            groups.push(Group { params, asked: Vec::new() });
        }
        members.push((region.rect(), group));
    }
    // The first painter is the last to paint.
    members.reverse();
    for (rect, group) in disjoint(&members) {
        groups[group].asked.push(rect);
    }
    Ok(groups)
}

/// The rectangles of a picture in which each of some boxes is painted over those before it, with its colour.
fn disjoint(boxes: &[(Rect, usize)]) -> Vec<(Rect, usize)> {
    let edges = |of: fn(&Rect) -> &Range<usize>| {
        let mut edges: Vec<usize> =
            boxes.iter().flat_map(|(rect, _)| [of(rect).start, of(rect).end]).collect();
        edges.sort_unstable();
        edges.dedup();
        edges
    };
    let (xs, ys) = (edges(|rect| &rect.columns), edges(|rect| &rect.rows));
    let cells = |edges: &[usize], range: &Range<usize>| {
        edges.partition_point(|&edge| edge < range.start)..edges.partition_point(|&edge| edge < range.end)
    };
    let mut colours = vec![None; xs.len() * ys.len()];
    for (rect, colour) in boxes {
        for row in cells(&ys, &rect.rows) {
            for column in cells(&xs, &rect.columns) {
                colours[row * xs.len() + column] = Some(*colour);
            }
        }
    }
    let mut rects: Vec<(Rect, usize)> = Vec::new();
    let mut above: Vec<usize> = Vec::new();
    for (row, colours) in ys.windows(2).zip(colours.chunks(xs.len())) {
        let mut here = Vec::new();
        let mut column = 0;
        for run in colours.chunk_by(|a, b| a == b) {
            let columns = xs[column]..xs[(column + run.len()).min(xs.len() - 1)];
            column += run.len();
            let Some(colour) = run[0] else { continue };
            let continues = |&&i: &&usize| rects[i].0.columns == columns && rects[i].1 == colour;
            if let Some(&i) = above.iter().find(continues) {
                rects[i].0.rows.end = row[1];
                here.push(i);
            } else {
                here.push(rects.len());
                rects.push((Rect { columns, rows: row[0]..row[1] }, colour));
            }
        }
        above = here;
    }
    rects
}

/// The part of the images that some disjoint rectangles are answered from.
#[derive(Debug)]
pub(super) struct Tile {
    /// The smallest rectangle around `cores`.
    pub bounds: Rect,
    pub cores: Vec<Rect>,
}

/// How far beyond a pixel its answer looks, pixels of the images.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    left: usize,
    /// How far to the left pixels are matched, not only looked at in the right image.
    matched_left: usize,
    right: usize,
    rows: usize,
}

impl Reach {
    /// `None` where an answer depends on the whole image: paths cross it, at half the resolution too, filling takes values
    /// from anywhere, and smoothing goes along whole rows.
    pub fn of(params: &MatcherParams) -> Option<Self> {
        let rows = match params.method {
            // The window, and the derivative at its edge: texture is measured with it, whatever the prefilter.
            Method::Sad => params.radius() + 1,
            // The windows around the corners of the pixel's.
            Method::Sad5 => 2 * params.radius() + 1,
            // The census; the derivative and its extremes within half a pixel.
            Method::Census | Method::Bt => params.radius() + 2,
            Method::Sgm => return None,
        };
        // The right pixel's other candidates lie so far to the right, or to the left.
        let others = params.left_right_reach().map_or(0, |_| params.num_disparities - 1);
        let candidates = params.min_disparity + params.num_disparities - 1;
        let is_local = !params.fill && !params.smooth && !params.is_guided();
        let (left, right) = (rows + candidates, rows + others);
        is_local.then_some(Self { left, matched_left: rows + others, right, rows })
    }

    /// The crop of an image that answers `rect`.
    pub fn around(&self, rect: &Rect, width: usize, height: usize) -> Rect {
        let widen = |range: &Range<usize>, before: usize, after: usize, limit: usize| {
            range.start.saturating_sub(before)..(range.end + after).min(limit)
        };
        Rect {
            columns: widen(&rect.columns, self.left, self.right, width),
            rows: widen(&rect.rows, self.rows, self.rows, height),
        }
    }

    /// The first column of the crop that has to be matched to answer `rect`.
    pub fn first_matched(&self, rect: &Rect, crop: &Rect) -> usize {
        rect.columns.start.saturating_sub(self.matched_left).saturating_sub(crop.columns.start)
    }

    fn cost(&self, rect: &Rect, width: usize, height: usize) -> usize {
        let crop = self.around(rect, width, height);
        let columns = crop.columns.len() - self.first_matched(rect, &crop);
        // Rows of the margin are summed, but not searched: about half the work.
        columns * (rect.rows.len() + crop.rows.len()) / 2
    }

    /// Joins rectangles into tiles while that costs nothing.
    pub fn tiles(&self, rects: &[Rect], width: usize, height: usize) -> Vec<Tile> {
        let cost = |rect: &Rect| self.cost(rect, width, height);
        let mut tiles: Vec<Tile> = Vec::new();
        for rect in rects {
            let mut tile = Tile { bounds: rect.clone(), cores: vec![rect.clone()] };
            let joins = |tile: &Tile, other: &Tile| {
                cost(&tile.bounds.hull(&other.bounds)) <= cost(&tile.bounds) + cost(&other.bounds)
            };
            // A larger tile may reach others, which it did not before.
            while let Some(i) = tiles.iter().position(|other| joins(&tile, other)) {
                let other = tiles.swap_remove(i);
                tile.bounds = tile.bounds.hull(&other.bounds);
                tile.cores.extend(other.cores);
            }
            tiles.push(tile);
        }
        tiles
    }
}

/// The map of one group while it is computed, and what of it has been.
#[derive(Debug, Default)]
pub(super) struct RegionMap {
    pub map: DisparityMap,
    state: Image<u8>,
    done: Vec<Rect>,
    island: Vec<(usize, usize)>,
}

/// Bits of [`RegionMap::state`].
const COMPUTED: u8 = 1;
const ASKED: u8 = 2;
const VISITED: u8 = 4;

impl RegionMap {
    /// Nothing computed yet.
    pub fn start(&mut self, width: usize, height: usize, asked: &[Rect]) {
        self.map.resize(width, height);
        self.map.validity.fill(Validity::BORDER);
        self.state.resize(width, height);
        self.state.fill(0);
        self.done.clear();
        for rect in asked {
            rect.rows.clone().for_each(|y| self.state.row_mut(y)[rect.columns.clone()].fill(ASKED));
        }
    }

    /// The rows in which something has been computed.
    pub fn rows(&self) -> Range<usize> {
        let rows = self.done.iter().map(|rect| rect.rows.clone());
        rows.reduce(|a, b| a.start.min(b.start)..a.end.max(b.end)).unwrap_or(0..0)
    }

    /// Takes a tile's answers from `tile_map`, whose first pixel is the crop's first column and the bounds' first row.
    pub fn take(&mut self, tile: &Tile, first_column: usize, tile_map: &DisparityMap) {
        for core in &tile.cores {
            let from = core.columns.start - first_column..core.columns.end - first_column;
            for y in core.rows.clone() {
                let tile_y = y - tile.bounds.rows.start;
                let columns = core.columns.clone();
                self.map.values.row_mut(y)[columns.clone()]
                    .copy_from_slice(&tile_map.values.row(tile_y)[from.clone()]);
                self.map.validity.row_mut(y)[columns.clone()]
                    .copy_from_slice(&tile_map.validity.row(tile_y)[from.clone()]);
                self.state.row_mut(y)[columns].iter_mut().for_each(|state| *state |= COMPUTED);
            }
            self.done.push(core.clone());
        }
    }

    /// Copies the answers of some rectangles.
    pub fn copy_to(&self, asked: &[Rect], out: &mut DisparityMap) {
        for Rect { columns, rows } in asked {
            for y in rows.clone() {
                let columns = columns.clone();
                out.values.row_mut(y)[columns.clone()]
                    .copy_from_slice(&self.map.values.row(y)[columns.clone()]);
                out.validity.row_mut(y)[columns.clone()].copy_from_slice(&self.map.validity.row(y)[columns]);
            }
        }
    }

    /// Forgets the last look at speckles.
    pub fn clear_speckles(&mut self) {
        for rect in &self.done {
            for y in rect.rows.clone() {
                let columns = rect.columns.clone();
                let bits = &mut self.map.validity.row_mut(y)[columns.clone()];
                bits.iter_mut().for_each(|bits| *bits &= !Validity::SPECKLE);
                self.state.row_mut(y)[columns].iter_mut().for_each(|state| *state &= !VISITED);
            }
        }
    }

    /// What must be computed besides, `margin` pixels around every island that reaches into what was asked for, is marked
    /// as a speckle, and might go on where nothing was computed. Disjoint; empty if all is decided.
    pub fn undecided(&mut self, range_px: u16, margin: usize) -> Vec<Rect> {
        let (width, height) = (self.map.width(), self.map.height());
        let range = range_px.saturating_mul(DisparityMap::SCALE);
        let mut wanted = Vec::new();
        for rect in self.done.clone() {
            let Rect { columns, rows } = rect;
            let sides = rows.clone().flat_map(|y| [(columns.start, y), (columns.end - 1, y)]);
            let ends = columns.clone().flat_map(|x| [(x, rows.start), (x, rows.end - 1)]);
            for at in sides.chain(ends) {
                let open = neighbours(at, width, height).any(|(x, y)| self.state.row(y)[x] & COMPUTED == 0);
                if open && let Some(island) = self.asked_island(at, range) {
                    wanted.push((grown(&island, margin, width, height), 1));
                }
            }
        }
        if wanted.is_empty() {
            return Vec::new();
        }
        wanted.extend(self.done.iter().map(|rect| (rect.clone(), 0)));
        disjoint(&wanted).into_iter().filter_map(|(rect, colour)| (colour == 1).then_some(rect)).collect()
    }

    /// The rectangle around the island of speckle pixels that `start` belongs to, if it holds a pixel asked for. An island
    /// is seen once.
    fn asked_island(&mut self, start: (usize, usize), range: u16) -> Option<Rect> {
        let (width, height) = (self.map.width(), self.map.height());
        let is_speckle = |map: &DisparityMap, (x, y): (usize, usize)| {
            let bits = map.validity.row(y)[x];
            bits & Validity::SPECKLE != 0 && Validity::has_value(bits & !Validity::SPECKLE)
        };
        if !is_speckle(&self.map, start) || self.state.row(start.1)[start.0] & VISITED != 0 {
            return None;
        }
        let single = |(x, y): (usize, usize)| Rect { columns: x..x + 1, rows: y..y + 1 };
        let (mut hull, mut asked) = (single(start), false);
        self.state.row_mut(start.1)[start.0] |= VISITED;
        self.island.clear();
        self.island.push(start);
        while let Some(at) = self.island.pop() {
            let value = self.map.values.row(at.1)[at.0];
            asked |= self.state.row(at.1)[at.0] & ASKED != 0;
            hull = hull.hull(&single(at));
            for (x, y) in neighbours(at, width, height) {
                let state = &mut self.state.row_mut(y)[x];
                let linked = self.map.values.row(y)[x].abs_diff(value) <= range;
                if linked && *state & VISITED == 0 && is_speckle(&self.map, (x, y)) {
                    *state |= VISITED;
                    self.island.push((x, y));
                }
            }
        }
        asked.then_some(hull)
    }
}

/// The pixels beside one, above and below it.
fn neighbours((x, y): (usize, usize), width: usize, height: usize) -> impl Iterator<Item = (usize, usize)> {
    [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)]
        .into_iter()
        .filter(move |&(x, y)| x < width && y < height)
}

fn grown(rect: &Rect, margin: usize, width: usize, height: usize) -> Rect {
    let grow = |range: &Range<usize>, limit: usize| {
        range.start.saturating_sub(margin)..(range.end + margin).min(limit)
    };
    Rect { columns: grow(&rect.columns, width), rows: grow(&rect.rows, height) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rect(columns: Range<usize>, rows: Range<usize>) -> Rect {
        Rect { columns, rows }
    }

    /// Boxes from a seed.
    fn boxes(count: usize, seed: u64) -> Vec<(Rect, usize)> {
        let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
        let mut below = move |limit: usize| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as usize % limit
        };
        (0..count)
            .map(|i| {
                let (x, y) = (below(30), below(20));
                (rect(x..x + 1 + below(12), y..y + 1 + below(9)), i % 3)
            })
            .collect()
    }

    #[test]
    fn disjoint_rectangles_paint_the_same_picture_without_overlap() {
        for seed in 0..200 {
            let boxes = boxes(1 + seed as usize % 7, seed);
            let mut picture = Image::<u8>::new(48, 32);
            for (rect, colour) in &boxes {
                rect.rows
                    .clone()
                    .for_each(|y| picture.row_mut(y)[rect.columns.clone()].fill(*colour as u8 + 1));
            }
            for (rect, colour) in disjoint(&boxes) {
                for y in rect.rows {
                    for pixel in &mut picture.row_mut(y)[rect.columns.clone()] {
                        assert_eq!(
                            *pixel,
                            colour as u8 + 1,
                            "seed {seed}: painted twice or in the wrong colour"
                        );
                        *pixel = 0;
                    }
                }
            }
            assert!(picture.as_slice().iter().all(|&pixel| pixel == 0), "seed {seed}: a hole");
        }
    }

    #[test]
    fn stacked_boxes_of_the_same_columns_are_one_rectangle() {
        let boxes = [(rect(0..32, 10..20), 0), (rect(0..32, 20..35), 0), (rect(0..32, 15..25), 0)];
        assert_eq!(disjoint(&boxes), [(rect(0..32, 10..35), 0)]);
    }

    #[test]
    fn tiles_hold_every_rectangle_once_and_join_only_neighbours() {
        let params = MatcherParams { num_disparities: 16, block_size: 9, ..MatcherParams::default() };
        let reach = Reach::of(&params).expect("a window method");
        let near = [rect(10..50, 10..20), rect(10..50, 24..40)];
        assert_eq!(reach.tiles(&near, 320, 240).len(), 1, "margins overlap");
        let far = [rect(0..30, 10..20), rect(0..30, 200..220)];
        assert_eq!(reach.tiles(&far, 320, 240).len(), 2);
        for seed in 0..50 {
            let rects: Vec<Rect> = disjoint(&boxes(6, seed)).into_iter().map(|(rect, _)| rect).collect();
            let mut cores: Vec<Rect> =
                reach.tiles(&rects, 320, 240).into_iter().flat_map(|tile| tile.cores).collect();
            let key = |rect: &Rect| (rect.rows.start, rect.columns.start);
            cores.sort_by_key(key);
            let mut expected = rects;
            expected.sort_by_key(key);
            assert_eq!(cores, expected);
        }
    }
}
