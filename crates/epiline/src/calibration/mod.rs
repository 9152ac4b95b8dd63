//! From corners of a board, seen by both cameras, to a [`StereoCalibration`].
//!
//! [`calibrate`] is bundle adjustment: both cameras, the pose between them and all board poses together, started
//! from Zhang's closed form. [`tsai`] is the method of the 2011 paper, for one camera and for a pair.

mod bundle;
mod held_out;
mod homography;
mod input;
mod lens;
mod rig;
mod solver;
mod start;
pub mod tsai;

pub use bundle::calibrate;

/// One board as both cameras saw it: entry `i` of each list is one corner.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardView {
    /// Where the left camera saw the corners (x, y), pixels.
    pub left_px: Vec<[f64; 2]>,
    /// Where the right camera saw them, pixels.
    pub right_px: Vec<[f64; 2]>,
    /// Where they are on the board (x, y, z), metres; the board is flat: z is zero or next to it.
    pub board_m: Vec<[f64; 3]>,
}

/// Which distortion coefficients are solved for; the others stay zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum LensModel {
    /// k1, k2, p1, p2: the default. On four real rigs k3 raised the held-out error of one by 60 %, lowered that of
    /// another by 5 % and left two as they were (`benchmarks/calibration_anchors.py`).
    #[default]
    Brown4,
    /// k1, k2, p1, p2, k3.
    Brown5,
}

/// How the distance of a corner from its prediction is punished.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// Least squares: the optimum for Gaussian noise, at the mercy of every misplaced corner.
    Squared,
    /// Huber's loss: quadratic up to `sigmas` times the noise of the corners, linear beyond.
    ///
    /// The noise is read from the median residual, so clean corners keep their full weight whatever the camera.
    Huber {
        /// Threshold in standard deviations of one coordinate.
        sigmas: f64,
    },
}

impl Default for Loss {
    /// Huber at 3 sigma: of Gaussian corners 1 in 90 lies beyond, and only barely.
    fn default() -> Self {
        Self::Huber { sigmas: 3.0 }
    }
}

/// Settings of [`calibrate`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BundleOptions {
    /// Distortion model.
    pub lens: LensModel,
    /// Loss.
    pub loss: Loss,
    /// Into how many interleaved parts the views are divided for the held-out epipolar error; 0 leaves it unknown.
    ///
    /// With fewer than four views per part each view is left out on its own. Each part costs another fit.
    pub held_out_folds: usize,
}

impl Default for BundleOptions {
    fn default() -> Self {
        Self { lens: LensModel::default(), loss: Loss::default(), held_out_folds: 2 }
    }
}
