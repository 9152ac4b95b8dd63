//! Stage 1: R, Tx, Ty (and sx) from the radial alignment constraint `Yd xc = Xd yc`.
//!
//! Radial distortion moves an image point along its own direction from the centre, so that direction is free of f,
//! Tz and kappa1, and the constraint is linear in ratios to Ty (Tsai 1987).

use nalgebra::{DMatrix, DVector, Matrix3, SMatrix, Vector2, Vector3};

use super::{METHOD, Sensor, sensor_points};
use crate::calibration::homography::nearest_rotation;
use crate::error::{Error, Result};

/// The world frame in which stage 1 and 2 work: `local = plane_from_world * world - origin_mm`.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalFrame {
    /// Turns coplanar points so that their plane is z = const; identity otherwise.
    plane_from_world: Matrix3<f64>,
    /// In the turned frame; chosen so that Ty does not vanish.
    origin_mm: Vector3<f64>,
}

impl LocalFrame {
    /// World points in the local frame.
    pub fn apply(&self, world_mm: &[[f64; 3]]) -> Vec<Vector3<f64>> {
        world_mm.iter().map(|p| self.plane_from_world * Vector3::from(*p) - self.origin_mm).collect()
    }

    /// (R, T) of the world from those of the local frame.
    pub fn world_pose(
        &self,
        rotation: &Matrix3<f64>,
        translation_mm: Vector3<f64>,
    ) -> (Matrix3<f64>, Vector3<f64>) {
        (rotation * self.plane_from_world, translation_mm - rotation * self.origin_mm)
    }
}

/// What stage 1 finds, in its local frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct RadialAlignment {
    pub frame: LocalFrame,
    /// R; for coplanar points the depth direction's sign is settled by stage 2.
    pub rotation: Matrix3<f64>,
    pub tx_mm: f64,
    pub ty_mm: f64,
    pub sx: f64,
    /// Condition number of the column-scaled system.
    pub condition: f64,
    pub coplanar: bool,
    /// How far the rows of R were from orthogonal before they were made so, radians; NaN if coplanar.
    pub skew_rad: f64,
}

/// Thickness of a point set relative to its largest extent below which it counts as a plane.
const FLATNESS: f64 = 1e-3;

/// Beyond this the direction of the unknowns is noise: 0.1 px in 1000 px times this is of the order of 1.
const LARGEST_CONDITION: f64 = 1e4;

/// Above this another origin is tried: the system is in ratios to Ty.
const TOLERABLE_CONDITION: f64 = 50.0;

/// The smallest tilt of a plane against the image, degrees, at which f and Tz can be told apart.
const MIN_TILT_DEGREES: f64 = 2.0;

/// By so many of its standard deviations the deviation from a parallel plane must exceed that of the smallest tilt:
/// of planes tilted by less, noise lets 1 in 700 pass.
const TILT_SIGMAS: f64 = 3.0;

/// Mahalanobis distance, squared, from a plane parallel to the image that a tilt must exceed to be more than noise.
///
/// The 99.999 % point of chi-squared with two degrees of freedom.
const SIGNIFICANT_TILT: f64 = 23.0;

/// The linear system of one choice of origin.
struct Solution {
    unknowns: DVector<f64>,
    /// Covariance of the unknowns, from the residuals of the constraint.
    covariance: DMatrix<f64>,
    condition: f64,
    origin_mm: Vector3<f64>,
}

pub(super) fn solve(world_mm: &[[f64; 3]], pixels: &[[f64; 2]], sensor: &Sensor) -> Result<RadialAlignment> {
    let shape = Shape::of(world_mm)?;
    let needed = if shape.coplanar { 5 } else { 7 };
    if world_mm.len() < needed {
        let what = if shape.coplanar { "coplanar points" } else { "points in space" };
        return Err(Error::NotEnoughData { what, actual: world_mm.len(), needed });
    }
    let image: Vec<Vector2<f64>> = sensor_points(pixels, sensor).collect();
    let turned = LocalFrame { plane_from_world: shape.plane_from_world, origin_mm: Vector3::zeros() };
    let solution = best_origin(&turned.apply(world_mm), &image, shape.coplanar)?;
    let Solution { unknowns, condition, .. } = &solution;
    let frame = LocalFrame { origin_mm: solution.origin_mm, ..turned };
    let points = frame.apply(world_mm);
    let (rotation, tx_mm, ty_mm, stretch) = if shape.coplanar {
        require_tilt(&solution)?;
        coplanar(unknowns, &points, &image)?
    } else {
        in_space(unknowns, &points, &image)?
    };
    let skew_rad = if shape.coplanar { f64::NAN } else { skew_rad(unknowns) };
    Ok(RadialAlignment {
        frame,
        rotation,
        tx_mm,
        ty_mm,
        sx: sensor.sx * stretch,
        condition: *condition,
        coplanar: shape.coplanar,
        skew_rad,
    })
}

/// Principal directions of a point set.
struct Shape {
    coplanar: bool,
    /// Identity unless coplanar in another plane than z = const.
    plane_from_world: Matrix3<f64>,
}

impl Shape {
    fn of(world_mm: &[[f64; 3]]) -> Result<Self> {
        let world: Vec<Vector3<f64>> = world_mm.iter().map(|p| Vector3::from(*p)).collect();
        let center = world.iter().sum::<Vector3<f64>>() / (world.len().max(1) as f64);
        let spread: Matrix3<f64> = world.iter().map(|p| (p - center) * (p - center).transpose()).sum();
        let eigen = spread.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let extent = order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt());
        if extent[1] <= FLATNESS * extent[0] {
            return Err(Error::degenerate(METHOD, "all world points lie on one line or in one place"));
        }
        let coplanar = extent[2] <= FLATNESS * extent[0];
        let normal = eigen.eigenvectors.column(order[2]).into_owned();
        let along_z = normal.z.abs() > 1.0 - 1e-9;
        let plane_from_world = if !coplanar || along_z {
            Matrix3::identity()
        } else {
            let x = eigen.eigenvectors.column(order[0]).into_owned();
            Matrix3::from_rows(&[x.transpose(), normal.cross(&x).transpose(), normal.transpose()])
        };
        Ok(Self { coplanar, plane_from_world })
    }
}

/// Solves for the caller's origin, or, if that lies so that Ty vanishes, for one moved by the size of the point set.
fn best_origin(points: &[Vector3<f64>], image: &[Vector2<f64>], coplanar: bool) -> Result<Solution> {
    let count = points.len() as f64;
    let center = points.iter().sum::<Vector3<f64>>() / count;
    let extent = points.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
    // The plane itself may lie at any height: its own z is taken out whatever the origin.
    let base = if coplanar { Vector3::new(0.0, 0.0, center.z) } else { Vector3::zeros() };
    let mut best = linear(points, image, base, coplanar);
    if best.condition > TOLERABLE_CONDITION {
        for (x, y) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let origin = center + Vector3::new(x, y, 0.0) * extent;
            let candidate = linear(points, image, origin, coplanar);
            if candidate.condition < best.condition {
                best = candidate;
            }
        }
    }
    if best.condition > LARGEST_CONDITION || best.condition.is_nan() {
        let hint = if coplanar {
            "the points must spread over the image in both directions"
        } else {
            "the points must spread over the image and in depth; give coplanar points as such, with z = 0"
        };
        let reason = format!("the system of stage 1 has condition {:.1e}: {hint}", best.condition);
        return Err(Error::degenerate(METHOD, reason));
    }
    Ok(best)
}

/// Least squares of the constraint for an origin, with columns of unit length.
fn linear(
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
    origin_mm: Vector3<f64>,
    coplanar: bool,
) -> Solution {
    let columns = if coplanar { 5 } else { 7 };
    let mut matrix = DMatrix::zeros(points.len(), columns);
    let mut right_side = DVector::zeros(points.len());
    for (i, (point, d)) in points.iter().zip(image).enumerate() {
        let p = point - origin_mm;
        let row: &[f64] = if coplanar {
            &[d.y * p.x, d.y * p.y, d.y, -d.x * p.x, -d.x * p.y]
        } else {
            &[d.y * p.x, d.y * p.y, d.y * p.z, d.y, -d.x * p.x, -d.x * p.y, -d.x * p.z]
        };
        matrix.row_mut(i).copy_from_slice(row);
        right_side[i] = d.x;
    }
    let scale = DVector::from_iterator(columns, matrix.column_iter().map(|c| 1.0 / c.norm()));
    for (mut column, s) in matrix.column_iter_mut().zip(scale.iter()) {
        column *= *s;
    }
    let svd = matrix.clone().svd(true, true);
    let condition = svd.singular_values.max() / svd.singular_values.min();
    let unsolvable = || Solution {
        unknowns: DVector::zeros(columns),
        covariance: DMatrix::zeros(columns, columns),
        condition: f64::INFINITY,
        origin_mm,
    };
    let (Some(v_t), true) = (&svd.v_t, condition.is_finite()) else { return unsolvable() };
    let Ok(scaled) = svd.solve(&right_side, f64::MIN_POSITIVE) else { return unsolvable() };
    let freedom = points.len().saturating_sub(columns).max(1) as f64;
    let variance = (&matrix * &scaled - &right_side).norm_squared() / freedom;
    // (AᵀA)⁻¹ = V S⁻² Vᵀ, with the columns' lengths put back.
    let half = DMatrix::from_fn(columns, columns, |r, c| scale[r] * v_t[(c, r)] / svd.singular_values[c]);
    let covariance = &half * half.transpose() * variance;
    Solution { unknowns: scaled.component_mul(&scale), covariance, condition, origin_mm }
}

/// Fails if the plane is parallel to the image, or so nearly that noise could have tilted it.
///
/// The 2x2 matrix of the unknowns is a multiple of a rotation exactly for a plane parallel to the image: then
/// `u1 - s u5 = 0` and `u2 + s u4 = 0`, `s` being the sign of its determinant. Of a plane tilted by `t` these two are a
/// vector of length `(1 - cos t) / |Ty|`.
fn require_tilt(solution: &Solution) -> Result<()> {
    let u = &solution.unknowns;
    let sum = u[0] * u[0] + u[1] * u[1] + u[3] * u[3] + u[4] * u[4];
    let determinant = u[0] * u[4] - u[3] * u[1];
    let ty_squared = ty_squared(sum, determinant);
    let tilt = (ty_squared * determinant.abs()).min(1.0).acos().to_degrees();
    let sign = determinant.signum();
    let by_unknowns = SMatrix::<f64, 2, 5>::new(
        1.0, 0.0, 0.0, 0.0, -sign, //
        0.0, 1.0, 0.0, sign, 0.0,
    );
    let deviation = by_unknowns * u;
    let covariance = by_unknowns * &solution.covariance * by_unknowns.transpose();
    // Without noise there is no covariance to invert, and every deviation is significant.
    let significance =
        covariance.try_inverse().map_or(f64::INFINITY, |inverse| deviation.dot(&(inverse * deviation)));
    let length = deviation.norm();
    let sigma = deviation.dot(&(covariance * deviation)).max(0.0).sqrt() / length;
    let smallest = (1.0 - MIN_TILT_DEGREES.to_radians().cos()) / ty_squared.sqrt();
    if length - TILT_SIGMAS * sigma >= smallest && significance >= SIGNIFICANT_TILT {
        return Ok(());
    }
    Err(Error::degenerate(
        METHOD,
        format!(
            "the plane of the points is parallel to the image, as far as their noise can tell (tilt {tilt:.1} degrees), \
             which leaves f and Tz inseparable; tilt it by 30 degrees or more"
        ),
    ))
}

/// Tsai's root of Ty² for coplanar points, in the form that needs no special case for a vanishing determinant.
fn ty_squared(sum: f64, determinant: f64) -> f64 {
    2.0 / (sum + (sum * sum - 4.0 * determinant * determinant).max(0.0).sqrt())
}

/// The sign of Ty: the point farthest from the image centre must appear on its own side.
fn signed(
    ty: f64,
    rows: (Vector3<f64>, f64, Vector3<f64>),
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
) -> f64 {
    let far = image.iter().map(|d| d.norm_squared()).enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
    let far = far.map_or(0, |(i, _)| i);
    let (first, tx, second) = rows;
    let at = Vector2::new(first.dot(&points[far]) + tx, second.dot(&points[far]) + 1.0) * ty;
    if at.dot(&image[far]) < 0.0 { -ty } else { ty }
}

/// (R, Tx, Ty, 1) from r1/Ty, r2/Ty, Tx/Ty, r4/Ty, r5/Ty; sx cannot change.
fn coplanar(
    u: &DVector<f64>,
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
) -> Result<(Matrix3<f64>, f64, f64, f64)> {
    let sum = u[0] * u[0] + u[1] * u[1] + u[3] * u[3] + u[4] * u[4];
    let determinant = u[0] * u[4] - u[3] * u[1];
    let rows = (Vector3::new(u[0], u[1], 0.0), u[2], Vector3::new(u[3], u[4], 0.0));
    let ty = signed(ty_squared(sum, determinant).sqrt(), rows, points, image);
    let [r1, r2, tx, r4, r5] = [u[0], u[1], u[2], u[3], u[4]].map(|v| v * ty);
    let r3 = (1.0 - r1 * r1 - r2 * r2).max(0.0).sqrt();
    // Rows are orthogonal: r3 r6 = -(r1 r4 + r2 r5).
    let r6 = (1.0 - r4 * r4 - r5 * r5).max(0.0).sqrt() * -(r1 * r4 + r2 * r5).signum();
    Ok((rotation_from_rows(Vector3::new(r1, r2, r3), Vector3::new(r4, r5, r6))?, tx, ty, 1.0))
}

/// (R, Tx, Ty, change of sx) from sx r1/Ty, sx r2/Ty, sx r3/Ty, sx Tx/Ty, r4/Ty, r5/Ty, r6/Ty.
fn in_space(
    u: &DVector<f64>,
    points: &[Vector3<f64>],
    image: &[Vector2<f64>],
) -> Result<(Matrix3<f64>, f64, f64, f64)> {
    let (first, second) = (Vector3::new(u[0], u[1], u[2]), Vector3::new(u[4], u[5], u[6]));
    let ty = signed(1.0 / second.norm(), (first, u[3], second), points, image);
    let stretch = ty.abs() * first.norm();
    if !(stretch.is_finite() && (0.2..5.0).contains(&stretch)) {
        let reason = format!(
            "the horizontal scale came out as {stretch:.3}; check dpx_mm and dpy_mm, and the order of the points"
        );
        return Err(Error::degenerate(METHOD, reason));
    }
    let rotation = rotation_from_rows(first * (ty / stretch), second * ty)?;
    Ok((rotation, u[3] * ty / stretch, ty, stretch))
}

/// The angle by which the first two rows of R, found one by one, miss a right one.
fn skew_rad(u: &DVector<f64>) -> f64 {
    let (first, second) = (Vector3::new(u[0], u[1], u[2]), Vector3::new(u[4], u[5], u[6]));
    std::f64::consts::FRAC_PI_2 - first.angle(&second)
}

fn rotation_from_rows(first: Vector3<f64>, second: Vector3<f64>) -> Result<Matrix3<f64>> {
    let third = first.cross(&second);
    let rows = Matrix3::from_rows(&[first.transpose(), second.transpose(), third.transpose()]);
    nearest_rotation(&rows).ok_or_else(|| Error::degenerate(METHOD, "the points give no rotation"))
}
