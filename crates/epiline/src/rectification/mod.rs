//! Maps that put epipolar lines on scan-lines, and how well they lie there.

mod geometry;

pub use geometry::RectifiedGeometry;
