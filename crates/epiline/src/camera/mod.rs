//! One camera, the pose between two, and the calibrated pair.

mod calibration;
pub mod formats;
mod lens;
mod model;
mod uncertainty;

pub(crate) use lens::distorted_radius;

pub use calibration::{
    AlignedFrame, BoardWarp, DepthVariance, Outlier, Pose, StereoCalibration, ViewResidual,
};
pub use lens::{Brown, KannalaBrandt, Lens, LensFormula, LensImage, LensView, Rational, ThinPrism, Tsai};
pub use model::{CameraModel, CameraView};
