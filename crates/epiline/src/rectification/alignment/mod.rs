//! How well the epipolar lines of an aligned pair lie on its scan-lines, from the pair's own content.

mod corners;
mod patch;
mod refine;

use corners::{Corner, CornerDetector};
use patch::Patch;

use crate::error::{Error, Result};
use crate::image::ImageRef;

/// Fewest matches from which a residual is stated.
pub const MIN_MATCHES: usize = 12;
/// Strongest corners of every cell of the left image that are looked for in the right one.
const PROBES_PER_CELL: u16 = 2;
/// Least ZNCC of a match.
const MIN_ZNCC: f32 = 0.75;
/// A match must lack at most this share of what the next best candidate lacks to a ZNCC of 1.
const MAX_AMBIGUITY: f32 = 0.7;
/// Corners no farther apart than this show the same thing, pixels.
const SAME_POINT_PX: usize = 2;

/// Where to look for matches.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AlignmentOptions {
    /// Disparities 0 to this are looked at, 1 to 4096 px. Default 192.
    pub num_disparities: usize,
    /// Rows up and down that are looked at, 1 to 64 px; a larger vertical error is not seen. Default 8.
    pub max_offset_px: usize,
}

impl Default for AlignmentOptions {
    fn default() -> Self {
        Self { num_disparities: 192, max_offset_px: 8 }
    }
}

impl AlignmentOptions {
    /// Fails, naming the value, unless every option is in its range.
    pub fn validate(&self) -> Result<()> {
        for (name, value, most) in
            [("num_disparities", self.num_disparities, 4096), ("max_offset_px", self.max_offset_px, 64)]
        {
            if !(1..=most).contains(&value) {
                return Err(Error::invalid(name, format!("{value} px"), format!("must be 1 to {most} px")));
            }
        }
        Ok(())
    }
}

/// The same point of the scene in both images, pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointMatch {
    /// (x, y) in the left image.
    pub left_px: [f64; 2],
    /// (x, y) in the right image.
    pub right_px: [f64; 2],
}

impl PointMatch {
    /// Vertical residual `y_right - y_left`, pixels.
    pub fn vertical_px(&self) -> f64 {
        self.right_px[1] - self.left_px[1]
    }
}

/// Vertical residual of a pair, `dy = y_right - y_left` over its matches.
///
/// With fewer than [`MIN_MATCHES`] matches nothing can be said: all three numbers are NaN, and the count tells why.
#[derive(Debug, Clone, PartialEq)]
pub struct AlignmentError {
    /// Median of `|dy|`, pixels: what matching along rows suffers.
    pub median_px: f64,
    /// Median of `dy`, pixels, positive where the right image is too low. Near `median_px` in size, it says that the
    /// right image is shifted as a whole; near 0, that the error varies over the image or is noise.
    pub signed_median_px: f64,
    /// Robust standard deviation of `dy`, pixels: 1.4826 times the median distance from the median.
    pub spread_px: f64,
    /// The matches.
    pub matches: Vec<PointMatch>,
}

/// Vertical residual of an aligned pair; [`AlignmentMeter::measure`] for a single pair.
pub fn alignment_error(
    left: ImageRef<'_, u8>,
    right: ImageRef<'_, u8>,
    options: &AlignmentOptions,
) -> Result<AlignmentError> {
    let mut meter = AlignmentMeter::new(*options)?;
    meter.measure(left, right, None, None)?;
    Ok(meter.result)
}

/// Measures the vertical residual of aligned pairs, one after the other, and keeps its buffers.
///
/// Corners, spread over a grid, are matched from left to right and back by ZNCC of 13x13 patches, within the
/// disparities and rows asked for; each match is then located to a few hundredths of a pixel by least squares.
/// What moves between the two exposures, or repeats along the row, is a wrong match; the medians bear with
/// nearly half of them.
#[derive(Debug)]
pub struct AlignmentMeter {
    options: AlignmentOptions,
    /// Strongest corners of every cell of the left image that are looked for in the right one.
    probes_per_cell: u16,
    left: View,
    right: View,
    residuals: Vec<f64>,
    result: AlignmentError,
}

impl AlignmentMeter {
    /// A meter. Fails if an option is out of its range.
    pub fn new(options: AlignmentOptions) -> Result<Self> {
        options.validate()?;
        let (nan, matches) = (f64::NAN, Vec::new());
        Ok(Self {
            options,
            probes_per_cell: PROBES_PER_CELL,
            left: View::default(),
            right: View::default(),
            residuals: Vec::new(),
            result: AlignmentError { median_px: nan, signed_median_px: nan, spread_px: nan, matches },
        })
    }

    /// A meter that looks for every corner it finds: slower, and each match as good as before.
    pub(super) fn thorough(options: AlignmentOptions) -> Result<Self> {
        Ok(Self { probes_per_cell: u16::MAX, ..Self::new(options)? })
    }

    /// Measures a pair. Pixels that are 0 in a mask, and all whose patch would touch one, take no part.
    ///
    /// # Errors
    ///
    /// [`Error::SizeMismatch`] unless both images and both masks have one size.
    pub fn measure(
        &mut self,
        left: ImageRef<'_, u8>,
        right: ImageRef<'_, u8>,
        left_valid: Option<ImageRef<'_, u8>>,
        right_valid: Option<ImageRef<'_, u8>>,
    ) -> Result<&AlignmentError> {
        left.require_same_size("left image", &right, "right image")?;
        for (mask, name) in [(left_valid, "left mask"), (right_valid, "right mask")] {
            mask.map_or(Ok(()), |mask| left.require_same_size("left image", &mask, name))?;
        }
        self.left.describe(left, left_valid);
        self.right.describe(right, right_valid);
        self.result.matches.clear();
        for probe in 0..self.left.patches.len() {
            if self.left.corners.found[probe].rank < self.probes_per_cell {
                self.result.matches.extend(self.match_probe(probe, left, right));
            }
        }
        self.summarise();
        Ok(&self.result)
    }

    fn match_probe(
        &self,
        probe: usize,
        left: ImageRef<'_, u8>,
        right: ImageRef<'_, u8>,
    ) -> Option<PointMatch> {
        let AlignmentOptions { num_disparities, max_offset_px } = self.options;
        let slack = SAME_POINT_PX;
        let corner = &self.left.corners.found[probe];
        let found = self.right.best_match(
            &self.left.patches[probe],
            corner,
            [num_disparities + slack, slack],
            max_offset_px + slack,
        )?;
        let there = &self.right.corners.found[found];
        let back = self.left.best_match(
            &self.right.patches[found],
            there,
            [slack, num_disparities + slack],
            max_offset_px + slack,
        )?;
        if !self.left.corners.found[back].is_near(corner) {
            return None;
        }
        let right_px = refine::locate(left, corner.position(), right, there.position())?;
        let found = PointMatch { left_px: corner.position().map(|v| v as f64), right_px };
        let disparity_px = found.left_px[0] - found.right_px[0];
        let looked_at = disparity_px > -1.0
            && disparity_px <= num_disparities as f64
            && found.vertical_px().abs() <= max_offset_px as f64;
        looked_at.then_some(found)
    }

    fn summarise(&mut self) {
        let Self { residuals, result, .. } = self;
        let mut median_of = |value: &dyn Fn(&PointMatch) -> f64| {
            if result.matches.len() < MIN_MATCHES {
                return f64::NAN;
            }
            residuals.clear();
            residuals.extend(result.matches.iter().map(value));
            median(residuals)
        };
        let signed_median_px = median_of(&|m| m.vertical_px());
        let median_px = median_of(&|m| m.vertical_px().abs());
        // 1.4826 makes the median distance of a normal distribution its standard deviation.
        let spread_px = 1.4826 * median_of(&|m| (m.vertical_px() - signed_median_px).abs());
        (result.median_px, result.signed_median_px, result.spread_px) =
            (median_px, signed_median_px, spread_px);
    }
}

/// The same point in both images, located precisely from where it is known to a pixel or two: x, y in the left and in
/// the right image. `None` at the images' edges, near pixels without a source and where nothing can be located.
pub(super) fn locate_near(
    images: [ImageRef<'_, u8>; 2],
    valid: [ImageRef<'_, u8>; 2],
    start_px: [[f64; 2]; 2],
) -> Option<PointMatch> {
    let whole = |side: usize| -> Option<[usize; 2]> {
        let limits = [images[side].width(), images[side].height()];
        let mut at = [0; 2];
        for axis in 0..2 {
            let value = start_px[side][axis].round();
            let inside = refine::MARGIN as f64..(limits[axis].saturating_sub(refine::MARGIN)) as f64;
            at[axis] = inside.contains(&value).then_some(value as usize)?;
        }
        corners::is_valid_around(valid[side], at[0], at[1], refine::MARGIN).then_some(at)
    };
    let (left, right) = (whole(0)?, whole(1)?);
    let right_px = refine::locate(images[0], left, images[1], right)?;
    Some(PointMatch { left_px: left.map(|v| v as f64), right_px })
}

/// The corners of one image and the patches around them.
#[derive(Debug, Default)]
struct View {
    corners: CornerDetector,
    patches: Vec<Patch>,
}

impl View {
    fn describe(&mut self, image: ImageRef<'_, u8>, valid: Option<ImageRef<'_, u8>>) {
        self.corners.detect(image, valid, refine::MARGIN);
        let corners = self.corners.found.iter();
        self.patches.clear();
        self.patches.extend(corners.map(|c| Patch::around(image, usize::from(c.x), usize::from(c.y))));
    }

    /// The corner that looks most like `patch` within so many columns (to the left, to the right) and rows of
    /// `from`, if it does so well and no other corner does nearly as well.
    fn best_match(
        &self,
        patch: &Patch,
        from: &Corner,
        [left, right]: [usize; 2],
        rows: usize,
    ) -> Option<usize> {
        let [x, y] = from.position();
        let last_row = self.corners.row_starts.len() - 1;
        let band = self.corners.row_starts[y.saturating_sub(rows)]
            ..self.corners.row_starts[(y + rows + 1).min(last_row)];
        let columns = x.saturating_sub(left)..=x + right;
        let candidates = || {
            let in_band = band.clone().zip(&self.corners.found[band.clone()]);
            in_band.filter(|(_, corner)| columns.contains(&usize::from(corner.x)))
        };
        let zncc = |index: usize| patch.zncc(&self.patches[index]);
        let (best, score) =
            candidates().map(|(index, _)| (index, zncc(index))).max_by(|a, b| a.1.total_cmp(&b.1))?;
        let elsewhere = candidates().filter(|(_, corner)| !corner.is_near(&self.corners.found[best]));
        let next_score = elsewhere.map(|(index, _)| zncc(index)).fold(-1.0, f32::max);
        let is_unique = 1.0 - score <= MAX_AMBIGUITY * (1.0 - next_score);
        (score >= MIN_ZNCC && is_unique).then_some(best)
    }
}

impl Corner {
    fn position(&self) -> [usize; 2] {
        [usize::from(self.x), usize::from(self.y)]
    }

    fn is_near(&self, other: &Self) -> bool {
        usize::from(self.x.abs_diff(other.x).max(self.y.abs_diff(other.y))) <= SAME_POINT_PX
    }
}

/// Median of at least one number; reorders them.
pub(super) fn median(values: &mut [f64]) -> f64 {
    let (middle, count) = (values.len() / 2, values.len());
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    if count % 2 == 1 {
        return upper;
    }
    let lower = below.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    0.5 * (lower + upper)
}
