//! How well the epipolar lines of an aligned pair lie on its scan-lines, from the pair's own content.

mod corners;
mod patch;
mod refine;

use corners::{Corner, CornerDetector, Spread};
use patch::Patch;

use crate::error::{Error, Result};
use crate::image::{Image, ImageRef};

/// Fewest matches from which a residual is stated.
pub const MIN_MATCHES: usize = 12;
/// Corners of the images at half size, one of each cell looked for in the other image: enough for medians and slopes.
const QUICK: Effort = Effort {
    shrink: 2,
    probes_per_cell: 1,
    spread: Spread { cells: 20, min_cell_px: 12, area_per_corner_px: 72 },
};
/// Every corner that there is at full size.
const THOROUGH: Effort = Effort {
    shrink: 1,
    probes_per_cell: u16::MAX,
    spread: Spread { cells: 20, min_cell_px: 24, area_per_corner_px: 144 },
};
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
/// Corners, spread over a grid, are matched from left to right and back by ZNCC of 13x13 patches of the images at half
/// size, within the disparities and rows asked for; each match is then located at full size to a few hundredths of a
/// pixel by least squares.
/// What moves between the two exposures, or repeats along the row, is a wrong match; the medians bear with
/// nearly half of them.
#[derive(Debug)]
pub struct AlignmentMeter {
    options: AlignmentOptions,
    effort: Effort,
    left: View,
    right: View,
    residuals: Vec<f64>,
    result: AlignmentError,
}

impl AlignmentMeter {
    /// A meter. Fails if an option is out of its range.
    pub fn new(options: AlignmentOptions) -> Result<Self> {
        Self::with_effort(options, QUICK)
    }

    /// A meter that looks for every corner it finds: slower, and each match as good as before.
    pub(super) fn thorough(options: AlignmentOptions) -> Result<Self> {
        Self::with_effort(options, THOROUGH)
    }

    fn with_effort(options: AlignmentOptions, effort: Effort) -> Result<Self> {
        options.validate()?;
        let (nan, matches) = (f64::NAN, Vec::new());
        Ok(Self {
            options,
            effort,
            left: View::new(effort),
            right: View::new(effort),
            residuals: Vec::new(),
            result: AlignmentError { median_px: nan, signed_median_px: nan, spread_px: nan, matches },
        })
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
            if self.left.corners.found[probe].rank < self.effort.probes_per_cell {
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
        let (shrink, slack) = (self.effort.shrink, SAME_POINT_PX);
        let reach = num_disparities.div_ceil(shrink) + slack;
        let rows = max_offset_px.div_ceil(shrink) + slack;
        let corner = &self.left.corners.found[probe];
        let found = self.right.best_match(&self.left.patches[probe], corner, [reach, slack], rows)?;
        let there = &self.right.corners.found[found];
        let back = self.left.best_match(&self.right.patches[found], there, [slack, reach], rows)?;
        if !self.left.corners.found[back].is_near(corner) {
            return None;
        }
        let [here, there] = [corner, there].map(|corner| corner.position().map(|v| v * shrink));
        let right_px = refine::locate(left, here, right, there)?;
        let found = PointMatch { left_px: here.map(|v| v as f64), right_px };
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

/// How much is looked at.
#[derive(Debug, Clone, Copy)]
struct Effort {
    /// Corners are sought and compared in images smaller by this factor, 1 or 2.
    shrink: usize,
    /// Strongest corners of every cell of the left image that are looked for in the right one.
    probes_per_cell: u16,
    spread: Spread,
}

/// The corners of one image and the patches around them.
#[derive(Debug)]
struct View {
    shrink: usize,
    /// The image at half size and its mask.
    half: [Image<u8>; 2],
    corners: CornerDetector,
    patches: Vec<Patch>,
}

impl View {
    fn new(effort: Effort) -> Self {
        Self {
            shrink: effort.shrink,
            half: [Image::default(), Image::default()],
            corners: CornerDetector::new(effort.spread),
            patches: Vec::new(),
        }
    }

    fn describe(&mut self, image: ImageRef<'_, u8>, valid: Option<ImageRef<'_, u8>>) {
        let Self { shrink, half: [half, half_valid], corners, patches } = self;
        let (mut image, mut valid) = (image, valid);
        if *shrink == 2 {
            halve(image, half, |pixels| ((pixels.iter().map(|&p| u16::from(p)).sum::<u16>() + 2) >> 2) as u8);
            image = half.view();
            valid = valid.map(|mask| {
                halve(mask, half_valid, |pixels| pixels.into_iter().fold(255, Ord::min));
                half_valid.view()
            });
        }
        // A patch must fit here, and the fit at full size there.
        corners.detect(image, valid, (refine::MARGIN / *shrink + 1).max(patch::HALF));
        patches.clear();
        patches
            .extend(corners.found.iter().map(|c| Patch::around(image, usize::from(c.x), usize::from(c.y))));
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

/// Combines four pixels into one; an odd last row or column is left out.
fn halve(image: ImageRef<'_, u8>, half: &mut Image<u8>, combine: impl Fn([u8; 4]) -> u8) {
    half.resize(image.width() / 2, image.height() / 2);
    for y in 0..half.height() {
        let (upper, lower) = (image.row(2 * y).as_chunks::<2>().0, image.row(2 * y + 1).as_chunks::<2>().0);
        for ((out, a), b) in half.row_mut(y).iter_mut().zip(upper).zip(lower) {
            *out = combine([a[0], a[1], b[0], b[1]]);
        }
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
