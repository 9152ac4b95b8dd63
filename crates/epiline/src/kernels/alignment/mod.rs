//! What measuring an aligned pair spends its time on: corners, patches of whole pixels, and patches between pixels.
//!
//! All bodies are portable. Sums of real numbers go by lanes in a stated order, so that every level gives the same bits.

pub mod corners;
pub mod patches;
pub mod registration;

/// Rows and columns of a patch.
pub const SIDE: usize = 13;
/// Cells of a patch's row: whole vectors, of which the first [`SIDE`] count.
pub const LANES: usize = 16;
