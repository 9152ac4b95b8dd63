//! Disparity to metres: by triangulation ([`to_range`], eq. 1–2 of the paper) and by a curve fitted to measured
//! distances ([`fit_range_curve`], eq. 6).

mod confidence;
mod curve;
mod fit;
mod reach;
mod robust;
mod student;
mod triangulation;

pub use confidence::disparity_sigma_px;
pub use curve::RangeCurve;
pub use fit::fit_range_curve;
pub use reach::useful_depth_m;
pub use robust::fit_range_curve_robustly;
pub use triangulation::{RangeImage, Triangulation, to_range, to_range_by_confidence};
pub(crate) use triangulation::{check_disparity_sigma, check_size, depth_sigma_m};
