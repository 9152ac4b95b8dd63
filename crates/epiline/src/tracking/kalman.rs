//! The filter of one track: position and velocity in a plane, disturbed by white acceleration.

use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};

use super::EgoMotion;

/// State `[x, z, vx, vz]` and its covariance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Filter {
    pub state: Vector4<f64>,
    pub covariance: Matrix4<f64>,
}

/// A measured position held against a state.
#[derive(Debug, Clone, Copy)]
pub(super) struct Innovation {
    residual: Vector2<f64>,
    inverse: Matrix2<f64>,
    /// Squared Mahalanobis distance: chi-square with two degrees of freedom.
    pub squared_distance: f64,
    /// Logarithm of the determinant of the innovation's covariance.
    pub log_determinant: f64,
}

impl Filter {
    /// A state that is known by one position and, of its velocity, only how fast things are.
    pub fn new(position: Vector2<f64>, covariance: Matrix2<f64>, velocity_sigma: f64) -> Self {
        let mut all = Matrix4::zeros();
        all.fixed_view_mut::<2, 2>(0, 0).copy_from(&covariance);
        all.fixed_view_mut::<2, 2>(2, 2).fill_diagonal(velocity_sigma * velocity_sigma);
        Self { state: Vector4::new(position.x, position.y, 0.0, 0.0), covariance: all }
    }

    /// Moves on by `dt` seconds; each component of velocity walks with a variance of `walk²·dt`.
    ///
    /// The noise of two steps is that of one of their length: a dropped frame changes nothing but what was not seen.
    pub fn predict(&mut self, dt: f64, walk: f64) {
        let mut transition = Matrix4::identity();
        (transition[(0, 2)], transition[(1, 3)]) = (dt, dt);
        let density = walk * walk;
        let (velocity, mixed, position) =
            (density * dt, density * dt * dt / 2.0, density * dt * dt * dt / 3.0);
        let noise = Matrix4::new(
            position, 0.0, mixed, 0.0, //
            0.0, position, 0.0, mixed, //
            mixed, 0.0, velocity, 0.0, //
            0.0, mixed, 0.0, velocity,
        );
        self.state = transition * self.state;
        self.covariance = transition * self.covariance * transition.transpose() + noise;
    }

    /// Into the axes of a camera that has moved.
    pub fn follow(&mut self, ego: &EgoMotion) {
        let (sin, cos) = ego.yaw_rad.sin_cos();
        let mut turn = Matrix4::zeros();
        let plane = Matrix2::new(cos, -sin, sin, cos);
        turn.fixed_view_mut::<2, 2>(0, 0).copy_from(&plane);
        turn.fixed_view_mut::<2, 2>(2, 2).copy_from(&plane);
        self.state.x -= ego.right_m;
        self.state.y -= ego.forward_m;
        self.state = turn * self.state;
        self.covariance = turn * self.covariance * turn.transpose();
    }

    /// What a position measured with a covariance says; `None` if the covariances are too small to be inverted.
    pub fn innovation(&self, position: Vector2<f64>, covariance: &Matrix2<f64>) -> Option<Innovation> {
        let residual = position - self.state.xy();
        let spread = self.covariance.fixed_view::<2, 2>(0, 0) + covariance;
        let inverse = spread.try_inverse()?;
        let squared_distance = residual.dot(&(inverse * residual));
        let log_determinant = spread.determinant().ln();
        (squared_distance.is_finite() && log_determinant.is_finite()).then_some(Innovation {
            residual,
            inverse,
            squared_distance,
            log_determinant,
        })
    }

    /// Takes a measurement in; Joseph's form keeps the covariance symmetric and positive.
    pub fn update(&mut self, innovation: &Innovation, covariance: &Matrix2<f64>) {
        let observe = Matrix2x4::identity();
        let gain = self.covariance * observe.transpose() * innovation.inverse;
        self.state += gain * innovation.residual;
        let kept = Matrix4::identity() - gain * observe;
        self.covariance = kept * self.covariance * kept.transpose() + gain * covariance * gain.transpose();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_are_one_step_of_their_length() {
        let mut once = Filter::new(Vector2::new(1.0, 5.0), Matrix2::new(0.04, 0.01, 0.01, 0.09), 3.0);
        once.state[2] = -1.5;
        let mut twice = once;
        once.predict(0.3, 2.0);
        twice.predict(0.1, 2.0);
        twice.predict(0.2, 2.0);
        assert!((once.state - twice.state).norm() < 1e-12);
        assert!((once.covariance - twice.covariance).norm() < 1e-12);
    }

    #[test]
    fn a_camera_that_turns_right_sees_things_move_left() {
        let mut ahead = Filter::new(Vector2::new(0.0, 10.0), Matrix2::new(1.0, 0.0, 0.0, 4.0), 1.0);
        ahead.follow(&EgoMotion { right_m: 0.0, forward_m: 2.0, yaw_rad: std::f64::consts::FRAC_PI_2 });
        assert!((ahead.state.x + 8.0).abs() < 1e-12 && ahead.state.y.abs() < 1e-12);
        assert!((ahead.covariance[(0, 0)] - 4.0).abs() < 1e-12);
    }
}
