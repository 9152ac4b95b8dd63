use super::*;

const BROWN: Brown = Brown { k1: -0.29, k2: 0.11, p1: 1.3e-3, p2: -4e-4, k3: 0.012 };
const RATIONAL: Rational =
    Rational { brown: Brown { k1: 0.48, k2: 0.027, ..BROWN }, k4: 0.77, k5: 0.096, k6: 0.0014 };
const PRISM: ThinPrism = ThinPrism { rational: RATIONAL, s1: 2e-3, s2: -7e-4, s3: -1e-3, s4: 3e-4 };
const FISHEYE: KannalaBrandt = KannalaBrandt { k1: -0.02, k2: 0.004, k3: -0.003, k4: 2e-4 };
const LENSES: [Lens; 6] = [
    Lens::Brown(BROWN),
    Lens::Rational(RATIONAL),
    Lens::ThinPrism(PRISM),
    Lens::KannalaBrandt(FISHEYE),
    Lens::Tsai(Tsai { kappa1: 0.3 }),
    Lens::Tsai(Tsai { kappa1: -0.1 }),
];

fn ray(angle: f64, around: f64) -> Vector3<f64> {
    Vector3::new(angle.sin() * around.cos(), angle.sin() * around.sin(), angle.cos())
}

#[test]
fn directions_invert_images_throughout_the_field_of_view() {
    for lens in LENSES {
        let view = lens.view();
        let largest = view.largest_angle_rad().min(1.5);
        for step in 0..60 {
            let truth = ray(largest * 0.98 * f64::from(step) / 60.0, f64::from(step));
            // Tangential parts may fold a little before the radial one.
            let Some(at) = view.image(&truth) else {
                assert!(step > 55, "no image of step {step} of {lens:?}");
                continue;
            };
            let back = view.direction(at).expect("it has an image");
            assert!((back - truth).norm() < 1e-9, "step {step} of {lens:?}: {back:?} is not {truth:?}");
        }
    }
}

#[test]
fn there_is_no_answer_beyond_the_fold() {
    // The distorted radius never exceeds (2/3)·sqrt(1/(3·0.5)) = 0.544, reached at r = sqrt(2/3).
    let barrel = Lens::Brown(Brown { k1: -0.5, ..Brown::default() }).view();
    assert!((barrel.largest_angle_rad().tan() - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    assert_eq!(barrel.direction(Vector2::new(0.6, 0.0)), None);
    assert!(barrel.direction(Vector2::new(0.543, 0.0)).is_some());
    assert_eq!(barrel.image(&Vector3::new(0.9, 0.0, 1.0)), None);
    // A pole of the rational function: nothing beyond it, whatever the formula says.
    let pole = Lens::Rational(Rational { k4: -1.0, ..Rational::default() }).view();
    assert!((pole.largest_angle_rad().tan() - 1.0).abs() < 1e-12);
    assert_eq!(pole.image(&Vector3::new(1.1, 0.0, 1.0)), None);
    // A saturating radius: r/(1 + r²) grows to 1/2 at r = 1.
    let saturating = Lens::Rational(Rational { k4: 1.0, ..Rational::default() }).view();
    assert!((saturating.largest_angle_rad().tan() - 1.0).abs() < 1e-12);
    assert_eq!(saturating.direction(Vector2::new(0.501, 0.0)), None);
    // θ (1 - θ²/3) turns at θ = 1.
    let fisheye = Lens::KannalaBrandt(KannalaBrandt { k1: -1.0 / 3.0, ..KannalaBrandt::default() }).view();
    assert!((fisheye.largest_angle_rad() - 1.0).abs() < 1e-12);
    assert_eq!(fisheye.image(&ray(1.01, 0.3)), None);
    assert_eq!(fisheye.direction(Vector2::new(0.67, 0.0)), None);
    // Tsai: u = d (1 - d²) turns at d = 1/sqrt(3).
    let tsai = Lens::Tsai(Tsai { kappa1: -1.0 }).view();
    assert_eq!(tsai.direction(Vector2::new(0.58, 0.0)), None);
    assert_eq!(tsai.image(&Vector3::new(0.39, 0.0, 1.0)), None);
    // Behind the camera, or not a number.
    for lens in LENSES {
        assert_eq!(lens.view().image(&Vector3::new(0.0, 0.0, -1.0)), None);
        assert_eq!(lens.view().image(&Vector3::new(f64::NAN, 0.0, 1.0)), None);
        assert_eq!(lens.view().direction(Vector2::new(f64::NAN, 0.0)), None);
    }
}

#[test]
fn a_fisheye_sees_behind_its_image_plane() {
    let view = Lens::KannalaBrandt(KannalaBrandt::default()).view();
    let at = view.image(&ray(1.9, 0.7)).expect("109 degrees off the axis");
    assert!((at.norm() - 1.9).abs() < 1e-12, "equidistant");
    assert!((view.direction(at).expect("in view") - ray(1.9, 0.7)).norm() < 1e-12);
}

fn check_derivatives<const N: usize>(lens: impl LensFormula<N>) {
    let central = |ahead: Vector2<f64>, behind: Vector2<f64>, h: f64| (ahead - behind) / (2.0 * h);
    for (angle, around) in [(0.5, 0.3), (0.7, -2.2), (1e-3, 1.0), (0.0, 0.0)] {
        let ray = ray(angle, around) * 1.7;
        let image = lens.image(&ray).expect("in view");
        let h = 1e-6;
        for column in 0..3 {
            let mut step = Vector3::zeros();
            step[column] = h;
            let at = |ray: Vector3<f64>| lens.image(&ray).expect("in view").at;
            let numeric = central(at(ray + step), at(ray - step), h);
            assert!((image.by_ray.column(column) - numeric).norm() < 1e-8, "ray {column} at {angle}");
        }
        for column in 0..N {
            let at = |sign: f64| {
                let mut coefficients = lens.to_array();
                coefficients[column] += sign * h;
                lens.same(coefficients).image(&ray).expect("in view").at
            };
            let numeric = central(at(1.0), at(-1.0), h);
            let name = lens.coefficient_name(column);
            assert!((image.by_coefficient.column(column) - numeric).norm() < 1e-8, "{name} at {angle}");
        }
    }
}

/// Lets a generic test name the model's own constructors.
trait FormulaOf<const N: usize>: LensFormula<N> {
    fn same(&self, coefficients: [f64; N]) -> Self {
        Self::from_array(coefficients)
    }

    fn coefficient_name(&self, i: usize) -> &'static str {
        Self::COEFFICIENTS[i]
    }
}

impl<const N: usize, L: LensFormula<N>> FormulaOf<N> for L {}

#[test]
fn derivatives_match_central_differences() {
    check_derivatives(BROWN);
    check_derivatives(RATIONAL);
    check_derivatives(PRISM);
    check_derivatives(FISHEYE);
    check_derivatives(Tsai { kappa1: 0.3 });
    check_derivatives(Tsai { kappa1: -0.1 });
}

#[test]
fn the_models_contain_each_other() {
    let at = ray(0.6, 0.9);
    let brown = LensFormula::image(&BROWN, &at).expect("in view");
    let as_prism = ThinPrism::from(BROWN).image(&at).expect("in view");
    assert!((brown.at - as_prism.at).norm() < 1e-15);
    assert!((brown.by_ray - as_prism.by_ray).norm() < 1e-14);
    assert!((brown.by_coefficient - as_prism.by_coefficient.fixed_columns::<5>(0)).norm() < 1e-14);
}

#[test]
fn names_and_coefficients_belong_together() {
    for lens in LENSES {
        assert_eq!(Lens::of_name(lens.name()).map(|l| l.name()), Some(lens.name()));
        let coefficients = lens.coefficients();
        assert_eq!(coefficients.len(), lens.coefficient_names().len());
        assert!(coefficients.len() <= Lens::MAX_COEFFICIENTS);
        assert_eq!(lens.with_coefficients(&coefficients), Some(lens));
        assert_eq!(lens.with_coefficients(&coefficients[1..]), None);
    }
    assert_eq!(Lens::of_name("pinhole"), None);
}
