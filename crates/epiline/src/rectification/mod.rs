//! Maps that put epipolar lines on scan-lines, and how well they lie there.

mod alignment;
mod drift;
mod geometry;
mod projection;
mod rectifier;
mod remap;
mod uncalibrated;
mod view;

pub use alignment::{
    AlignmentError, AlignmentMeter, AlignmentOptions, MIN_MATCHES, PointMatch, alignment_error,
};
pub use drift::{Drift, DriftAxis, DriftMeter, realign};
pub use geometry::RectifiedGeometry;
pub use projection::Projection;
pub use rectifier::{Rectifier, RectifierOptions, Scale};
pub use remap::Remap;
pub use uncalibrated::{PairAlignment, align_pair};
