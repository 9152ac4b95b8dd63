//! Dense matching along scan-lines, left image as reference.

mod map;
mod params;

pub use map::{DisparityMap, Validity};
pub use params::{MatcherParams, Method, Prefilter};
