//! What a user can choose about matching: meaning, legal range, default, and what to try.

use crate::error::{Error, Result};
use crate::kernels::sad::fits_u16;
use crate::kernels::select::Subpixel;
use crate::kernels::semi_global::{LARGEST_PENALTY, MAX_BLOCK_SIZE};

/// How pixels are matched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Sum of absolute differences over a square window (eq. 5 of the paper).
    #[default]
    Sad,
    /// Sums of absolute differences over the window around the pixel and the best two of four around its corners
    /// (Hirschmüller, Innocent and Garibaldi, IJCV 2002): keeps to the edges of objects.
    Sad5,
    /// Hamming distance of the 5x5 census (Zabih and Woodfill, ECCV 1994), summed over a square window: indifferent to
    /// exposure, and keeps to edges.
    Census,
    /// Sampling-insensitive differences (Birchfield and Tomasi, PAMI 1998) of the prefiltered image and a quarter of those
    /// of grey values, summed over a square window: the least disturbed by noise, but both cameras must be equally exposed.
    Bt,
    /// Semi-global matching (Hirschmüller, PAMI 2008) on sampling-insensitive differences and the census: slower, but it
    /// reaches across surfaces without texture and keeps to the edges of objects.
    Sgm,
}

impl Method {
    /// Every method, in the order of what a pixel costs.
    pub const ALL: [Self; 5] = [Self::Sad, Self::Sad5, Self::Census, Self::Bt, Self::Sgm];

    /// The name it is asked for by.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sad => "sad",
            Self::Sad5 => "sad5",
            Self::Census => "census",
            Self::Bt => "bt",
            Self::Sgm => "sgm",
        }
    }
}

/// What is done to both images before they are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Prefilter {
    /// Grey values as they are, as in the paper. Needs both cameras equally exposed.
    None,
    /// Horizontal Sobel derivative, clipped: insensitive to exposure differences.
    #[default]
    XSobel,
}

/// Parameters of a [`StereoMatcher`](super::StereoMatcher).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatcherParams {
    /// How pixels are matched.
    pub method: Method,
    /// How many whole-pixel disparities to search, 1 to 1024. Must cover the nearest obstacle: `f·b / Z_near`.
    pub num_disparities: usize,
    /// Smallest disparity to search, px, 0 to 4095 - `num_disparities`. Above zero, far things are not seen. Together
    /// with `num_disparities` it must not exceed the images' width.
    pub min_disparity: usize,
    /// Side of the window, odd, 1 to 31 px (15 for [`Method::Sgm`]). Larger is smoother and fattens edges. Try 9 on
    /// sharp, 15 on noisy images; 7 or 9 for [`Method::Sad5`], where it is that of each of the five windows; 3 or 5 for
    /// [`Method::Sgm`]. In large windows of [`Method::Sad5`] and [`Method::Bt`] differences of pixels are truncated, at
    /// `65 534 / 3n²` and `65 534 / n²` grey levels, so that sums fit 16 bits: with the prefilter's default from 19 and
    /// 23 px on.
    pub block_size: usize,
    /// Applied to both images; [`Method::Census`] compares grey values in any case.
    pub prefilter: Prefilter,
    /// Derivatives are clipped to plus or minus this, 1 to 63 grey levels.
    pub prefilter_cap: u8,
    /// Reject unless every candidate beyond the best and its two neighbours costs more than the best and this many
    /// percent of it, 0 (off) to 100 (OpenCV's `uniquenessRatio`).
    pub uniqueness_ratio: u8,
    /// Reject windows of the left image whose texture, the sum of `|x-Sobel|` clipped by
    /// [`prefilter_cap`](Self::prefilter_cap), is below this many grey levels over the whole window; 0 is off
    /// (OpenCV's `textureThreshold`). It is measured so with either prefilter.
    pub texture_threshold: u32,
    /// Reject where the right image's own best match, over all its candidates, differs by more than this many whole
    /// pixels; `None` is off. If several of its candidates cost the same, one of them within reach is enough.
    pub left_right_max_diff: Option<u16>,
    /// Reject islands of at most this many pixels; 0 is off (OpenCV's `speckleWindowSize`).
    pub speckle_size: usize,
    /// Neighbours belong to one island if their disparities differ by no more than this, px.
    pub speckle_range: u16,
    /// Refine to 1/16 px from the costs of both neighbours, by which fit. [`Subpixel::VFit`] is as good as the
    /// other or better with every method (`docs/methods.md`).
    pub subpixel: Subpixel,
    /// [`Method::Sad`]: weight of semi-global costs from half the resolution, which are added to the window's and guide
    /// it where it has little texture of its own; 0 (off) to 25 % of their sums per pixel of the window. They need
    /// `width·height·num_disparities / 8` bytes. Try 4.
    pub coarse_weight: u8,
    /// Answer everywhere: pixels that have no value, or were rejected, take the smaller of their row's nearest values and
    /// become [`FILLED`](super::Validity::FILLED); then a 3x3 median and, there and at steps of disparity, a median
    /// weighted by the likeness of grey values.
    pub fill: bool,
    /// Smooth surfaces, but not across steps of more than 2 px nor edges of the image (Min et al., TIP 2014).
    pub smooth: bool,
    /// [`Method::Sgm`]: how many paths meet in a pixel. 3: from the left, the right and above; 4: from below too, which
    /// needs `2·width·height·num_disparities` bytes.
    pub paths: usize,
    /// [`Method::Sgm`]: penalty for steps of one disparity, 0 to 127 grey levels. Larger is smoother.
    pub p1: u8,
    /// [`Method::Sgm`]: penalty for larger steps between equal grey values, [`p1`](Self::p1) to 127 grey levels. Where
    /// grey values differ it falls toward `p1`.
    pub p2: u8,
    /// Reject windows of the left image of which at least this many percent are at 0 or 255, 0 (off) to 100.
    pub saturation_threshold: u8,
    /// Threads; `None` is all cores, and `EPILINE_THREADS` caps either. The result does not depend on it.
    pub threads: Option<usize>,
}

impl Default for MatcherParams {
    fn default() -> Self {
        Self {
            method: Method::Sad,
            num_disparities: 64,
            min_disparity: 0,
            block_size: 15,
            prefilter: Prefilter::XSobel,
            prefilter_cap: 31,
            uniqueness_ratio: 0,
            texture_threshold: 0,
            left_right_max_diff: None,
            speckle_size: 0,
            speckle_range: 2,
            subpixel: Subpixel::VFit,
            coarse_weight: 0,
            fill: false,
            smooth: false,
            paths: 4,
            p1: 48,
            p2: 127,
            saturation_threshold: 0,
            threads: None,
        }
    }
}

impl MatcherParams {
    /// Largest number of disparities.
    pub const MAX_DISPARITIES: usize = 1024;
    /// Largest window side, pixels.
    pub const MAX_BLOCK_SIZE: usize = 31;
    /// Largest weight of coarse costs, percent: what is added stays below `255·31²·25 % < 2¹⁶`.
    pub const MAX_COARSE_WEIGHT: u8 = 25;
    /// Disparities are stored in sixteenths in 16 bits, so none reaches 4096.
    pub const MAX_DISPARITY: usize = 4095;

    /// The defaults of a method. The window of all but [`Method::Sad`] and [`Method::Sgm`] is the one with the fewest
    /// pixels off by more than 1 px on the even of the 27 public scenes in the order of their names, without tests; of
    /// two that differ by less than 0.1 points, the smaller.
    pub fn for_method(method: Method) -> Self {
        match method {
            Method::Sad => Self::default(),
            Method::Sad5 => Self { method, block_size: 9, ..Self::default() },
            Method::Census | Method::Bt => Self { method, block_size: 11, ..Self::default() },
            Method::Sgm => Self { method, block_size: 3, prefilter_cap: 15, ..Self::default() },
        }
    }

    /// What the excess of coarse costs counts per window, in units of 1/256, rounded up: `25 %·31²·256 < 2¹⁶`.
    pub(super) fn coarse_cost_weight(&self) -> u16 {
        let area = (self.block_size * self.block_size) as u32;
        (u32::from(self.coarse_weight) * area * 256).div_ceil(100) as u16
    }

    /// Whether costs from half the resolution are added to those of windows.
    pub(super) fn is_guided(&self) -> bool {
        self.method == Method::Sad && self.coarse_weight > 0
    }

    /// Whether 16 bits are enough for the costs of [`Method::Sad`].
    pub(super) fn fits_u16(&self) -> bool {
        let coarse = (u32::from(u8::MAX) * u32::from(self.coarse_cost_weight())) >> 8;
        fits_u16(self.largest_difference(), self.block_size, coarse as usize)
    }

    /// Half the window: its side is `2 * radius + 1`.
    pub(super) fn radius(&self) -> usize {
        self.block_size / 2
    }

    /// The largest difference of two prefiltered pixels.
    pub(super) fn largest_difference(&self) -> u8 {
        match self.prefilter {
            Prefilter::None => u8::MAX,
            Prefilter::XSobel => 2 * self.prefilter_cap,
        }
    }

    /// How far the left–right test looks, if it can reject anything: a reach over all disparities accepts everything.
    pub(super) fn left_right_reach(&self) -> Option<usize> {
        self.left_right_max_diff.map(usize::from).filter(|&reach| reach + 1 < self.num_disparities)
    }

    /// Fails unless the right image has room for every disparity.
    pub(super) fn require_width(&self, width: usize) -> Result<()> {
        if self.min_disparity + self.num_disparities > width {
            return Err(Error::invalid(
                "num_disparities",
                format!("{} px", self.num_disparities),
                format!(
                    "min_disparity + num_disparities = {} px must not exceed the images' width of {width} px",
                    self.min_disparity + self.num_disparities
                ),
            ));
        }
        Ok(())
    }

    /// Window sums guided by coarse costs, and every test on, for answers that can be relied on: of the public scenes with
    /// ground truth 85 % of the pixels remain, and 3 % of those are off by more than 2 px. Chosen on half of the scenes.
    pub fn with_all_tests() -> Self {
        Self {
            block_size: 7,
            prefilter_cap: 24,
            uniqueness_ratio: 35,
            texture_threshold: 10,
            left_right_max_diff: Some(1),
            speckle_size: 200,
            speckle_range: 1,
            coarse_weight: 5,
            ..Self::default()
        }
    }

    /// Fails with the name and value of the first parameter outside its range.
    pub fn validate(&self) -> Result<()> {
        let n = self.num_disparities;
        if n == 0 || n > Self::MAX_DISPARITIES {
            let expected = format!("must be 1 to {} px", Self::MAX_DISPARITIES);
            return Err(Error::invalid("num_disparities", format!("{n} px"), expected));
        }
        if self.min_disparity + n > Self::MAX_DISPARITY {
            return Err(Error::invalid(
                "min_disparity",
                format!("{} px", self.min_disparity),
                format!("min_disparity + num_disparities must not exceed {} px", Self::MAX_DISPARITY),
            ));
        }
        if self.block_size.is_multiple_of(2) || self.block_size > Self::MAX_BLOCK_SIZE {
            return Err(Error::invalid(
                "block_size",
                format!("{} px", self.block_size),
                format!("must be odd, 1 to {} px", Self::MAX_BLOCK_SIZE),
            ));
        }
        if self.method == Method::Sgm {
            self.validate_sgm()?;
        }
        if !(1..=63).contains(&self.prefilter_cap) {
            return Err(Error::invalid("prefilter_cap", self.prefilter_cap, "must be 1 to 63 grey levels"));
        }
        if self.coarse_weight > Self::MAX_COARSE_WEIGHT {
            return Err(Error::invalid(
                "coarse_weight",
                format!("{} %", self.coarse_weight),
                format!("must be 0 to {} %", Self::MAX_COARSE_WEIGHT),
            ));
        }
        if self.uniqueness_ratio > 100 {
            return Err(Error::invalid(
                "uniqueness_ratio",
                format!("{} %", self.uniqueness_ratio),
                "must be 0 to 100 %",
            ));
        }
        if self.saturation_threshold > 100 {
            let value = format!("{} %", self.saturation_threshold);
            return Err(Error::invalid("saturation_threshold", value, "must be 0 to 100 %"));
        }
        if self.threads == Some(0) {
            return Err(Error::invalid("threads", 0, "must be at least 1, or None for all cores"));
        }
        Ok(())
    }

    fn validate_sgm(&self) -> Result<()> {
        if self.block_size > MAX_BLOCK_SIZE {
            return Err(Error::invalid(
                "block_size",
                format!("{} px", self.block_size),
                format!("must be odd, 1 to {MAX_BLOCK_SIZE} px for semi-global matching"),
            ));
        }
        if !(3..=4).contains(&self.paths) {
            return Err(Error::invalid("paths", self.paths, "must be 3 or 4"));
        }
        if self.p1 > LARGEST_PENALTY {
            let expected = format!("must be 0 to {LARGEST_PENALTY} grey levels");
            return Err(Error::invalid("p1", self.p1, expected));
        }
        if !(self.p1..=LARGEST_PENALTY).contains(&self.p2) {
            let expected = format!("must be p1 = {} to {LARGEST_PENALTY} grey levels", self.p1);
            return Err(Error::invalid("p2", self.p2, expected));
        }
        Ok(())
    }
}
