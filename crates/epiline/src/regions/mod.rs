//! Regions of the disparity map: boxes, and what is read from them per column and as a whole.

mod columns;
mod plane;
mod profile;
mod space;
mod surface;
mod tiles;
mod u_disparity;
mod windows;

use std::sync::Arc;

use crate::error::{Error, Result};
use crate::matching::MatchRegion;
use crate::rectification::RectifiedGeometry;

pub use profile::{ProfileParams, Profiler, RegionProfile, profile};
pub use space::{CameraOverGround, Slab, Space};
pub use surface::NearestSurface;

/// Where a region's surfaces are looked for, if not where the matcher looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Search {
    /// At so many whole disparities.
    Disparities {
        /// The smallest, px.
        first: usize,
        /// How many.
        count: usize,
    },
    /// At these Euclidean ranges.
    Range {
        /// Nearest, metres.
        near_m: f64,
        /// Furthest, metres; may be infinite.
        far_m: f64,
    },
}

/// A named box of pixels of the left aligned image: columns `x..x + width` of rows `y..y + height`.
#[derive(Debug, Clone, PartialEq)]
pub struct Region {
    /// What results call it; shared, not copied, by everything found in it.
    pub name: Arc<str>,
    /// Leftmost column.
    pub x: usize,
    /// Topmost row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// What a matcher that is given this region searches; `None` is its own range of disparities.
    pub search: Option<Search>,
    /// Where in space the region's points lie; profiles leave out the others. `None` is anywhere.
    pub space: Option<Space>,
}

impl Region {
    /// A region; [`validate`](Self::validate) holds it against an image.
    pub fn new(name: impl Into<Arc<str>>, x: usize, y: usize, width: usize, height: usize) -> Self {
        Self { name: name.into(), x, y, width, height, search: None, space: None }
    }

    /// The part of an image between shares of its width and height, 0 to 1. Edges are rounded to the nearest pixel, so
    /// that parts which meet in shares meet in pixels.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] unless `0 <= x`, `0 < width`, `x + width <= 1`, likewise along y, and the box holds a
    /// pixel.
    pub fn from_shares(
        name: impl Into<Arc<str>>,
        [x, y, width, height]: [f64; 4],
        image_width: usize,
        image_height: usize,
    ) -> Result<Self> {
        let name = name.into();
        let edges = |at: &'static str, from: f64, length: f64, pixels: usize| {
            let end = from + length;
            // Sums of decimal shares miss 1 by rounding.
            if !(from >= 0.0 && length > 0.0 && end <= 1.0 + 1e-9) {
                let value = format!("{from} + {length} of region '{name}'");
                return Err(Error::invalid(
                    at,
                    value,
                    "must be shares of the image: 0 <= from, 0 < length, sum <= 1",
                ));
            }
            let edge = |share: f64| ((share * pixels as f64).round() as usize).min(pixels);
            Ok((edge(from), edge(end)))
        };
        let (left, right) = edges("x + width", x, width, image_width)?;
        let (top, bottom) = edges("y + height", y, height, image_height)?;
        let region = Self::new(Arc::clone(&name), left, top, right - left, bottom - top);
        region.validate(image_width, image_height).map(|()| region)
    }

    /// The whole of an image.
    pub fn whole(image_width: usize, image_height: usize) -> Self {
        Self::new("image", 0, 0, image_width, image_height)
    }

    /// The box as a matcher takes it. `geometry` turns ranges into disparities: every pixel of the box is searched for
    /// all of them, and a pixel of disparity beyond, so that the ends can be refined.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for a range without geometry, or unless `0 < near < far`.
    pub fn to_match(&self, geometry: Option<&RectifiedGeometry>) -> Result<MatchRegion> {
        let disparities = match self.search {
            None => None,
            Some(Search::Disparities { first, count }) => Some((first, count)),
            Some(Search::Range { near_m, far_m }) => Some(self.disparities_at(geometry, near_m, far_m)?),
        };
        let Self { x, y, width, height, .. } = *self;
        Ok(MatchRegion { x, y, width, height, disparities })
    }

    /// First and count of the disparities of points of the box at these ranges.
    fn disparities_at(
        &self,
        geometry: Option<&RectifiedGeometry>,
        near_m: f64,
        far_m: f64,
    ) -> Result<(usize, usize)> {
        let name = &self.name;
        if !(near_m > 0.0 && near_m < far_m) {
            let value = format!("({near_m}, {far_m}) m of region '{name}'");
            return Err(Error::invalid("range_m", value, "must be two distances, 0 < near < far"));
        }
        let Some(geometry) = geometry else {
            let value = format!("({near_m}, {far_m}) m of region '{name}'");
            return Err(Error::invalid("range_m", value, "needs the geometry of the pair"));
        };
        let (left, top) = (self.x as f64, self.y as f64);
        let (right, bottom) = (left + self.width as f64 - 1.0, top + self.height as f64 - 1.0);
        // A ray is longest at a corner, shortest where the box is next to the principal point.
        let corners = [(left, top), (right, top), (left, bottom), (right, bottom)];
        let longest = corners.map(|(x, y)| geometry.range_per_depth(x, y)).into_iter().fold(1.0, f64::max);
        let (x, y) = (geometry.cx_px.max(left).min(right), geometry.cy_px.max(top).min(bottom));
        let shortest = geometry.range_per_depth(x, y);
        let last = geometry.disparity_px(near_m / longest).ceil() + 1.0;
        let first = geometry.disparity_px(far_m / shortest).floor() - 1.0;
        // Disparities are not negative, and what lies further to the left is not in the right image.
        let limit = geometry.width as f64 - 1.0;
        let (first, last) = (first.clamp(0.0, limit), last.clamp(0.0, limit));
        Ok((first as usize, (last - first) as usize + 1))
    }

    /// Fails, naming the box, unless it is not empty and lies inside an image of this size.
    pub fn validate(&self, image_width: usize, image_height: usize) -> Result<()> {
        let inside = |from: usize, length: usize, limit: usize| {
            length > 0 && from.checked_add(length).is_some_and(|end| end <= limit)
        };
        if inside(self.x, self.width, image_width) && inside(self.y, self.height, image_height) {
            return Ok(());
        }
        let Self { name, x, y, width, height, .. } = self;
        Err(Error::invalid(
            "region",
            format!("'{name}', {width}x{height} px at ({x}, {y})"),
            format!("must not be empty and must lie inside the image of {image_width}x{image_height} px"),
        ))
    }
}

/// The paper's four bands, 320x20 to 320x50 px of a 320x240 image, scaled to an image of this size.
///
/// The paper gives their sizes, not their rows. For a robot they stand on top of each other without overlap and end
/// at the lower edge: the narrowest straddles the horizon (half the height, for a camera that looks ahead), where
/// distant ground is compressed into few rows, the widest is right in front of the wheels. In rows of 240:
/// `band_20` 100–119, `band_30` 120–149, `band_40` 150–189, `band_50` 190–239.
///
/// # Errors
///
/// [`Error::InvalidParameter`] for an image without columns or of fewer than 12 rows, where a band would be empty.
pub fn paper_regions(image_width: usize, image_height: usize) -> Result<Vec<Region>> {
    if image_width == 0 || image_height < 12 {
        let value = format!("{image_width}x{image_height} px");
        return Err(Error::invalid(
            "image_size",
            value,
            "must be at least 1x12 px to hold the paper's bands",
        ));
    }
    let row = |of_240: usize| (of_240 * image_height + 120) / 240;
    let bands = [("band_20", 100, 120), ("band_30", 120, 150), ("band_40", 150, 190), ("band_50", 190, 240)];
    Ok(bands.map(|(name, top, end)| Region::new(name, 0, row(top), image_width, row(end) - row(top))).into())
}
