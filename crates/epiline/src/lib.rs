//! From two cameras to obstacle ranges, on a CPU.
//!
//! The path, with a rig whose pairs come aligned ([`Pipeline::for_cameras`](pipeline::Pipeline::for_cameras) takes a
//! calibrated one):
//!
//! ```
//! use epiline::image::{Image, StereoPair};
//! use epiline::pipeline::{Pipeline, PipelineParams};
//! use epiline::rectification::RectifiedGeometry;
//! use epiline::regions::Region;
//!
//! # fn main() -> epiline::Result<()> {
//! // Focal length 300 px, principal point (160, 120) px, baseline 0.12 m.
//! let geometry = RectifiedGeometry::new(320, 240, 300.0, 160.0, 120.0, 0.0, 0.12)?;
//! let mut pipeline = Pipeline::for_aligned(
//!     geometry,
//!     vec![Region::new("ahead", 0, 80, 320, 60)],
//!     PipelineParams::for_width(320),
//! )?;
//!
//! // A textured wall that fills the view, 12 px of disparity away.
//! let texture = |x: usize, y: usize| ((x * 7919) ^ (y * 104_729) ^ (x * y * 31)) as u8;
//! let left = Image::from_fn(320, 240, texture);
//! let right = Image::from_fn(320, 240, |x, y| texture(x + 12, y));
//!
//! let result = pipeline.process(StereoPair::new(left.view(), right.view())?)?;
//! let nearest = result.profiles[0].nearest.expect("the wall");
//! assert!((nearest.depth_m - 300.0 * 0.12 / 12.0).abs() < 0.01);
//! assert!(nearest.sigma_m > 0.0);
//! # Ok(())
//! # }
//! ```

pub mod calibration;
pub mod camera;
pub mod error;
pub mod ground;
pub mod image;
pub mod kernels;
pub mod matching;
pub mod obstacles;
pub mod pipeline;
pub mod preprocess;
pub mod range;
pub mod rectification;
pub mod regions;
pub mod scan;
pub mod tracking;

pub use error::{Error, Result};
