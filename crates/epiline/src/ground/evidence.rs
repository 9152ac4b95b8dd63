//! What a plane must have on it, and must not have below it, to be the ground.

use super::NoGround;
use super::plane_fit::DisparityPlane;
use super::samples::{COLUMNS, NOTHING, Samples};
use super::search::Held;
use super::sums::total;
use crate::rectification::RectifiedGeometry;

/// Samples that must lie on a plane.
pub(super) const MIN_ON: usize = 80;
/// … and as a share of those seen where the plane is.
const MIN_ON_SHARE: f64 = 0.12;
/// For what they span every so many rows of the grid are enough.
const SPAN_STEP: usize = 3;
/// Samples of a column that are held against each other: so many rows of the grid apart.
const STRIDE: usize = 3;
/// Of these pairs, the share along which disparity changes as on the plane: a wall crosses it.
const MIN_ALONG_SHARE: f64 = 0.35;
/// … and how many that must be as a share of the samples on the plane: mismatches lie on it one by one.
const MIN_ALONG: f64 = 0.1;
/// How much of the plane's change of disparity may be missing or too much.
const ALONG: f32 = 0.6;
/// What lies below a plane, as a share of what lies on it, that makes it something else than the ground.
const MAX_BELOW_SHARE: f64 = 0.5;
/// Disparity that the samples on a plane must span, px: a wall spans next to none.
const MIN_SPAN_PX: f64 = 2.5;
/// Columns and rows that they must span, as shares of the image's width and height: the lower edge of the image cuts
/// off a wall in a line of a plausible plane.
const MIN_ACROSS: f64 = 0.2;
const MIN_DOWN: f64 = 0.12;

/// Whether a plane is the ground, and if not, why.
pub(super) fn require_ground(
    plane: &DisparityPlane,
    held: &Held,
    samples: &Samples,
    tolerance_px: f64,
    geometry: &RectifiedGeometry,
) -> Result<(), NoGround> {
    let enough = held.count >= MIN_ON as f64 && held.count >= MIN_ON_SHARE * held.looked_at;
    if !enough
        || !spans_enough(plane, samples, tolerance_px, geometry)
        || !lies_along(plane, held, samples, tolerance_px)
    {
        return Err(NoGround::NoPlane);
    }
    if held.under > MAX_BELOW_SHARE * held.on {
        return Err(NoGround::SomethingBelow);
    }
    Ok(())
}

/// Whether the samples on a plane span enough columns, rows and disparity.
fn spans_enough(
    plane: &DisparityPlane,
    samples: &Samples,
    tolerance_px: f64,
    geometry: &RectifiedGeometry,
) -> bool {
    let by_u = plane.by_u as f32;
    let tolerance_px = tolerance_px as f32;
    // How many, and the sums and sums of squares of u, v and disparity.
    let mut sums = [0.0_f64; 7];
    for (row, at_u0) in samples.rows_of(plane, SPAN_STEP) {
        let [mut count, mut by_column, mut by_columns, mut disparity, mut disparities] =
            [[0.0_f32; COLUMNS]; 5];
        for column in 0..COLUMNS {
            let plane_px = at_u0 + by_u * samples.u[column];
            let is_on = (plane_px > 1.0) & ((row.seen_px[column] - plane_px).abs() < tolerance_px);
            count[column] += if is_on { 1.0 } else { 0.0 };
            by_column[column] += if is_on { samples.u[column] } else { 0.0 };
            by_columns[column] += if is_on { samples.u[column] * samples.u[column] } else { 0.0 };
            disparity[column] += if is_on { plane_px } else { 0.0 };
            disparities[column] += if is_on { plane_px * plane_px } else { 0.0 };
        }
        let v = f64::from(row.v);
        let [n, u, uu, d, dd] = [count, by_column, by_columns, disparity, disparities].map(total);
        for (sum, value) in sums.iter_mut().zip([n, u, n * v, d, uu, n * v * v, dd]) {
            *sum += value;
        }
    }
    let [count, sums @ ..] = sums;
    // What is spread evenly has a deviation of its span over √12.
    let span = |i: usize| {
        let mean = sums[i] / count;
        (12.0 * (sums[3 + i] / count - mean * mean).max(0.0)).sqrt()
    };
    count > 0.0
        && span(0) >= MIN_ACROSS * geometry.width as f64
        && span(1) >= MIN_DOWN * geometry.height as f64
        && span(2) >= MIN_SPAN_PX
}

/// Whether samples lie along a plane, not across it: disparity changes as on the plane from enough of those on it to
/// the samples some rows farther down their columns.
fn lies_along(plane: &DisparityPlane, held: &Held, samples: &Samples, tolerance_px: f64) -> bool {
    let (by_u, tolerance_px) = (plane.by_u as f32, tolerance_px as f32);
    let (mut pairs, mut along) = ([0.0_f32; COLUMNS], [0.0_f32; COLUMNS]);
    for ((upper, upper_px), lower) in samples.rows_of(plane, 1).zip(samples.rows_of(plane, 1).skip(STRIDE)) {
        let (lower, lower_px) = lower;
        let change_px = lower_px - upper_px;
        for column in 0..COLUMNS {
            let plane_px = upper_px + by_u * samples.u[column];
            let is_on = (plane_px > 1.0) & ((upper.seen_px[column] - plane_px).abs() < tolerance_px);
            let is_pair = is_on & (lower.seen_px[column] < NOTHING);
            let off_px = lower.seen_px[column] - upper.seen_px[column] - change_px;
            pairs[column] += if is_pair { 1.0 } else { 0.0 };
            along[column] += if is_pair & (off_px.abs() < ALONG * change_px) { 1.0 } else { 0.0 };
        }
    }
    let along = total(along);
    along >= MIN_ALONG_SHARE * total(pairs) && along >= MIN_ALONG * held.count
}
