//! How far a rig measures well enough.

use super::triangulation::check_disparity_sigma;
use crate::error::{Error, Result};
use crate::rectification::RectifiedGeometry;

/// The depth up to which the standard deviation of a depth stays below a share of it, metres; infinite where it never
/// exceeds that, 0 where it always does.
///
/// By `σ² = (Z²·σ_d / (f·b))² + z2·Z² + z3·Z³ + z4·Z⁴` the squared share `σ²/Z²` is a parabola in Z. On the optical axis; a
/// range is to its depth as its standard deviation is to the depth's.
///
/// # Errors
///
/// [`Error::InvalidParameter`] unless `disparity_sigma_px` is finite and not negative and `share` positive; for a
/// cylindrical pair.
pub fn useful_depth_m(geometry: &RectifiedGeometry, disparity_sigma_px: f64, share: f64) -> Result<f64> {
    check_disparity_sigma(disparity_sigma_px)?;
    geometry.require_pinhole("useful_depth_m")?;
    if share.is_nan() || share <= 0.0 {
        return Err(Error::invalid("share", share, "must be positive"));
    }
    let calibration = geometry.calibration_variance;
    let per_metre = disparity_sigma_px / (geometry.focal_px * geometry.baseline_m);
    let (square, linear) = (per_metre * per_metre + calibration.z4, calibration.z3);
    let at_zero = calibration.z2 - share * share;
    if at_zero >= 0.0 {
        return Ok(0.0);
    }
    // The first positive root of square·Z² + linear·Z + at_zero, in the form that loses no digits.
    let discriminant = linear * linear - 4.0 * square * at_zero;
    let divisor = linear + discriminant.max(0.0).sqrt();
    Ok(if discriminant >= 0.0 && divisor > 0.0 { -2.0 * at_zero / divisor } else { f64::INFINITY })
}
