//! What a set of board views must satisfy before anything is computed from it.

use super::{BoardView, Loss};
use crate::error::{Error, Result};

/// Corners that a camera must have seen of a view for a pose; four determine its homography, the rest are what the fit is checked against.
pub(super) const MIN_CORNERS: usize = 6;

/// The largest image side accepted, pixels.
const MAX_SIDE_PX: usize = 16_384;

/// Fails, naming the view and corner, unless every view is finite, flat and inside the image, and enough of it seen.
pub(super) fn check(views: &[BoardView], (width, height): (usize, usize), min_views: usize) -> Result<()> {
    if width == 0 || height == 0 || width > MAX_SIDE_PX || height > MAX_SIDE_PX {
        let sides = format!("{width}x{height} px");
        return Err(Error::invalid("image_size", sides, format!("each side must be 1 to {MAX_SIDE_PX} px")));
    }
    if views.len() < min_views {
        return Err(Error::NotEnoughData { what: "board views", actual: views.len(), needed: min_views });
    }
    for (v, view) in views.iter().enumerate() {
        let corners = view.board_m.len();
        for (name, list) in [("left_px", &view.left_px), ("right_px", &view.right_px)] {
            if list.len() != corners {
                return Err(Error::invalid(
                    name,
                    format!("{} corners in view {v}", list.len()),
                    format!("board_m has {corners} there; the lists must have one length"),
                ));
            }
            check_pixels(name, v, list, (width, height))?;
        }
        let most = view.seen_by(0).max(view.seen_by(1));
        if most < MIN_CORNERS {
            let what = "corners in one view, seen by one camera,";
            return Err(Error::NotEnoughData { what, actual: most, needed: MIN_CORNERS });
        }
        check_board(v, &view.board_m)?;
    }
    Ok(())
}

/// Fails unless a loss's threshold is a positive number.
pub(super) fn check_loss(loss: Loss) -> Result<()> {
    match loss {
        Loss::Huber { sigmas, .. } if sigmas.is_nan() || sigmas <= 0.0 => {
            Err(Error::invalid("sigmas", sigmas, "the Huber threshold must be positive"))
        }
        Loss::Huber { outlier_sigmas, .. } if outlier_sigmas.is_nan() || outlier_sigmas < 2.0 => {
            let expected = "must be at least 2: nearer corners are ordinary ones";
            Err(Error::invalid("outlier_sigmas", outlier_sigmas, expected))
        }
        _ => Ok(()),
    }
}

fn check_pixels(
    name: &'static str,
    view: usize,
    list: &[[f64; 2]],
    (width, height): (usize, usize),
) -> Result<()> {
    for (c, [x, y]) in list.iter().enumerate() {
        let place = || format!("({x}, {y}) px at view {view}, corner {c}");
        if x.is_nan() && y.is_nan() {
            continue;
        }
        if !(x.is_finite() && y.is_finite()) {
            let expected = "every corner must be finite, or NaN in both coordinates where it was not seen";
            return Err(Error::invalid(name, place(), expected));
        }
        // Sub-pixel refinement may end just outside the outermost pixel centres.
        if *x < -1.0 || *y < -1.0 || *x > width as f64 || *y > height as f64 {
            return Err(Error::invalid(name, place(), format!("outside the {width}x{height} px image")));
        }
    }
    Ok(())
}

fn check_board(view: usize, board_m: &[[f64; 3]]) -> Result<()> {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for (c, point) in board_m.iter().enumerate() {
        if !point.iter().all(|v| v.is_finite()) {
            let place = format!("({}, {}, {}) m at view {view}, corner {c}", point[0], point[1], point[2]);
            return Err(Error::invalid("board_m", place, "every coordinate must be finite"));
        }
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let side_m = (high[0] - low[0]).max(high[1] - low[1]);
    let relief_m = high[2].abs().max(low[2].abs());
    if relief_m > 0.05 * side_m {
        return Err(Error::invalid(
            "board_m",
            format!("z up to {relief_m} m on a board of {side_m} m (view {view})"),
            "boards must lie in the plane z = 0",
        ));
    }
    Ok(())
}
