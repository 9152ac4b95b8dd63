//! From two cameras to obstacle ranges, on a CPU.

pub mod calibration;
pub mod camera;
pub mod error;
pub mod image;
pub mod kernels;
pub mod matching;
pub mod preprocess;
pub mod rectification;

pub use error::{Error, Result};
