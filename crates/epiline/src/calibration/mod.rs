//! From corners of a board, seen by both cameras, to a [`StereoCalibration`].
//!
//! [`calibrate`] is bundle adjustment: both cameras, the pose between them and all board poses together, started
//! from Zhang's closed form. [`tsai`] is the method of the 2011 paper, for one camera and for a pair.

mod bundle;
mod fisheye_start;
mod freedom;
mod held_out;
mod homography;
mod input;
mod lens;
mod options;
mod rig;
mod solver;
mod start;
pub mod tsai;
mod warp;

pub use bundle::{calibrate, calibrate_choosing_lens};
pub use options::{BundleOptions, Constraints, LensModel, Loss};

/// One board as the cameras saw it: entry `i` of each list is one corner.
///
/// A corner that a camera did not see is NaN there. A view of one camera alone has nothing but NaN for the other: it
/// informs that camera, and says nothing of the pose between the two.
#[derive(Debug, Clone, PartialEq)]
pub struct BoardView {
    /// Where the left camera saw the corners (x, y), pixels.
    pub left_px: Vec<[f64; 2]>,
    /// Where the right camera saw them, pixels.
    pub right_px: Vec<[f64; 2]>,
    /// Where they are on the board (x, y, z), metres; the board is flat: z is zero or next to it.
    pub board_m: Vec<[f64; 3]>,
}

impl BoardView {
    /// Pixels of the left (0) or right camera.
    fn pixels(&self, camera: usize) -> &[[f64; 2]] {
        if camera == 0 { &self.left_px } else { &self.right_px }
    }

    /// How many corners a camera saw.
    fn seen_by(&self, camera: usize) -> usize {
        self.pixels(camera).iter().filter(|p| solver::is_seen(p)).count()
    }

    /// Corners that both cameras saw, left and right.
    fn common(&self) -> impl Iterator<Item = (&[f64; 2], &[f64; 2])> {
        let both = self.left_px.iter().zip(&self.right_px);
        both.filter(|(left, right)| solver::is_seen(left) && solver::is_seen(right))
    }
}

/// What errors call the cameras.
const CAMERAS: [&str; 2] = ["left", "right"];
