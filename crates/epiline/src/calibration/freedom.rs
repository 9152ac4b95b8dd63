//! From the names of held and shared parameters to the solver's slots.

use super::options::{BundleOptions, LensModel};
use super::solver::{Freedom, representatives};
use crate::camera::{CameraModel, StereoCalibration};
use crate::error::{Error, Result};

/// Which parameters are free, by the names that users know them by.
pub(super) struct Plan {
    free: Vec<bool>,
    ties: Vec<(usize, usize)>,
    /// Intrinsic parameters of a camera.
    intrinsics: usize,
}

impl Plan {
    /// Fails, naming the choices, for a name that is no parameter's, and where a fixed parameter has no value.
    pub fn of(options: &BundleOptions) -> Result<Self> {
        let constraints = &options.constraints;
        let coefficients = options.lens.lens().coefficient_names();
        let own: Vec<&str> = CameraModel::PINHOLE_PARAMETERS.iter().chain(coefficients).copied().collect();
        let k = own.len();
        let mut plan =
            Self { free: vec![true; 2 * k + Freedom::POSE_AND_WARP], ties: Vec::new(), intrinsics: k };
        plan.free[2 * k + 6..].fill(options.solve_warp);
        if options.lens == LensModel::Brown4 {
            (plan.free[k - 1], plan.free[2 * k - 1]) = (false, false);
        }
        for name in &constraints.fixed {
            let (sides, bare) = match name.split_once('_') {
                Some(("left", rest)) => (0..1, rest),
                Some(("right", rest)) => (1..2, rest),
                _ => (0..2, name.as_str()),
            };
            let pose = StereoCalibration::POSE_PARAMETERS.iter().position(|p| p == name);
            let needs_value = pose.is_some() || ["fx", "fy"].contains(&bare);
            if needs_value && constraints.initial.is_none() {
                let reason = "a fixed focal length or pose needs a value: give an initial calibration";
                return Err(Error::invalid("fix", format!("{name:?}"), reason));
            }
            if let Some(axis) = pose {
                plan.free[2 * k + axis] = false;
                continue;
            }
            let found = places("fix", bare, &own)?;
            for side in sides {
                found.iter().for_each(|at| plan.free[side * k + at] = false);
            }
        }
        for name in &constraints.shared {
            plan.ties.extend(places("share", name, &own)?.into_iter().map(|at| (at, k + at)));
        }
        if constraints.square_pixels {
            plan.ties.extend([(0, 1), (k, k + 1)]);
        }
        Ok(plan)
    }

    /// Of both cameras together.
    pub fn joint(&self) -> Freedom {
        Freedom::new(&self.free, &self.ties)
    }

    /// Of one camera alone, in the place of the left one, its coefficients beyond the first `coefficients` held.
    pub fn of_camera(&self, camera: usize, coefficients: usize) -> Freedom {
        let k = self.intrinsics;
        let mut free = vec![false; self.free.len()];
        free[..k].copy_from_slice(&self.free[camera * k..(camera + 1) * k]);
        free[(4 + coefficients).min(k)..k].fill(false);
        let within = |at: usize| (camera * k..(camera + 1) * k).contains(&at);
        let own = self.ties.iter().filter(|(a, b)| within(*a) && within(*b));
        Freedom::new(&free, &own.map(|(a, b)| (a - camera * k, b - camera * k)).collect::<Vec<_>>())
    }

    /// Whether a camera's focal length is solved for.
    pub fn is_focal_free(&self, camera: usize) -> bool {
        self.free[camera * self.intrinsics] || self.free[camera * self.intrinsics + 1]
    }

    /// Gives tied parameters one value: the mean of all that are tied together.
    pub fn unite(&self, intrinsics: [&mut [f64]; 2]) {
        let k = self.intrinsics;
        let first = representatives(2 * k, &self.ties);
        let values: Vec<f64> = intrinsics.iter().flat_map(|camera| camera.iter().copied()).collect();
        for (camera, own) in intrinsics.into_iter().enumerate() {
            for (i, value) in own.iter_mut().enumerate() {
                let group = first[camera * k + i];
                let tied = first.iter().zip(&values).filter(|(f, _)| **f == group).map(|(_, v)| *v);
                let (sum, count) = tied.fold((0.0, 0.0), |(sum, count), v| (sum + v, count + 1.0));
                *value = sum / count;
            }
        }
    }
}

/// Where a camera's parameter of this name is, or all of its lens's.
fn places(option: &'static str, name: &str, own: &[&str]) -> Result<Vec<usize>> {
    if name == "lens" {
        return Ok((4..own.len()).collect());
    }
    own.iter().position(|known| *known == name).map(|at| vec![at]).ok_or_else(|| {
        let expected = format!("expected one of {}, lens", own.join(", "));
        Error::invalid(option, format!("{name:?}"), expected)
    })
}
