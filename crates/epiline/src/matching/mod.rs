//! Dense matching along scan-lines, left image as reference.
//!
//! [`StereoMatcher`] owns every buffer. A frame passes through: prefilter → window costs and best candidates →
//! sub-pixel and uniqueness → left–right → texture, all row by row in stripes that share nothing, then speckle over the
//! whole map, then filling and smoothing, where asked for, with the left image as their guide. Each test adds its own
//! bit of [`Validity`]; none reads another's, except that speckle looks only at what is left.
//!
//! [`brute_force`] is the same definition without running sums: slow, short, and what the matcher is tested against.

mod aligned;
mod blocked;
pub mod brute_force;
mod choices;
mod coarse;
mod confidence;
mod crew;
mod edges;
mod features;
mod fill;
mod left_right;
mod map;
mod matcher;
mod params;
mod prepared;
mod presets;
mod regions;
mod row_queue;
mod saturation;
mod semi_global;
mod smooth;
mod speckle;
mod stripe;
mod texture;
mod texture_test;
mod threads;
mod windowed;

pub use map::{DisparityMap, Validity};
pub use matcher::StereoMatcher;
pub use params::{MatcherParams, Method, Prefilter};
pub use presets::Preset;
pub use regions::MatchRegion;

pub use crate::kernels::select::Subpixel;
