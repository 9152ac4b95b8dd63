//! Maps that put epipolar lines on scan-lines, and how well they lie there.

mod alignment;
mod geometry;
mod rectifier;
mod remap;
mod view;

pub use alignment::{
    AlignmentError, AlignmentMeter, AlignmentOptions, MIN_MATCHES, PointMatch, alignment_error,
};
pub use geometry::RectifiedGeometry;
pub use rectifier::{Rectifier, RectifierOptions};
pub use remap::Remap;
