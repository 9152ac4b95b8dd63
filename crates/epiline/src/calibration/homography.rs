//! Plane-to-image homographies and what they say about a camera (Zhang, "A flexible new technique for camera
//! calibration", IEEE PAMI 22(11), 2000).

use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};

use crate::camera::Pose;

/// Centroid and mean distance from it: Hartley's normalisation of a point set.
struct Normalisation {
    center: Vector2<f64>,
    scale: f64,
}

impl Normalisation {
    fn of(points: impl Iterator<Item = Vector2<f64>> + Clone) -> Option<Self> {
        let count = points.clone().count() as f64;
        let center = points.clone().sum::<Vector2<f64>>() / count;
        let spread = points.map(|p| (p - center).norm()).sum::<f64>() / count;
        (spread > 0.0 && spread.is_finite())
            .then(|| Self { center, scale: std::f64::consts::SQRT_2 / spread })
    }

    fn apply(&self, point: Vector2<f64>) -> Vector2<f64> {
        (point - self.center) * self.scale
    }

    fn matrix(&self) -> Matrix3<f64> {
        let Self { center, scale } = self;
        Matrix3::new(*scale, 0.0, -scale * center.x, 0.0, *scale, -scale * center.y, 0.0, 0.0, 1.0)
    }
}

/// The homography with `image ~ H (x, y, 1)ᵀ` for points of the plane z = 0, by linear least squares.
///
/// `None` if the points do not determine it: fewer than four, or all but one on a line.
pub(super) fn fit(board_m: &[[f64; 3]], image: &[[f64; 2]]) -> Option<Matrix3<f64>> {
    if board_m.len() < 4 {
        return None;
    }
    let plane = board_m.iter().map(|p| Vector2::new(p[0], p[1]));
    let image = image.iter().map(|p| Vector2::from(*p));
    let (from, to) = (Normalisation::of(plane.clone())?, Normalisation::of(image.clone())?);
    // The board's centroid is in view, so in normalised coordinates h33 cannot vanish: set it to 1.
    let mut normal = SMatrix::<f64, 8, 8>::zeros();
    let mut right_side = SVector::<f64, 8>::zeros();
    for (point, pixel) in plane.zip(image) {
        let (p, q) = (from.apply(point), to.apply(pixel));
        let row_x = SVector::<f64, 8>::from([p.x, p.y, 1.0, 0.0, 0.0, 0.0, -q.x * p.x, -q.x * p.y]);
        let row_y = SVector::<f64, 8>::from([0.0, 0.0, 0.0, p.x, p.y, 1.0, -q.y * p.x, -q.y * p.y]);
        normal.ger(1.0, &row_x, &row_x, 1.0);
        normal.ger(1.0, &row_y, &row_y, 1.0);
        right_side += row_x * q.x + row_y * q.y;
    }
    // Collinear points make the system singular; relative to its trace that is plain to see.
    let smallest = normal.symmetric_eigenvalues().min();
    if smallest < 1e-9 * normal.trace() {
        return None;
    }
    let h = normal.cholesky()?.solve(&right_side);
    let normalised = Matrix3::new(h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0);
    let homography = to.matrix().try_inverse()? * normalised * from.matrix();
    homography.iter().all(|v| v.is_finite()).then(|| homography / homography.norm())
}

/// Focal lengths and principal point of a camera without distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pinhole {
    pub focal_px: [f64; 2],
    pub center_px: [f64; 2],
}

impl Pinhole {
    fn inverse_matrix(&self) -> Matrix3<f64> {
        let ([fx, fy], [cx, cy]) = (self.focal_px, self.center_px);
        Matrix3::new(1.0 / fx, 0.0, -cx / fx, 0.0, 1.0 / fy, -cy / fy, 0.0, 0.0, 1.0)
    }
}

/// Row of Zhang's equation 8 for skew zero: `hᵢᵀ B hⱼ` as a product with (B11, B22, B13, B23, B33).
fn conic_row(a: &Vector3<f64>, b: &Vector3<f64>) -> SVector<f64, 5> {
    SVector::from([a.x * b.x, a.y * b.y, a.x * b.z + a.z * b.x, a.y * b.z + a.z * b.y, a.z * b.z])
}

/// Columns of a homography for pixels moved to the image centre and divided by the image size.
fn centred_columns(
    homography: &Matrix3<f64>,
    (width, height): (usize, usize),
) -> (Vector3<f64>, Vector3<f64>, f64) {
    let scale = 1.0 / (width.max(height) as f64);
    let (cx, cy) = (0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0));
    let centred = Matrix3::new(scale, 0.0, -scale * cx, 0.0, scale, -scale * cy, 0.0, 0.0, 1.0) * homography;
    (centred.column(0).into_owned(), centred.column(1).into_owned(), scale)
}

/// Zhang's closed form, skew zero; `None` if the views do not give a camera.
pub(super) fn zhang(homographies: &[Matrix3<f64>], size: (usize, usize)) -> Option<Pinhole> {
    let mut normal = SMatrix::<f64, 5, 5>::zeros();
    let mut scale = 1.0;
    for homography in homographies {
        let (a, b, s) = centred_columns(homography, size);
        scale = s;
        // One weight per view: the size of its columns is arbitrary.
        let weight = 1.0 / (a.norm_squared() * b.norm_squared());
        let orthogonal = conic_row(&a, &b);
        let equal_length = conic_row(&a, &a) - conic_row(&b, &b);
        normal.ger(weight, &orthogonal, &orthogonal, 1.0);
        normal.ger(weight, &equal_length, &equal_length, 1.0);
    }
    let eigen = normal.symmetric_eigen();
    let [b11, b22, b13, b23, b33]: [f64; 5] =
        eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned().into();
    let (x, y) = (-b13 / b11, -b23 / b22);
    let lambda = b33 - b13 * b13 / b11 - b23 * b23 / b22;
    let (fx2, fy2) = (lambda / b11, lambda / b22);
    (fx2 > 0.0 && fy2 > 0.0 && fx2.is_finite() && fy2.is_finite()).then(|| Pinhole {
        focal_px: [fx2.sqrt() / scale, fy2.sqrt() / scale],
        center_px: [
            x / scale + 0.5 * (size.0 as f64 - 1.0), //
            y / scale + 0.5 * (size.1 as f64 - 1.0),
        ],
    })
}

/// One focal length with the principal point in the image centre: both of Zhang's constraints, one unknown.
pub(super) fn centred_focal(homographies: &[Matrix3<f64>], size: (usize, usize)) -> Option<Pinhole> {
    let (mut numerator, mut denominator, mut scale) = (0.0, 0.0, 1.0);
    for homography in homographies {
        let (a, b, s) = centred_columns(homography, size);
        scale = s;
        let weight = 1.0 / (a.norm_squared() * b.norm_squared());
        // (a·b in x and y)/f² + a.z b.z = 0, and the same for |a|² - |b|².
        for (plane, depth) in [
            (a.xy().dot(&b.xy()), a.z * b.z), //
            (a.xy().norm_squared() - b.xy().norm_squared(), a.z * a.z - b.z * b.z),
        ] {
            numerator -= weight * plane * depth;
            denominator += weight * plane * plane;
        }
    }
    let inverse_focal_squared = numerator / denominator;
    (inverse_focal_squared > 0.0 && inverse_focal_squared.is_finite()).then(|| {
        let focal_px = 1.0 / (inverse_focal_squared.sqrt() * scale);
        Pinhole { focal_px: [focal_px; 2], center_px: image_center(size) }
    })
}

/// The middle of the image, pixels.
pub(super) fn image_center((width, height): (usize, usize)) -> [f64; 2] {
    [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)]
}

/// `camera_from_board` from a homography; `None` if the homography belongs to no plane in front of the camera.
pub(super) fn pose(homography: &Matrix3<f64>, camera: &Pinhole) -> Option<Pose> {
    let mut columns = camera.inverse_matrix() * homography;
    let scale = 2.0 / (columns.column(0).norm() + columns.column(1).norm());
    // The board is in front of the camera: its origin may be behind in principle, its points may not.
    columns *= if columns[(2, 2)] < 0.0 { -scale } else { scale };
    let (first, second) = (columns.column(0).into_owned(), columns.column(1).into_owned());
    let third = first.cross(&second);
    let rotation = nearest_rotation(&Matrix3::from_columns(&[first, second, third]))?;
    let translation_m = columns.column(2).into_owned();
    translation_m.iter().all(|v| v.is_finite()).then_some(Pose { rotation, translation_m })
}

/// The rotation closest to a matrix in the Frobenius norm.
pub(super) fn nearest_rotation(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    if !matrix.iter().all(|v| v.is_finite()) {
        return None;
    }
    let svd = matrix.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    Some(u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    const SIZE: (usize, usize) = (640, 480);
    const CAMERA: Pinhole = Pinhole { focal_px: [520.0, 530.0], center_px: [331.0, 229.0] };

    fn board() -> Vec<[f64; 3]> {
        (0..54).map(|i| [f64::from(i % 9) * 0.025, f64::from(i / 9) * 0.025, 0.0]).collect()
    }

    fn view(pose: &Pose) -> Vec<[f64; 2]> {
        let see = |p: &[f64; 3]| {
            let q = pose.apply(Vector3::from(*p));
            [
                CAMERA.focal_px[0] * q.x / q.z + CAMERA.center_px[0],
                CAMERA.focal_px[1] * q.y / q.z + CAMERA.center_px[1],
            ]
        };
        board().iter().map(see).collect()
    }

    fn poses() -> Vec<Pose> {
        [[0.4, 0.1, 0.0], [-0.3, 0.35, 0.2], [0.1, -0.5, -0.1], [0.25, 0.3, 1.2]]
            .into_iter()
            .map(|angles| Pose {
                rotation: Rotation3::from_scaled_axis(Vector3::from(angles)).into_inner(),
                translation_m: Vector3::new(-0.08, -0.06, 0.4),
            })
            .collect()
    }

    #[test]
    fn zhang_recovers_an_ideal_camera() {
        let homographies: Vec<_> =
            poses().iter().map(|p| fit(&board(), &view(p)).expect("a plane in view")).collect();
        let found = zhang(&homographies, SIZE).expect("four tilted views");
        for i in 0..2 {
            assert!((found.focal_px[i] - CAMERA.focal_px[i]).abs() < 1e-6, "{found:?}");
            assert!((found.center_px[i] - CAMERA.center_px[i]).abs() < 1e-6, "{found:?}");
        }
        for (homography, truth) in homographies.iter().zip(poses()) {
            let found = pose(homography, &CAMERA).expect("a pose");
            assert!((found.rotation - truth.rotation).norm() < 1e-8);
            assert!((found.translation_m - truth.translation_m).norm() < 1e-8);
        }
    }

    #[test]
    fn a_line_of_corners_has_no_homography() {
        let line: Vec<_> = (0..9).map(|i| [f64::from(i) * 0.025, 0.0, 0.0]).collect();
        let image: Vec<_> = (0..9).map(|i| [100.0 + 20.0 * f64::from(i), 200.0]).collect();
        assert_eq!(fit(&line, &image), None);
    }
}
