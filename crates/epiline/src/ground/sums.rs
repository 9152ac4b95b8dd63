//! Sums over the grid for least squares.

use nalgebra::{Matrix3, Vector3};

use super::plane_fit::DisparityPlane;
use super::samples::{COLUMNS, Samples};

/// Samples of one plane share errors: so many count as one.
const ALIKE: f64 = 4.0;

/// Where the ground ahead bends, as disparities of its plane `p`: from `at_px` on, farther away, it is seen by
/// `by_px·(1 - p/at_px)` off the plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bend {
    pub at_px: f64,
    pub by_px: f64,
}

impl Bend {
    pub const NONE: Self = Self { at_px: 1.0, by_px: 0.0 };
}

/// A round of reweighting.
#[derive(Debug, Clone, Copy)]
pub(super) struct Round {
    /// From so many deviations of disparity off the ground on a sample has no weight.
    pub width: f64,
    /// Looked at is every so many rows of the grid.
    pub step: usize,
}

impl Round {
    /// [`width`](Self::width) in pixels.
    pub fn width_px(&self, sigma_px: f64) -> f32 {
        (self.width * sigma_px).max(0.5) as f32
    }
}

/// Sums over samples with Tukey's weights `w`, with `x = (u, v, 1)` and `o`, what is seen off a plane.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    /// `Σ w·x·xᵀ`
    pub weights: Matrix3<f64>,
    /// `Σ w²·x·xᵀ`
    pub squared: Matrix3<f64>,
    /// `Σ w·x·o`
    pub off: Vector3<f64>,
}

impl Sums {
    /// Over what is about a plane with a bend; `advance` sees them grow, row by row from far to near, with the plane's
    /// disparity in the row.
    pub fn over(
        plane: &DisparityPlane,
        bend: Bend,
        samples: &Samples,
        step: usize,
        width_px: f32,
        mut advance: impl FnMut(&Self, f64),
    ) -> Self {
        let mut sums = Self::default();
        let (bend_px, per_bend) = (bend.by_px as f32, 1.0 / bend.at_px as f32);
        let by_u = plane.by_u as f32;
        let per_width = 1.0 / width_px;
        for (row, at_u0) in samples.rows_of(plane, step) {
            // With q for w² and o for what is seen off the plane.
            let [mut w, mut wu, mut wuu, mut q, mut qu, mut quu, mut wo, mut wuo] = [[0.0_f32; COLUMNS]; 8];
            for column in 0..COLUMNS {
                let plane_px = at_u0 + by_u * samples.u[column];
                let off_px = row.seen_px[column] - plane_px;
                let beyond_px = bend_px * (1.0 - plane_px * per_bend).max(0.0);
                let share = (off_px - beyond_px) * per_width;
                let inside = (1.0 - share * share).max(0.0);
                // The nearer, the more it counts: what the camera stands on is near, a ramp may begin ahead. By the
                // plane's disparity, not by the one seen, whose noise would choose its own weight.
                let weight = inside * inside * plane_px.max(0.0);
                let weight_u = weight * samples.u[column];
                w[column] += weight;
                wu[column] += weight_u;
                wuu[column] += weight_u * samples.u[column];
                q[column] += weight * weight;
                qu[column] += weight * weight_u;
                quu[column] += weight_u * weight_u;
                wo[column] += weight * off_px;
                wuo[column] += weight_u * off_px;
            }
            sums.add([w, wu, wuu, q, qu, quu, wo, wuo].map(total), f64::from(row.v));
            advance(&sums, f64::from(at_u0));
        }
        sums
    }

    /// The covariance of a solution with the `inverse` of the normal matrix, from the deviation of a disparity.
    pub fn covariance(&self, inverse: &Matrix3<f64>, sigma_px: f64) -> Matrix3<f64> {
        inverse * self.squared * inverse * (ALIKE * sigma_px * sigma_px)
    }

    /// Adds a row.
    fn add(&mut self, [w, wu, wuu, q, qu, quu, wo, wuo]: [f64; 8], v: f64) {
        let moments =
            |w: f64, wu: f64, wuu: f64| Matrix3::new(wuu, wu * v, wu, wu * v, w * v * v, w * v, wu, w * v, w);
        self.weights += moments(w, wu, wuu);
        self.squared += moments(q, qu, quu);
        self.off += Vector3::new(wuo, wo * v, wo);
    }
}

/// The sum of what each column has, in an order that does not depend on the machine.
pub(super) fn total(mut columns: [f32; COLUMNS]) -> f64 {
    let mut width = COLUMNS / 2;
    while width > 0 {
        let (sums, others) = columns.split_at_mut(width);
        sums.iter_mut().zip(others).for_each(|(sum, other)| *sum += *other);
        width /= 2;
    }
    f64::from(columns[0])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matching::DisparityMap;
    use crate::rectification::RectifiedGeometry;

    /// Every pixel of the grid is a sample, in steps that nothing sums by chance.
    fn samples() -> (Samples, Vec<(f64, f64, f64)>) {
        let geometry = RectifiedGeometry::new(64, 100, 90.0, 30.5, 20.25, 0.0, 0.1).expect("a rig");
        let mut map = DisparityMap::new(64, 100);
        let mut all = Vec::new();
        for y in 0..100 {
            for x in 0..64 {
                let raw = (16 * y / 3 + 7 * x % 37 + 5 * (x * y) % 11) as u16;
                map.values.row_mut(y)[x] = raw;
                map.validity.row_mut(y)[x] = u8::from((x + y) % 5 == 0);
                if (x + y) % 5 != 0 && raw > 0 && y % 2 == 1 {
                    all.push((x as f64 - 30.5, y as f64 - 20.25, f64::from(raw) / 16.0));
                }
            }
        }
        let mut samples = Samples::default();
        samples.take(&map, &geometry);
        (samples, all)
    }

    #[test]
    fn sums_are_those_over_samples_one_by_one() {
        let (samples, all) = samples();
        assert_eq!(samples.count, all.len());
        let plane = DisparityPlane { by_u: 0.02, by_v: 0.3, at_center: 6.0 };
        for bend in [Bend::NONE, Bend { at_px: 20.0, by_px: 1.5 }] {
            let mut expected = Sums::default();
            for &(u, v, seen) in &all {
                let p = 0.02 * u + 0.3 * v + 6.0;
                let off = seen - p;
                let share = (off - bend.by_px * (1.0 - p / bend.at_px).max(0.0)) / 2.5;
                let w = (1.0 - share * share).max(0.0).powi(2) * p.max(0.0);
                let x = Vector3::new(u, v, 1.0);
                expected.weights += w * x * x.transpose();
                expected.squared += w * w * x * x.transpose();
                expected.off += w * off * x;
            }
            let got = Sums::over(&plane, bend, &samples, 1, 2.5, |_, _| {});
            assert!((got.weights - expected.weights).norm() < 1e-5 * expected.weights.norm());
            assert!((got.squared - expected.squared).norm() < 1e-5 * expected.squared.norm());
            assert!((got.off - expected.off).norm() < 1e-4 * expected.off.norm());
        }
    }
}
