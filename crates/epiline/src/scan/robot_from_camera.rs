//! Where the camera sits on the robot.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::error::{Error, Result};
use crate::ground::GroundPlane;

/// How far a rotation may be from orthonormal.
const ROTATION_TOLERANCE: f64 = 1e-6;

/// Pose of the left aligned camera on the robot.
///
/// The robot's frame is REP 103's: x forward, y left, z up, the floor at z = 0. The camera's is the optical one: z
/// forward, x right, y down.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotFromCamera {
    rotation: Matrix3<f64>,
    translation_m: Vector3<f64>,
}

impl RobotFromCamera {
    /// `p_robot = rotation · p_camera + translation`.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] unless the rotation is one, all is finite, and the camera is not below the floor.
    pub fn new(rotation: Matrix3<f64>, translation_m: Vector3<f64>) -> Result<Self> {
        if !translation_m.iter().all(|value| value.is_finite()) || translation_m.z < 0.0 {
            let [x, y, z]: [f64; 3] = translation_m.into();
            let expected = "must be finite, and the camera not below the floor, z = 0";
            return Err(Error::invalid(
                "robot_from_camera",
                format!("translation ({x}, {y}, {z}) m"),
                expected,
            ));
        }
        let off = (rotation.transpose() * rotation - Matrix3::identity()).amax();
        // Not a number is no rotation either.
        if !(off <= ROTATION_TOLERANCE && rotation.determinant() > 0.0) {
            let value = format!("a rotation that is off by {off:.2e}");
            return Err(Error::invalid("robot_from_camera", value, "must be orthonormal and right-handed"));
        }
        Ok(Self { rotation, translation_m })
    }

    /// From what is measured with a tape and a level: the camera's place, how far it points down (`pitch`), leans to
    /// the right (`roll`) and points to the left (`yaw`), radians: REP 103's signs.
    ///
    /// # Errors
    ///
    /// As [`new`](Self::new).
    pub fn from_angles(position_m: [f64; 3], roll_rad: f64, pitch_rad: f64, yaw_rad: f64) -> Result<Self> {
        let body_from_optical = Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
        let robot_from_body = Rotation3::from_euler_angles(roll_rad, pitch_rad, yaw_rad);
        Self::new(robot_from_body.matrix() * body_from_optical, position_m.into())
    }

    /// A robot that is nothing but its camera: on the floor below it, looking the same way.
    pub(super) fn over(ground: &GroundPlane) -> Result<Self> {
        let GroundPlane { camera_height_m, roll_rad, pitch_rad, .. } = *ground;
        Self::from_angles([0.0, 0.0, camera_height_m], roll_rad, pitch_rad, 0.0)
    }

    /// Maps directions of the camera to those of the robot.
    pub fn rotation(&self) -> &Matrix3<f64> {
        &self.rotation
    }

    /// Where the camera is on the robot, metres.
    pub fn translation_m(&self) -> &Vector3<f64> {
        &self.translation_m
    }

    /// Straight down, in the camera's frame.
    pub(super) fn down(&self) -> Vector3<f64> {
        -self.rotation.row(2).transpose()
    }

    /// Angle of a horizontal direction of the camera's frame about the robot's z, from x, radians.
    pub(super) fn angle_rad(&self, direction: &Vector3<f64>) -> f64 {
        let direction = self.rotation * direction;
        direction.y.atan2(direction.x)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn down_is_what_the_ground_calls_down() {
        let (roll_rad, pitch_rad) = (0.07, 0.3);
        let mounting =
            RobotFromCamera::from_angles([0.1, 0.0, 0.5], roll_rad, pitch_rad, -0.4).expect("a pose");
        let (down, pitch) = (mounting.down(), pitch_rad.sin());
        let expected =
            Vector3::new(pitch_rad.cos() * roll_rad.sin(), pitch_rad.cos() * roll_rad.cos(), pitch);
        assert!((down - expected).norm() < 1e-12);
        // What lies ahead of a camera turned to the right lies to the robot's right.
        assert!(mounting.angle_rad(&Vector3::z()) < -0.3);
    }

    #[test]
    fn what_is_no_pose_is_refused() {
        let at = Vector3::new(0.0, 0.0, 0.3);
        assert!(RobotFromCamera::new(Matrix3::identity() * 1.1, at).is_err());
        assert!(RobotFromCamera::new(-Matrix3::identity(), at).is_err());
        assert!(RobotFromCamera::new(Matrix3::identity().map(|v: f64| v * f64::NAN), at).is_err());
        assert!(RobotFromCamera::from_angles([0.0, 0.0, -0.1], 0.0, 0.0, 0.0).is_err());
        assert!(RobotFromCamera::from_angles([0.0, f64::NAN, 0.1], 0.0, 0.0, 0.0).is_err());
    }
}
