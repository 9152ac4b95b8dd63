//! What can be asked of the bundle adjustment.

use crate::camera::{Brown, KannalaBrandt, Lens, Rational, StereoCalibration, ThinPrism};

/// Which lens is solved for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LensModel {
    /// k1, k2, p1, p2: the default. On four real rigs k3 raised the held-out error of one by 60 %, lowered that of
    /// another by 5 % and left two as they were (`benchmarks/calibration_anchors.py`).
    #[default]
    Brown4,
    /// k1, k2, p1, p2, k3.
    Brown5,
    /// The same and k4, k5, k6: for lenses of 80 degrees and more that are no fisheyes.
    Rational,
    /// The same and s1, s2, s3, s4: for lenses whose elements are tilted.
    ThinPrism,
    /// Kannala and Brandt's k1 to k4, of the angle: for fisheyes.
    Fisheye,
}

impl LensModel {
    /// All models and their names, the simplest first.
    pub const ALL: [(&'static str, Self); 5] = [
        ("brown4", Self::Brown4),
        ("brown5", Self::Brown5),
        ("rational", Self::Rational),
        ("thin-prism", Self::ThinPrism),
        ("fisheye", Self::Fisheye),
    ];

    /// A lens of the model that bends nothing.
    pub(super) fn lens(self) -> Lens {
        match self {
            Self::Brown4 | Self::Brown5 => Lens::Brown(Brown::default()),
            Self::Rational => Lens::Rational(Rational::default()),
            Self::ThinPrism => Lens::ThinPrism(ThinPrism::default()),
            Self::Fisheye => Lens::KannalaBrandt(KannalaBrandt::default()),
        }
    }
}

/// How the distance of a corner from its prediction is punished.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Least squares: the optimum for Gaussian noise, at the mercy of every misplaced corner.
    Squared,
    /// Huber's loss: quadratic up to `sigmas` times the noise of the corners, linear beyond; and corners farther off
    /// than `outlier_sigmas` are left out and named in the result.
    ///
    /// The noise is read from the median residual, so clean corners keep their full weight whatever the camera.
    Huber {
        /// Threshold in standard deviations of one coordinate.
        sigmas: f64,
        /// Limit beyond which a corner is mis-found, in standard deviations of its photograph or of all, whichever
        /// are larger; infinite: none is left out.
        outlier_sigmas: f64,
    },
}

impl Default for Loss {
    /// Huber at 3 sigma: of Gaussian corners 1 in 90 lies beyond, and only barely. Beyond 4.5 lie 4 in 100 000.
    fn default() -> Self {
        Self::Huber { sigmas: 3.0, outlier_sigmas: 4.5 }
    }
}

/// Which parameters are held, and which have one value.
///
/// Names are those of [`StereoCalibration::parameter_names`]; without `left_` and `right_` they mean both cameras, and
/// `lens` means all coefficients of the lens.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Constraints {
    /// Parameters that keep the value of `initial`, or else the image centre and a lens that bends nothing.
    pub fixed: Vec<String>,
    /// Parameters of a camera that are the same in both, such as `fx`, `lens`.
    pub shared: Vec<String>,
    /// Whether fx = fy in each camera.
    pub square_pixels: bool,
    /// Where the fit starts, and what fixed parameters are.
    pub initial: Option<StereoCalibration>,
}

/// Settings of [`calibrate`](super::calibrate).
#[derive(Debug, Clone, PartialEq)]
pub struct BundleOptions {
    /// Lens model.
    pub lens: LensModel,
    /// Loss.
    pub loss: Loss,
    /// What is held and what is shared.
    pub constraints: Constraints,
    /// Whether the board's bend is solved for: two heights, of parabolas along its sides.
    pub solve_warp: bool,
    /// Into how many interleaved parts the views are divided for the held-out epipolar error; 0 leaves it unknown.
    ///
    /// With fewer than four views per part each view is left out on its own. Each part costs another fit.
    pub held_out_folds: usize,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self {
            lens: LensModel::default(),
            loss: Loss::default(),
            constraints: Constraints::default(),
            solve_warp: false,
            held_out_folds: 2,
        }
    }
}
