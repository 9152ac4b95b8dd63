//! What is solved for: two turns that put epipolar lines on rows, and as much of the lenses as is unknown.

use nalgebra::{Matrix2x5, Matrix3, RowSVector, SVector, Vector2, Vector3};

use crate::camera::{Brown, CameraModel, CameraView, Lens};

/// Two image points of one scene point: left, right, pixels of the photographs.
pub(super) type Match = [Vector2<f64>; 2];

/// Pitch of right against left, yaw and roll of the left, yaw and roll of the right camera, radians; logarithms of
/// the focal length and of the right one's ratio to the left; principal points; radial distortion.
pub(super) const UNKNOWNS: usize = 14;
/// The angles come first: they are all there is to solve for when the lenses are known.
pub(super) const ANGLES: usize = 5;
const LOG_FOCAL: usize = 5;
const LOG_RATIO: usize = 6;
const CENTERS: [usize; 2] = [7, 9];
/// Radial displacement of r² and r⁴ at the reference radius, as a share of it, and what the right lens has more.
const BEND: usize = 11;
const BEND_DIFFERENCE: usize = 12;
const BEND4: usize = 13;

/// Rays nearer to the aligned image's plane than this have no place in it; unit rays are 84 degrees off the axis there.
const LEAST_Z: f64 = 0.1;

pub(super) type Unknowns = SVector<f64, UNKNOWNS>;
pub(super) type Gradient = RowSVector<f64, UNKNOWNS>;

/// Expected value and standard deviation of every unknown before the pair is looked at.
///
/// They hold for any two cameras of one kind placed side by side by hand: 8 degrees of pointing error, a focal length
/// within a factor of two of the image's longer side, principal points 3 % of it off the middle, barrel distortion
/// rather than pincushion. What the matches determine, they determine far better.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prior {
    pub mean: Unknowns,
    pub sigma: Unknowns,
}

/// The lenses, or what stands in for them.
#[expect(clippy::large_enum_variant, reason = "one exists at a time")]
#[derive(Debug, Clone, Copy)]
pub(super) enum Lenses {
    /// Calibrated: only the angles are solved for.
    Known([CameraModel; 2]),
    /// Two cameras of one kind with images of this size, pixels.
    Unknown {
        /// Image width, pixels.
        width: usize,
        /// Image height, pixels.
        height: usize,
    },
}

impl Lenses {
    /// Unknowns that are solved for: the first so many.
    pub fn free(&self) -> usize {
        match self {
            Self::Known(_) => ANGLES,
            Self::Unknown { .. } => UNKNOWNS,
        }
    }

    /// Image width and height, pixels.
    pub fn size(&self) -> [usize; 2] {
        match *self {
            Self::Known([left, _]) => [left.width, left.height],
            Self::Unknown { width, height } => [width, height],
        }
    }

    /// Half the diagonal, pixels: the radius at which distortion is stated.
    fn reference_px(&self) -> f64 {
        let [width, height] = self.size().map(|side| side as f64);
        0.5 * width.hypot(height)
    }

    pub fn prior(&self) -> Prior {
        let [width, height] = self.size().map(|side| side as f64);
        let long = width.max(height);
        let mut mean = Unknowns::zeros();
        let mut sigma = Unknowns::repeat(8f64.to_radians());
        (mean[LOG_FOCAL], sigma[LOG_FOCAL]) = (long.ln(), 0.35);
        sigma[LOG_RATIO] = 0.015;
        for at in CENTERS {
            (mean[at], mean[at + 1]) = (0.5 * (width - 1.0), 0.5 * (height - 1.0));
            (sigma[at], sigma[at + 1]) = (0.03 * long, 0.03 * long);
        }
        (mean[BEND], sigma[BEND]) = (-0.05, 0.10);
        sigma[BEND_DIFFERENCE] = 0.01;
        sigma[BEND4] = 0.03;
        Prior { mean, sigma }
    }

    /// Where the search starts: the prior's mean if the lenses are known, else also shorter and longer focal lengths
    /// with and without distortion.
    pub fn starts(&self) -> Vec<Unknowns> {
        let mean = self.prior().mean;
        match self {
            Self::Known(_) => vec![mean],
            Self::Unknown { .. } => {
                let choices = [0.0, 0.5, -0.5].into_iter().flat_map(|focal| [(focal, 0.0), (focal, -0.12)]);
                let start = |(log_focal, bend)| {
                    let mut start = mean;
                    start[LOG_FOCAL] += log_focal;
                    start[BEND] = bend;
                    start
                };
                choices.map(start).collect()
            }
        }
    }

    /// The cameras and turns that the unknowns stand for.
    pub fn rig(&self, unknowns: &Unknowns) -> Rig {
        let cameras = match *self {
            Self::Known(cameras) => cameras,
            Self::Unknown { width, height } => [0, 1].map(|side| {
                let right = side as f64;
                let focal = (unknowns[LOG_FOCAL] + (right - 0.5) * unknowns[LOG_RATIO]).exp();
                let [bend2, bend4] =
                    [unknowns[BEND] + (right - 0.5) * unknowns[BEND_DIFFERENCE], unknowns[BEND4]];
                let unit = (focal / self.reference_px()).powi(2);
                CameraModel {
                    focal_px: [focal, focal],
                    center_px: [unknowns[CENTERS[side]], unknowns[CENTERS[side] + 1]],
                    lens: Brown { k1: bend2 * unit, k2: bend4 * unit * unit, ..Brown::default() }.into(),
                    width,
                    height,
                }
            }),
        };
        let [pitch, left_yaw, left_roll, right_yaw, right_roll] =
            [unknowns[0], unknowns[1], unknowns[2], unknowns[3], unknowns[4]];
        let turns =
            [Turn::new(-0.5 * pitch, left_yaw, left_roll), Turn::new(0.5 * pitch, right_yaw, right_roll)];
        Rig { cameras: cameras.map(|camera| camera.view()), turns, focal_px: focal_of(&cameras) }
    }
}

/// The common focal length of the aligned images, pixels.
fn focal_of(cameras: &[CameraModel; 2]) -> f64 {
    (cameras[0].focal_px[1] * cameras[1].focal_px[1]).sqrt()
}

/// Rotation of a camera into the aligned frame, `Rx(pitch) Rz(roll) Ry(yaw)`, and its derivatives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    pub rotation: Matrix3<f64>,
    /// By pitch, yaw and roll.
    derivatives: [Matrix3<f64>; 3],
}

impl Turn {
    fn new(pitch: f64, yaw: f64, roll: f64) -> Self {
        let about =
            |axis: Vector3<f64>, angle: f64| nalgebra::Rotation3::from_scaled_axis(axis * angle).into_inner();
        let [ex, ey, ez] = [Vector3::x(), Vector3::y(), Vector3::z()];
        let (rx, ry, rz) = (about(ex, pitch), about(ey, yaw), about(ez, roll));
        let rotation = rx * rz * ry;
        let derivatives = [
            ex.cross_matrix() * rotation,
            rx * rz * ey.cross_matrix() * ry,
            rx * ez.cross_matrix() * rz * ry,
        ];
        Self { rotation, derivatives }
    }
}

/// Two cameras and how each is turned into the frame in which epipolar lines are rows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rig {
    pub cameras: [CameraView; 2],
    pub turns: [Turn; 2],
    pub focal_px: f64,
}

impl Rig {
    /// Aligned positions of a match, normalised by the focal length; `None` where a lens model folds or a ray leaves the
    /// aligned view.
    pub fn align(&self, points: &Match) -> Option<[Vector2<f64>; 2]> {
        self.align_rays(&self.rays(points)?)
    }

    /// Rays of a match in its cameras' own frames, `z = 1`.
    pub fn rays(&self, points: &Match) -> Option<[Vector3<f64>; 2]> {
        let ray = |side: usize| Some(self.cameras[side].normalised_from_pixel(points[side])?.push(1.0));
        Some([ray(0)?, ray(1)?])
    }

    /// Aligned normalised positions of rays.
    pub fn align_rays(&self, rays: &[Vector3<f64>; 2]) -> Option<[Vector2<f64>; 2]> {
        let turned = [0, 1].map(|side| self.turns[side].rotation * rays[side]);
        turned.iter().all(|ray| ray.z > LEAST_Z).then(|| turned.map(|ray| ray.xy() / ray.z))
    }

    /// The photograph's pixel at an aligned normalised position; `None` where the lens model folds.
    pub fn pixel_of(&self, side: usize, aligned: Vector2<f64>) -> Option<Vector2<f64>> {
        let ray = self.turns[side].rotation.transpose() * aligned.push(1.0);
        if ray.z > LEAST_Z { self.cameras[side].project(&ray) } else { None }
    }

    /// Vertical disparity after alignment, `y_right - y_left`, pixels of the aligned images.
    pub fn vertical_px(&self, points: &Match) -> Option<f64> {
        let [left, right] = self.align(points)?;
        Some(self.focal_px * (right.y - left.y))
    }

    /// Vertical disparity and its derivative by the unknowns; those of the lenses are zero if `free` is [`ANGLES`].
    pub fn vertical_and_gradient(
        &self,
        points: &Match,
        free: usize,
        reference_px: f64,
    ) -> Option<(f64, Gradient)> {
        let mut gradient = Gradient::zeros();
        let mut vertical = 0.0;
        for (side, sign) in [(0, -1.0), (1, 1.0)] {
            let (camera, turn) = (&self.cameras[side], &self.turns[side]);
            let ideal = camera.normalised_from_pixel(points[side])?;
            let ray = turn.rotation * ideal.push(1.0);
            if ray.z <= LEAST_Z {
                return None;
            }
            let y = ray.y / ray.z;
            let scale = sign * self.focal_px / ray.z;
            vertical += sign * self.focal_px * y;
            let by_angle = turn.derivatives.map(|d| {
                let moved = d * ideal.push(1.0);
                scale * (moved.y - y * moved.z)
            });
            gradient[0] += by_angle[0] * 0.5 * sign;
            gradient[1 + 2 * side] = by_angle[1];
            gradient[2 + 2 * side] = by_angle[2];
            if free > ANGLES {
                let row = turn.rotation.row(1) - y * turn.rotation.row(2);
                let by_lens =
                    scale * row.columns(0, 2) * ideal_by_lens(camera.camera(), ideal, reference_px)?;
                let half = 0.5 * sign;
                gradient[LOG_FOCAL] += by_lens[0] + sign * self.focal_px * y;
                gradient[LOG_RATIO] += half * by_lens[0];
                gradient[CENTERS[side]] = by_lens[1];
                gradient[CENTERS[side] + 1] = by_lens[2];
                gradient[BEND] += by_lens[3];
                gradient[BEND_DIFFERENCE] += half * by_lens[3];
                gradient[BEND4] += by_lens[4];
            }
        }
        Some((vertical, gradient))
    }

    /// The pixels at which a scene point appears that has the aligned normalised left position and disparity given.
    pub fn scene_point(&self, left: Vector2<f64>, disparity: f64) -> Option<Match> {
        Some([self.pixel_of(0, left)?, self.pixel_of(1, left - Vector2::new(disparity, 0.0))?])
    }
}

impl Lenses {
    /// Vertical disparity of a match and its derivative by the unknowns.
    pub fn vertical_and_gradient(&self, rig: &Rig, points: &Match) -> Option<(f64, Gradient)> {
        rig.vertical_and_gradient(points, self.free(), self.reference_px())
    }
}

/// How the ideal point of a pixel moves with log focal length, principal point, and the two bends.
///
/// From `distort(ideal, k) = (pixel - center)/focal`, differentiated on both sides.
fn ideal_by_lens(camera: &CameraModel, ideal: Vector2<f64>, reference_px: f64) -> Option<Matrix2x5<f64>> {
    let focal = camera.focal_px[0];
    let unit = (focal / reference_px).powi(2);
    // Only known lenses are of other kinds.
    let Lens::Brown(distortion) = &camera.lens else { return None };
    let distorted = distortion.apply(ideal);
    let r2 = ideal.norm_squared();
    let (by_k1, by_k2) = (ideal * r2, ideal * r2 * r2);
    // k1 = bend·(f/ρ)² and k2 = bend4·(f/ρ)⁴ move with the focal length too.
    let by_log_focal = -distorted - by_k1 * (2.0 * distortion.k1) - by_k2 * (4.0 * distortion.k2);
    let right_side = Matrix2x5::from_columns(&[
        by_log_focal,
        Vector2::new(-1.0 / focal, 0.0),
        Vector2::new(0.0, -1.0 / focal),
        -by_k1 * unit,
        -by_k2 * unit * unit,
    ]);
    Some(distortion.jacobian(ideal).try_inverse()? * right_side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_matches_central_differences() {
        let lenses = Lenses::Unknown { width: 640, height: 480 };
        let mut at = lenses.prior().mean;
        let offsets = [0.02, -0.05, 0.03, 0.04, -0.02, -0.1, 0.01, 5.0, -7.0, 3.0, 9.0, -0.03, 0.004, 0.01];
        for (value, offset) in at.iter_mut().zip(offsets) {
            *value += offset;
        }
        let points = [Vector2::new(130.0, 400.0), Vector2::new(90.0, 388.0)];
        let (_, gradient) = lenses.vertical_and_gradient(&lenses.rig(&at), &points).expect("in view");
        for i in 0..UNKNOWNS {
            let h = 1e-5 * at[i].abs().max(0.1);
            let moved = |sign: f64| {
                let mut moved = at;
                moved[i] += sign * h;
                lenses.rig(&moved).vertical_px(&points).expect("in view")
            };
            let numeric = (moved(1.0) - moved(-1.0)) / (2.0 * h);
            assert!(
                (numeric - gradient[i]).abs() < 1e-5 * numeric.abs().max(1.0),
                "{i}: {numeric} {}",
                gradient[i]
            );
        }
    }
}
