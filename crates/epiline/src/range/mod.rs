//! Disparity to metres: by triangulation ([`to_range`], eq. 1–2 of the paper) and by a curve fitted to measured
//! distances ([`fit_range_curve`], eq. 6).

mod curve;
mod fit;
mod student;
mod triangulation;

pub use curve::RangeCurve;
pub use fit::fit_range_curve;
pub use triangulation::{RangeImage, Triangulation, to_range};
pub(crate) use triangulation::{check_disparity_sigma, check_size, depth_sigma_m};
