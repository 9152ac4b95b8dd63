//! One camera, the pose between two, and the calibrated pair.

mod calibration;
pub mod formats;
mod model;
mod uncertainty;

pub use calibration::{AlignedFrame, DepthVariance, Parameter, Pose, StereoCalibration, ViewResidual};
pub use model::{CameraModel, Distortion};
