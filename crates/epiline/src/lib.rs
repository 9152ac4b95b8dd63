//! From two cameras to obstacle ranges, on a CPU.

pub mod calibration;
pub mod camera;
pub mod error;
pub mod image;
pub mod kernels;
pub mod matching;
pub mod obstacles;
pub mod pipeline;
pub mod preprocess;
pub mod range;
pub mod rectification;
pub mod regions;

pub use error::{Error, Result};
