//! Lens models: from a direction to a point of the image plane one focal length away, and back.
//!
//! [`LensFormula`] is one model with its coefficients counted at compile time and analytic derivatives, for fitting;
//! [`Lens`] is any of them, as a camera carries it; [`LensView`] is a lens with the limit of its field of view worked
//! out, for projecting much.

mod fisheye;
mod perspective;
mod roots;
#[cfg(test)]
mod tests;
mod tsai;

use nalgebra::{Matrix2x3, SMatrix, Vector2, Vector3};

use crate::error::{Error, Result};

pub use fisheye::KannalaBrandt;
pub use perspective::{Brown, Rational, ThinPrism};
pub use tsai::{Tsai, distorted_radius};

/// The image of a direction, on the plane one focal length away, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LensImage<const N: usize> {
    /// Where it is.
    pub at: Vector2<f64>,
    /// By the three coordinates of the direction, which may have any length.
    pub by_ray: Matrix2x3<f64>,
    /// By the coefficients.
    pub by_coefficient: SMatrix<f64, 2, N>,
}

/// A lens model with `N` coefficients.
pub trait LensFormula<const N: usize>: Copy {
    /// What the coefficients are called, in their order.
    const COEFFICIENTS: [&'static str; N];

    /// The coefficients.
    fn to_array(&self) -> [f64; N];

    /// From the coefficients.
    fn from_array(coefficients: [f64; N]) -> Self;

    /// The image of a direction, of any length, in the camera's frame; `None` where the formula has none.
    ///
    /// The formula alone: beyond the field of view of [`LensView`] it may fold back into the picture, smoothly, as a
    /// solver's trial steps need it.
    fn image(&self, ray: &Vector3<f64>) -> Option<LensImage<N>>;
}

/// A lens of any model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// k1, k2, p1, p2, k3: OpenCV's four or five, `plumb_bob`, `radtan`.
    Brown(Brown),
    /// k1, k2, p1, p2, k3, k4, k5, k6: OpenCV's eight, `rational_polynomial`.
    Rational(Rational),
    /// The same and s1, s2, s3, s4: OpenCV's twelve.
    ThinPrism(ThinPrism),
    /// k1, k2, k3, k4 of the angle: OpenCV's fisheye, `equidistant`.
    KannalaBrandt(KannalaBrandt),
    /// kappa1: Tsai's.
    Tsai(Tsai),
}

impl Default for Lens {
    /// No distortion.
    fn default() -> Self {
        Self::Brown(Brown::default())
    }
}

impl From<Brown> for Lens {
    fn from(lens: Brown) -> Self {
        Self::Brown(lens)
    }
}

impl Lens {
    /// The names of the models, as files and Python spell them.
    pub const NAMES: [&'static str; 5] =
        ["brown-conrady", "rational", "thin-prism", "kannala-brandt", "tsai"];

    /// The largest number of coefficients a model has.
    pub const MAX_COEFFICIENTS: usize = 12;

    /// The model's name, one of [`NAMES`](Self::NAMES).
    pub fn name(&self) -> &'static str {
        match self {
            Self::Brown(_) => Self::NAMES[0],
            Self::Rational(_) => Self::NAMES[1],
            Self::ThinPrism(_) => Self::NAMES[2],
            Self::KannalaBrandt(_) => Self::NAMES[3],
            Self::Tsai(_) => Self::NAMES[4],
        }
    }

    /// A lens without distortion of the named model; `None` if there is no model of that name.
    pub fn of_name(name: &str) -> Option<Self> {
        let lenses = [
            Self::Brown(Brown::default()),
            Self::Rational(Rational::default()),
            Self::ThinPrism(ThinPrism::default()),
            Self::KannalaBrandt(KannalaBrandt::default()),
            Self::Tsai(Tsai::default()),
        ];
        lenses.into_iter().find(|lens| lens.name() == name)
    }

    /// From OpenCV's distortion coefficients: 4 or 5, 8, 12, or 14 of which the last two, a tilted sensor, are zero.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] for another number of coefficients, or a tilted sensor.
    pub fn from_opencv(coefficients: &[f64]) -> Result<Self> {
        let refused =
            |expected: &str| Err(Error::invalid("distortion", format!("{coefficients:?}"), expected));
        let (model, used) = match *coefficients {
            [k1, k2, p1, p2] => return Ok(Brown { k1, k2, p1, p2, k3: 0.0 }.into()),
            [_, _, _, _, _] => (Self::Brown(Brown::default()), coefficients),
            [_, _, _, _, _, _, _, _] => (Self::Rational(Rational::default()), coefficients),
            [.., tau_x, tau_y] if coefficients.len() == 14 && (tau_x, tau_y) != (0.0, 0.0) => {
                return refused("a tilted sensor (the last two of 14 coefficients) is not supported");
            }
            _ if [12, 14].contains(&coefficients.len()) => {
                (Self::ThinPrism(ThinPrism::default()), &coefficients[..12])
            }
            _ => return refused("expected 4, 5, 8 or 12 coefficients in OpenCV's order"),
        };
        Ok(model.with_coefficients(used).expect("counted"))
    }

    /// What the coefficients are called, in their order.
    pub fn coefficient_names(&self) -> &'static [&'static str] {
        match self {
            Self::Brown(_) => &Brown::COEFFICIENTS,
            Self::Rational(_) => &Rational::COEFFICIENTS,
            Self::ThinPrism(_) => &ThinPrism::COEFFICIENTS,
            Self::KannalaBrandt(_) => &KannalaBrandt::COEFFICIENTS,
            Self::Tsai(_) => &Tsai::COEFFICIENTS,
        }
    }

    /// The coefficients, in the order of their names.
    pub fn coefficients(&self) -> Vec<f64> {
        match self {
            Self::Brown(lens) => lens.to_array().to_vec(),
            Self::Rational(lens) => lens.to_array().to_vec(),
            Self::ThinPrism(lens) => lens.to_array().to_vec(),
            Self::KannalaBrandt(lens) => lens.to_array().to_vec(),
            Self::Tsai(lens) => lens.to_array().to_vec(),
        }
    }

    /// A lens of the same model with other coefficients; `None` unless their number is the model's.
    pub fn with_coefficients(&self, coefficients: &[f64]) -> Option<Self> {
        Some(match self {
            Self::Brown(_) => Self::Brown(Brown::from_array(coefficients.try_into().ok()?)),
            Self::Rational(_) => Self::Rational(Rational::from_array(coefficients.try_into().ok()?)),
            Self::ThinPrism(_) => Self::ThinPrism(ThinPrism::from_array(coefficients.try_into().ok()?)),
            Self::KannalaBrandt(_) => {
                Self::KannalaBrandt(KannalaBrandt::from_array(coefficients.try_into().ok()?))
            }
            Self::Tsai(_) => Self::Tsai(Tsai::from_array(coefficients.try_into().ok()?)),
        })
    }

    /// The lens with its field of view worked out.
    pub fn view(&self) -> LensView {
        LensView(match *self {
            Self::Brown(lens) => Bounded::Perspective(perspective::Bounded::new(lens)),
            Self::Rational(lens) => Bounded::Perspective(perspective::Bounded::new(lens)),
            Self::ThinPrism(lens) => Bounded::Perspective(perspective::Bounded::new(lens)),
            Self::KannalaBrandt(lens) => Bounded::Fisheye(fisheye::Bounded::new(lens)),
            Self::Tsai(lens) => Bounded::Tsai(lens),
        })
    }
}

/// A lens with the limit of its field of view: where the image's radius stops growing with the angle from the axis,
/// the formula leads back into the picture, and there is no answer beyond.
#[derive(Debug, Clone, Copy)]
pub struct LensView(Bounded);

#[derive(Debug, Clone, Copy)]
enum Bounded {
    Perspective(perspective::Bounded),
    Fisheye(fisheye::Bounded),
    Tsai(Tsai),
}

impl LensView {
    /// The largest angle from the axis that has an image, radians: at most π/2, for a fisheye π.
    pub fn largest_angle_rad(&self) -> f64 {
        match &self.0 {
            Bounded::Perspective(lens) => lens.largest_angle(),
            Bounded::Fisheye(lens) => lens.largest_angle(),
            Bounded::Tsai(lens) => lens.largest_angle(),
        }
    }

    /// Where a direction, of any length, is imaged; `None` outside the field of view.
    pub fn image(&self, ray: &Vector3<f64>) -> Option<Vector2<f64>> {
        match &self.0 {
            Bounded::Perspective(lens) => lens.image(ray),
            Bounded::Fisheye(lens) => lens.image(ray),
            Bounded::Tsai(lens) if ray.z > 0.0 => lens.apply(ray.xy() / ray.z),
            Bounded::Tsai(_) => None,
        }
    }

    /// The direction, of length one, that is imaged at a point; `None` if there is none inside the field of view.
    pub fn direction(&self, at: Vector2<f64>) -> Option<Vector3<f64>> {
        match &self.0 {
            Bounded::Perspective(lens) => lens.ideal(at).map(|ideal| ideal.push(1.0).normalize()),
            Bounded::Fisheye(lens) => lens.direction(at),
            Bounded::Tsai(lens) => lens.ideal(at).map(|ideal| ideal.push(1.0).normalize()),
        }
    }
}
