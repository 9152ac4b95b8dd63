//! Fits eq. 6, a sum of two exponentials, to measured (disparity, distance) pairs.
//!
//! Given both rates the amplitudes follow by linear least squares, so the sum of squares is a surface over two rates
//! only (variable projection: Golub & Pereyra, 1973). It has several valleys, some of them at the edge, where an
//! exponential is so steep that it touches one end point and nothing else. Therefore:
//!
//! ```text
//! evaluate the surface on a grid of all pairs of rates, from gentle to so steep that steeper makes no difference
//! hold each rate of the grid and find the lowest points over the other       (golden section)
//! descend from all of these                         (Levenberg–Marquardt, Kaufman's Jacobian)
//! keep the lowest
//! ```

use nalgebra::{DMatrix, Matrix2, Matrix4, Vector2, Vector4};

use super::curve::{RangeCurve, Uncertainty};
use crate::error::{Error, Result};

/// Beyond this factor from one sample to the next (e⁻³⁶ is the rounding of 1) a steeper exponential fits no better.
const STEEPEST_STEP: f64 = 36.0;
/// `e^650` is still a number, with room left for the amplitude.
const LARGEST_EXPONENT: f64 = 650.0;
/// Half-differences of the rates below this use the confluent chart; both charts are well conditioned around it.
const NEAR_HALF_DIFFERENCE: f64 = 1.0;
const MAX_ITERATIONS: usize = 400;

/// Fits `distance = a·e^(b·x) + c·e^(d·x)` (eq. 6 of the paper) by least squares in distance.
///
/// `disparity_px` and `distance_m` are pairs in any order; disparities may repeat. Where the data follow a single
/// exponential, or the best pair of rates is a double one (`(p + q·x)·e^(b·x)`, the limit `b → d`), the answer is the
/// nearest curve of the paper's form that floating point can hold: the predictions are good, the constants
/// themselves are not determined, and [`RangeCurve::standard_errors`] say so.
///
/// # Errors
///
/// [`Error::InvalidParameter`] for lists of different length or a number that is not finite,
/// [`Error::NotEnoughData`] for fewer than 5 pairs, [`Error::Degenerate`] for fewer than 4 different disparities.
pub fn fit_range_curve(disparity_px: &[f64], distance_m: &[f64]) -> Result<RangeCurve> {
    let samples = Samples::new(disparity_px, distance_m)?;
    Ok(finish(&samples, &lowest(&samples)))
}

/// Residuals, metres, in the order given, of the curve that makes the sum of weighted squares smallest. Weights are
/// positive, one for each pair.
///
/// # Errors
///
/// As [`fit_range_curve`].
pub(super) fn weighted_residuals_m(
    disparity_px: &[f64],
    distance_m: &[f64],
    weights: &[f64],
) -> Result<Vec<f64>> {
    let mut samples = Samples::new(disparity_px, distance_m)?;
    for (k, &place) in samples.places.iter().enumerate() {
        samples.root_weights[k] = weights[place].sqrt();
        samples.y[k] *= samples.root_weights[k];
    }
    let best = lowest(&samples);
    let mut residuals_m = vec![0.0; weights.len()];
    for (k, &place) in samples.places.iter().enumerate() {
        residuals_m[place] = best.residual[k] / samples.root_weights[k];
    }
    Ok(residuals_m)
}

fn lowest(samples: &Samples) -> Projection {
    valley_starts(samples)
        .into_iter()
        .map(|start| descend(samples, start))
        .min_by(|one, other| one.sum_of_squares.total_cmp(&other.sum_of_squares))
        .expect("a grid has a lowest point")
}

/// The pairs, sorted, with `t = (x - x_min) / (x_max - x_min)` in 0 to 1.
struct Samples {
    x: Vec<f64>,
    t: Vec<f64>,
    /// Distances times the roots of the weights, metres.
    y: Vec<f64>,
    /// Roots of the weights; the columns of the model are multiplied by them.
    root_weights: Vec<f64>,
    /// Where each pair stood in the list given.
    places: Vec<usize>,
    /// `x_max - x_min`.
    span: f64,
    /// Most negative and most positive rate worth trying, per unit of t.
    limits: [f64; 2],
}

impl Samples {
    fn new(disparity_px: &[f64], distance_m: &[f64]) -> Result<Self> {
        if disparity_px.len() != distance_m.len() {
            return Err(Error::invalid(
                "distance_m",
                format!("{} values", distance_m.len()),
                format!("must have one value per disparity, {}", disparity_px.len()),
            ));
        }
        for (name, unit, values) in [("disparity_px", "px", disparity_px), ("distance_m", "m", distance_m)] {
            if let Some((i, value)) = values.iter().enumerate().find(|(_, v)| !v.is_finite()) {
                return Err(Error::invalid(
                    name,
                    format!("{value} {unit}"),
                    format!("entry {i} must be finite"),
                ));
            }
        }
        let what = "fit of the range curve (pairs of disparity and distance)";
        if disparity_px.len() < 5 {
            return Err(Error::NotEnoughData { what, actual: disparity_px.len(), needed: 5 });
        }
        let mut places: Vec<usize> = (0..disparity_px.len()).collect();
        let pair = |place: usize| (disparity_px[place], distance_m[place]);
        places.sort_by(|&p, &q| {
            let (p, q) = (pair(p), pair(q));
            p.0.total_cmp(&q.0).then(p.1.total_cmp(&q.1))
        });
        let (x, y): (Vec<f64>, Vec<f64>) = places.iter().map(|&place| pair(place)).unzip();
        let mut distinct = x.clone();
        distinct.dedup();
        let [.., before_last, last] = distinct[..] else {
            return Err(Error::degenerate("fit of the range curve", "all disparities are equal"));
        };
        if distinct.len() < 4 {
            let reason = format!("{} different disparities cannot determine four constants", distinct.len());
            return Err(Error::degenerate("fit of the range curve", reason));
        }
        let (first, second) = (distinct[0], distinct[1]);
        let span = last - first;
        // A steep exponential is of ordinary size at one end; its amplitude is what that makes of it at x = 0.
        let limit = |gap: f64, end: f64| span * (STEEPEST_STEP / gap).min(LARGEST_EXPONENT / end.abs());
        let limits = [-limit(second - first, first), limit(last - before_last, last)];
        let t = x.iter().map(|x| (x - first) / span).collect();
        let root_weights = vec![1.0; x.len()];
        Ok(Self { x, t, y, root_weights, places, span, limits })
    }
}

/// A pair of rates as mean and squared half-difference: smooth where the two meet, where the rates themselves are not.
#[derive(Debug, Clone, Copy)]
struct Rates {
    mean: f64,
    half_difference_squared: f64,
}

impl Rates {
    fn of(one: f64, other: f64) -> Self {
        let half = 0.5 * (one - other);
        Self { mean: 0.5 * (one + other), half_difference_squared: half * half }
    }

    fn half_difference(self) -> f64 {
        self.half_difference_squared.sqrt()
    }

    /// The two rates, smaller first.
    fn pair(self) -> [f64; 2] {
        [self.mean - self.half_difference(), self.mean + self.half_difference()]
    }

    fn are_near(self) -> bool {
        self.half_difference() < NEAR_HALF_DIFFERENCE
    }

    /// The coordinates in which to take a step: (mean, half-difference²) when near, (rate, rate) otherwise.
    fn coordinates(self) -> Vector2<f64> {
        if self.are_near() {
            Vector2::new(self.mean, self.half_difference_squared)
        } else {
            Vector2::from(self.pair())
        }
    }

    /// Lower and upper bounds of [`coordinates`](Self::coordinates).
    fn bounds(self, limits: [f64; 2]) -> [Vector2<f64>; 2] {
        if self.are_near() {
            [Vector2::new(limits[0], 0.0), Vector2::new(limits[1], f64::INFINITY)]
        } else {
            limits.map(Vector2::repeat)
        }
    }

    /// The pair at `coordinates` in the chart of `self`, within the limits.
    fn moved_to(self, coordinates: Vector2<f64>, limits: [f64; 2]) -> Self {
        let pair = if self.are_near() {
            Self { mean: coordinates.x, half_difference_squared: coordinates.y.max(0.0) }.pair()
        } else {
            coordinates.into()
        };
        let within = pair.map(|rate| rate.clamp(limits[0], limits[1]));
        if within == pair && self.are_near() {
            // Not by way of the rates: they cannot hold a difference of less than 1e-16.
            return Self { mean: coordinates.x, half_difference_squared: coordinates.y.max(0.0) };
        }
        Self::of(within[0], within[1])
    }
}

/// Power series in `z = q·t²` of the confluent basis: `cosh √z`, `sinh √z / √z` and the derivative of the latter.
///
/// `z` stays below [`NEAR_HALF_DIFFERENCE`]² = 1, where nine terms reach the last bit.
fn confluent_series(z: f64) -> [f64; 3] {
    let (mut even, mut odd, mut slope) = (0.0, 0.0, 0.0);
    let mut power_over_factorial = 1.0;
    for k in 0..9 {
        let n = f64::from(2 * k);
        even += power_over_factorial;
        odd += power_over_factorial / (n + 1.0);
        // d/dz z^(k+1)/(2k+3)! = (k+1) z^k / (2k+3)!
        slope += power_over_factorial * f64::from(k + 1) / ((n + 1.0) * (n + 2.0) * (n + 3.0));
        power_over_factorial *= z / ((n + 1.0) * (n + 2.0));
    }
    [even, odd, slope]
}

/// The best amplitudes for a pair of rates, and what is left.
///
/// The model is `amplitudes · columns`: when near, `e^(mean·t)·cosh(h·t)` and `e^(mean·t)·sinh(h·t)/h`; otherwise
/// the two exponentials. Exponentials are scaled to at most 1 by `shifts`, subtracted from the exponent.
struct Projection {
    rates: Rates,
    amplitudes: [f64; 2],
    shifts: [f64; 2],
    residual: Vec<f64>,
    /// An orthonormal basis of the columns.
    basis: [Vec<f64>; 2],
    sum_of_squares: f64,
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// `target -= factor * column`.
fn subtract(target: &mut [f64], factor: f64, column: &[f64]) {
    for (target, column) in target.iter_mut().zip(column) {
        *target -= factor * column;
    }
}

impl Projection {
    fn new(samples: &Samples, rates: Rates) -> Self {
        let [slow, fast] = rates.pair();
        let (shifts, mut first, mut second): ([f64; 2], Vec<f64>, Vec<f64>);
        if rates.are_near() {
            shifts = [rates.mean.max(0.0); 2];
            (first, second) = samples
                .t
                .iter()
                .map(|&t| {
                    let scale = (rates.mean * t - shifts[0]).exp();
                    let [even, odd, _] = confluent_series(rates.half_difference_squared * t * t);
                    (scale * even, scale * t * odd)
                })
                .unzip();
        } else {
            shifts = [slow.max(0.0), fast.max(0.0)];
            (first, second) = samples
                .t
                .iter()
                .map(|&t| ((slow * t - shifts[0]).exp(), (fast * t - shifts[1]).exp()))
                .unzip();
        }
        for (root_weight, (first, second)) in
            samples.root_weights.iter().zip(first.iter_mut().zip(&mut second))
        {
            *first *= root_weight;
            *second *= root_weight;
        }
        // Gram–Schmidt, the second column twice: once leaves rounding of the size of what was removed.
        let r11 = dot(&first, &first).sqrt();
        first.iter_mut().for_each(|v| *v /= r11);
        let mut r12 = 0.0;
        for _ in 0..2 {
            let along = dot(&first, &second);
            r12 += along;
            subtract(&mut second, along, &first);
        }
        let r22 = dot(&second, &second).sqrt();
        second.iter_mut().for_each(|v| *v /= r22);

        let mut residual = samples.y.clone();
        let mut along = [0.0; 2];
        for _ in 0..2 {
            for (along, column) in along.iter_mut().zip([&first, &second]) {
                let more = dot(column, &residual);
                *along += more;
                subtract(&mut residual, more, column);
            }
        }
        let of_second = along[1] / r22;
        Self {
            rates,
            amplitudes: [(along[0] - r12 * of_second) / r11, of_second],
            shifts,
            sum_of_squares: dot(&residual, &residual),
            residual,
            basis: [first, second],
        }
    }

    /// Kaufman's Jacobian of the residual by [`Rates::coordinates`]: exact for the gradient, and good for the Hessian.
    fn jacobian(&self, samples: &Samples) -> [Vec<f64>; 2] {
        let [slow, fast] = self.rates.pair();
        let [p, q] = self.amplitudes;
        let (mut by_first, mut by_second): (Vec<f64>, Vec<f64>) = samples
            .t
            .iter()
            .map(|&t| {
                if self.rates.are_near() {
                    let scale = (self.rates.mean * t - self.shifts[0]).exp();
                    let [even, odd, slope] = confluent_series(self.rates.half_difference_squared * t * t);
                    let by_mean = scale * t * (p * even + q * t * odd);
                    (-by_mean, -scale * t * t * (0.5 * p * odd + q * t * slope))
                } else {
                    // Measured from the anchor: the difference is a multiple of the column, which the projection removes.
                    let from_anchor = |rate: f64| if rate > 0.0 { t - 1.0 } else { t };
                    (
                        -p * from_anchor(slow) * (slow * t - self.shifts[0]).exp(),
                        -q * from_anchor(fast) * (fast * t - self.shifts[1]).exp(),
                    )
                }
            })
            .unzip();
        for derivative in [&mut by_first, &mut by_second] {
            for (value, root_weight) in derivative.iter_mut().zip(&samples.root_weights) {
                *value *= root_weight;
            }
            for column in &self.basis {
                let along = dot(column, derivative);
                subtract(derivative, along, column);
            }
        }
        [by_first, by_second]
    }
}

/// Where to descend from: for each rate of a grid, the other rates at which the sum of squares is lowest.
fn valley_starts(samples: &Samples) -> Vec<Rates> {
    // Geometric from a rate too gentle to matter up to the steepest; zero in the middle.
    let one_side = |limit: f64| {
        let mut rates = Vec::new();
        let mut rate = limit.abs();
        while rate > 0.05 {
            rates.push(rate.copysign(limit));
            rate /= 1.5;
        }
        rates
    };
    let mut rates = one_side(samples.limits[0]);
    rates.push(0.0);
    rates.extend(one_side(samples.limits[1]).into_iter().rev());

    let count = rates.len();
    let mut surface = vec![f64::INFINITY; count * count];
    for i in 0..count {
        for j in i..count {
            let sum_of_squares = Projection::new(samples, Rates::of(rates[i], rates[j])).sum_of_squares;
            // Not a number where the two columns are one to rounding; no start there.
            let height = if sum_of_squares.is_nan() { f64::INFINITY } else { sum_of_squares };
            surface[i * count + j] = height;
            surface[j * count + i] = height;
        }
    }
    // Precise data cut the valleys narrower than the grid, so a minimum over both rates may hide between its points.
    // A minimum over one rate, the other held, does not; it lies between its neighbours on the grid.
    let mut starts = Vec::new();
    for i in 0..count {
        let row = &surface[i * count..(i + 1) * count];
        for (j, &height) in row.iter().enumerate() {
            let (before, after) = (j.saturating_sub(1), (j + 1).min(count - 1));
            if (j == before || height < row[before]) && height <= row[after] {
                let held = |rate| Projection::new(samples, Rates::of(rates[i], rate)).sum_of_squares;
                starts.push(Rates::of(rates[i], golden_section([rates[before], rates[after]], held)));
            }
        }
    }
    starts
}

/// Narrows a bracket around a minimum to a thousandth of its width.
fn golden_section([mut low, mut high]: [f64; 2], height: impl Fn(f64) -> f64) -> f64 {
    const RATIO: f64 = 0.618_033_988_749_895;
    let mut inner = [high - RATIO * (high - low), low + RATIO * (high - low)];
    let mut heights = inner.map(&height);
    for _ in 0..14 {
        if heights[0] < heights[1] {
            high = inner[1];
            inner = [high - RATIO * (high - low), inner[0]];
            heights = [height(inner[0]), heights[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + RATIO * (high - low)];
            heights = [heights[1], height(inner[1])];
        }
    }
    0.5 * (low + high)
}

/// Levenberg–Marquardt on the two rates, within their bounds.
fn descend(samples: &Samples, start: Rates) -> Projection {
    let mut here = Projection::new(samples, start);
    let mut damping = 1e-3;
    let mut idle = 0;
    for _ in 0..MAX_ITERATIONS {
        let jacobian = here.jacobian(samples);
        let gradient = Vector2::from_fn(|i, _| dot(&jacobian[i], &here.residual));
        let mut hessian = Matrix2::from_fn(|i, j| dot(&jacobian[i], &jacobian[j]));
        let at = here.rates.coordinates();
        let [low, high] = here.rates.bounds(samples.limits);
        let mut downhill = -gradient;
        for i in 0..2 {
            // A coordinate that only wants out stays where it is and lets the other one move.
            if (at[i] <= low[i] && downhill[i] < 0.0) || (at[i] >= high[i] && downhill[i] > 0.0) {
                downhill[i] = 0.0;
                (hessian[(0, 1)], hessian[(1, 0)]) = (0.0, 0.0);
            }
        }
        let next = loop {
            let mut damped = hessian;
            for i in 0..2 {
                damped[(i, i)] += damping * hessian[(i, i)] + f64::MIN_POSITIVE;
            }
            let step = damped.try_inverse().map_or(Vector2::zeros(), |inverse| inverse * downhill);
            let next = Projection::new(samples, here.rates.moved_to(at + step, samples.limits));
            if next.sum_of_squares < here.sum_of_squares {
                damping = (damping / 5.0).max(1e-12);
                break Some(next);
            }
            damping *= 4.0;
            if damping > 1e12 {
                break None;
            }
        };
        let Some(next) = next else { break };
        let gain = 1.0 - next.sum_of_squares / here.sum_of_squares;
        here = next;
        // Progress is slow along a curved valley: several small gains in a row, not one, are the end.
        idle = if gain < 1e-14 { idle + 1 } else { 0 };
        if idle == 3 {
            break;
        }
    }
    here
}

/// `[a, b, c, d]` of a projection.
fn constants(samples: &Samples, at: &Projection) -> [f64; 4] {
    let [p, q] = at.amplitudes;
    let pair = at.rates.pair();
    let amplitudes = if at.rates.are_near() {
        // cosh and sinh, taken apart.
        let half = 0.5 * q / at.rates.half_difference();
        [0.5 * p - half, 0.5 * p + half]
    } else {
        [p, q]
    };
    let raw = [0, 1].map(|i| {
        let rate = pair[i] / samples.span;
        (amplitudes[i] * (-at.shifts[i] - rate * samples.x[0]).exp(), rate)
    });
    [raw[0].0, raw[0].1, raw[1].0, raw[1].1]
}

fn sum_of_squares(samples: &Samples, [a, b, c, d]: [f64; 4]) -> f64 {
    let residual = |(x, y): (&f64, &f64)| y - a * (b * x).exp() - c * (d * x).exp();
    samples.x.iter().zip(&samples.y).map(residual).map(|r| r * r).sum()
}

fn finish(samples: &Samples, best: &Projection) -> RangeCurve {
    // A double rate has no form `a·e^(bx) + c·e^(dx)`: the closer b and d, the nearer the curve but the larger the
    // cancellation between a and c. The sum of squares of the constants as they will be used decides.
    let half = best.rates.half_difference();
    let apart = (-12..=-4)
        .map(|exponent| 10f64.powf(0.5 * f64::from(exponent)))
        .filter(|&h| h > half)
        .map(|h| Rates { half_difference_squared: h * h, ..best.rates });
    let candidates = std::iter::once(best.rates).chain(apart);
    let [a, b, c, d] = candidates
        .map(|rates| constants(samples, &Projection::new(samples, rates)))
        .filter(|constants| constants.iter().all(|v| v.is_finite()))
        .min_by(|one, other| sum_of_squares(samples, *one).total_cmp(&sum_of_squares(samples, *other)))
        .expect("rates that differ have finite constants");

    let count = samples.x.len() as f64;
    let mean = samples.y.iter().sum::<f64>() / count;
    let about_mean: f64 = samples.y.iter().map(|y| (y - mean) * (y - mean)).sum();
    let about_curve = sum_of_squares(samples, [a, b, c, d]);
    let (first, last) = (samples.x[0], samples.x[samples.x.len() - 1]);
    let end_of = |rate: f64| if rate > 0.0 { last } else { first };
    let mut curve = RangeCurve {
        a,
        b,
        c,
        d,
        rmse_m: (about_curve / count).sqrt(),
        // Constant distances, met exactly, are explained wholly.
        r_squared: if about_mean > 0.0 { 1.0 - about_curve / about_mean } else { 1.0 },
        span_px: (first, last),
        samples: samples.x.len(),
        outliers: Vec::new(),
        uncertainty: Uncertainty {
            anchors_px: [end_of(b), end_of(d)],
            covariance: Matrix4::zeros(),
            residual_variance: about_curve / (count - 4.0),
        },
    };
    curve.uncertainty.covariance = covariance(&curve, &samples.x);
    curve
}

/// `s² (JᵀJ)⁻¹`; directions that the data leave open get a variance near `1e24` of the best determined one's.
fn covariance(curve: &RangeCurve, disparity_px: &[f64]) -> Matrix4<f64> {
    let rows: Vec<_> = curve.jacobian_rows(disparity_px).collect();
    let norms =
        rows.iter().fold(Vector4::zeros(), |sum, row| sum + row.component_mul(row)).map(|v: f64| v.sqrt());
    // Columns of one length, so that units do not decide what counts as open.
    let scale = norms.map(|norm| if norm > 0.0 { 1.0 / norm } else { 1.0 });
    let scaled = DMatrix::from_fn(rows.len(), 4, |i, j| rows[i][j] * scale[j]);
    let svd = scaled.svd(false, true);
    let right = svd.v_t.expect("asked for");
    let floor = 1e-12 * svd.singular_values.max();
    let mut inverse_root = right;
    for (i, mut row) in inverse_root.row_iter_mut().enumerate() {
        row /= svd.singular_values[i].max(floor);
    }
    let spread = DMatrix::from_fn(4, 4, |i, j| inverse_root[(i, j)] * scale[j]);
    let covariance = spread.transpose() * &spread * curve.uncertainty.residual_variance;
    Matrix4::from_fn(|i, j| covariance[(i, j)])
}
