//! How well the epipolar lines of an aligned pair lie on its scan-lines, from the pair's own content.

mod corners;
mod patch;
mod refine;

use corners::{Corner, CornerDetector, Spread};
use patch::{Comparison, Patches};

use crate::error::{Error, Result};
use crate::image::{Image, ImageRef};
use crate::kernels::alignment::corners::HalveRow;
use crate::kernels::{Kernels, Level};

/// Fewest matches from which a residual is stated.
pub const MIN_MATCHES: usize = 12;
/// Corners of the images at half size, the best of each cell looked for in the other image: enough for medians and
/// slopes.
const QUICK: Effort =
    Effort { shrink: 2, probes: 300, spread: Spread { cells: 20, min_cell_px: 12, area_per_corner_px: 72 } };
/// Every corner that there is at full size.
const THOROUGH: Effort = Effort {
    shrink: 1,
    probes: usize::MAX,
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
    kernels: Kernels,
    left: View,
    right: View,
    comparison: BestOf,
    residuals: Vec<f64>,
    result: AlignmentError,
}

impl AlignmentMeter {
    /// A meter. Fails if an option is out of its range.
    pub fn new(options: AlignmentOptions) -> Result<Self> {
        Self::with_level(options, Level::current())
    }

    /// A meter that uses the kernels of `level`; its answers are the same at every level.
    pub fn with_level(options: AlignmentOptions, level: Level) -> Result<Self> {
        Self::with_effort(options, QUICK, level)
    }

    /// A meter that looks for every corner it finds: slower, and each match as good as before.
    pub(super) fn thorough(options: AlignmentOptions) -> Result<Self> {
        Self::with_effort(options, THOROUGH, Level::current())
    }

    fn with_effort(options: AlignmentOptions, effort: Effort, level: Level) -> Result<Self> {
        options.validate()?;
        let (nan, matches) = (f64::NAN, Vec::new());
        let kernels = Kernels::new(level);
        Ok(Self {
            options,
            effort,
            kernels,
            left: View::new(effort, kernels),
            right: View::new(effort, kernels),
            comparison: BestOf::default(),
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
        let (width, height) = (left.width() / self.effort.shrink, left.height() / self.effort.shrink);
        let cells = self.effort.spread.cell_count(width, height);
        let probes_per_cell = self.effort.probes.div_ceil(cells.max(1));
        for probe in 0..self.left.corners.found.len() {
            if usize::from(self.left.corners.found[probe].rank) < probes_per_cell {
                let found = self.match_probe(probe, left, right);
                self.result.matches.extend(found);
            }
        }
        self.summarise();
        Ok(&self.result)
    }

    fn match_probe(
        &mut self,
        probe: usize,
        left: ImageRef<'_, u8>,
        right: ImageRef<'_, u8>,
    ) -> Option<PointMatch> {
        let AlignmentOptions { num_disparities, max_offset_px } = self.options;
        let (shrink, slack) = (self.effort.shrink, SAME_POINT_PX);
        let reach = num_disparities.div_ceil(shrink) + slack;
        let rows = max_offset_px.div_ceil(shrink) + slack;
        let (here, there) = ((&self.left, left), (&self.right, right));
        let found = self.comparison.find(&self.kernels, here, probe, there, [reach, slack], rows)?;
        let back = self.comparison.find(&self.kernels, there, found, here, [slack, reach], rows)?;
        let corner = &self.left.corners.found[probe];
        if !self.left.corners.found[back].is_near(corner) {
            return None;
        }
        let [here, there] =
            [corner, &self.right.corners.found[found]].map(|corner| corner.position().map(|v| v * shrink));
        let right_px = refine::locate(&self.kernels, left, here, right, there)?;
        let found = PointMatch { left_px: here.map(|v| v as f64), right_px };
        let disparity_px = found.left_px[0] - found.right_px[0];
        let looked_at = disparity_px > -1.0
            && disparity_px <= num_disparities as f64
            && found.vertical_px().abs() <= max_offset_px as f64;
        looked_at.then_some(found)
    }

    /// The same point in both images, located precisely from where it is known to a pixel or two: x, y in the left and
    /// in the right image. `None` at the images' edges, near pixels without a source and where nothing can be located.
    pub(super) fn locate_near(
        &self,
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
        let right_px = refine::locate(&self.kernels, images[0], left, images[1], right)?;
        Some(PointMatch { left_px: left.map(|v| v as f64), right_px })
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

/// How much is looked at.
#[derive(Debug, Clone, Copy)]
struct Effort {
    /// Corners are sought and compared in images smaller by this factor, 1 or 2.
    shrink: usize,
    /// About so many corners of the left image are looked for in the right one, the strongest of each cell.
    probes: usize,
    spread: Spread,
}

/// The corners of one image and the patches around them.
#[derive(Debug)]
struct View {
    shrink: usize,
    kernels: Kernels,
    /// The image at half size and its mask.
    half: [Image<u8>; 2],
    corners: CornerDetector,
    patches: Patches,
}

impl View {
    fn new(effort: Effort, kernels: Kernels) -> Self {
        Self {
            shrink: effort.shrink,
            kernels,
            half: [Image::default(), Image::default()],
            corners: CornerDetector::new(effort.spread, kernels),
            patches: Patches::default(),
        }
    }

    fn describe(&mut self, image: ImageRef<'_, u8>, valid: Option<ImageRef<'_, u8>>) {
        let Self { shrink, kernels, half: [half, half_valid], corners, patches } = self;
        let (mut image, mut valid) = (image, valid);
        if *shrink == 2 {
            halve(kernels, image, half);
            image = half.view();
            valid = valid.map(|mask| {
                halve_mask(mask, half_valid);
                half_valid.view()
            });
        }
        // A patch must fit here, and the fit at full size there.
        corners.detect(image, valid, (refine::MARGIN / *shrink + 1).max(patch::MARGIN));
        patches.describe(kernels, image, &corners.found);
    }

    /// The image in which corners are compared, of which `full` is the full size.
    fn compared<'a>(&'a self, full: ImageRef<'a, u8>) -> ImageRef<'a, u8> {
        if self.shrink == 2 { self.half[0].view() } else { full }
    }
}

/// Looks for a corner of one view in the other, and keeps its buffers.
#[derive(Debug, Default)]
struct BestOf {
    candidates: Vec<usize>,
    comparison: Comparison,
}

impl BestOf {
    /// The corner in the view `there` that looks most like the one `here`, within so many columns (to the left, to the
    /// right) and rows, if it does so well and no other corner does nearly as well.
    fn find(
        &mut self,
        kernels: &Kernels,
        (here, image): (&View, ImageRef<'_, u8>),
        index: usize,
        (there, other_image): (&View, ImageRef<'_, u8>),
        [left, right]: [usize; 2],
        rows: usize,
    ) -> Option<usize> {
        let Self { candidates, comparison } = self;
        let [x, y] = here.corners.found[index].position();
        let (corners, row_starts) = (&there.corners.found, &there.corners.row_starts);
        let last_row = row_starts.len() - 1;
        let band = row_starts[y.saturating_sub(rows)]..row_starts[(y + rows + 1).min(last_row)];
        let columns = x.saturating_sub(left)..=x + right;
        candidates.clear();
        candidates.extend(band.filter(|&other| columns.contains(&usize::from(corners[other].x))));
        comparison.compare(
            kernels,
            (here.compared(image), &here.patches, index),
            (there.compared(other_image), &there.patches, candidates),
        );
        let scored = || candidates.iter().copied().zip(comparison.zncc.iter().copied());
        let (best, score) = scored().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let elsewhere = scored().filter(|(other, _)| !corners[*other].is_near(&corners[best]));
        let next_score = elsewhere.map(|(_, score)| score).fold(-1.0, f32::max);
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

/// The image at half size; an odd last row or column is left out.
fn halve(kernels: &Kernels, image: ImageRef<'_, u8>, half: &mut Image<u8>) {
    half.resize(image.width() / 2, image.height() / 2);
    let used = 2 * half.width();
    for y in 0..half.height() {
        let [upper, lower] = [2 * y, 2 * y + 1].map(|y| &image.row(y)[..used]);
        kernels.halve(&mut HalveRow { upper, lower, halved: half.row_mut(y) });
    }
}

/// A mask at half size: not 0 where none of the four pixels is.
fn halve_mask(mask: ImageRef<'_, u8>, half: &mut Image<u8>) {
    half.resize(mask.width() / 2, mask.height() / 2);
    for y in 0..half.height() {
        let (upper, lower) = (mask.row(2 * y).as_chunks::<2>().0, mask.row(2 * y + 1).as_chunks::<2>().0);
        for ((out, a), b) in half.row_mut(y).iter_mut().zip(upper).zip(lower) {
            *out = a[0].min(a[1]).min(b[0]).min(b[1]);
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
