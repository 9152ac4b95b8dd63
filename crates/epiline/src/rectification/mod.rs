//! Maps that put epipolar lines on scan-lines, and how well they lie there.

mod alignment;
mod geometry;
mod projection;
mod rectifier;
mod remap;
mod view;

pub use alignment::{
    AlignmentError, AlignmentMeter, AlignmentOptions, MIN_MATCHES, PointMatch, alignment_error,
};
pub use geometry::RectifiedGeometry;
pub use projection::Projection;
pub use rectifier::{Rectifier, RectifierOptions, Scale};
pub use remap::Remap;
