//! Regions of the disparity map: boxes, and what is read from them per column and as a whole.

mod plane;
mod profile;
mod surface;
mod u_disparity;

use std::sync::Arc;

use crate::error::{Error, Result};

pub use profile::{ProfileParams, Profiler, RegionProfile, profile};
pub use surface::NearestSurface;
pub(crate) use u_disparity::UDisparity;

/// A named box of pixels of the left aligned image: columns `x..x + width` of rows `y..y + height`.
#[derive(Debug, Clone, PartialEq, Eq)]
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
}

impl Region {
    /// A region; [`validate`](Self::validate) holds it against an image.
    pub fn new(name: impl Into<Arc<str>>, x: usize, y: usize, width: usize, height: usize) -> Self {
        Self { name: name.into(), x, y, width, height }
    }

    /// The whole of an image.
    pub fn whole(image_width: usize, image_height: usize) -> Self {
        Self::new("image", 0, 0, image_width, image_height)
    }

    /// Fails, naming the box, unless it is not empty and lies inside an image of this size.
    pub fn validate(&self, image_width: usize, image_height: usize) -> Result<()> {
        let inside = |from: usize, length: usize, limit: usize| {
            length > 0 && from.checked_add(length).is_some_and(|end| end <= limit)
        };
        if inside(self.x, self.width, image_width) && inside(self.y, self.height, image_height) {
            return Ok(());
        }
        let Self { name, x, y, width, height } = self;
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
