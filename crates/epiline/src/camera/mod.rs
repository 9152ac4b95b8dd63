//! One camera, the pose between two, and the calibrated pair.

mod calibration;
mod model;

pub use calibration::{AlignedFrame, DepthVariance, Parameter, Pose, StereoCalibration, ViewResidual};
pub use model::{CameraModel, Distortion};
