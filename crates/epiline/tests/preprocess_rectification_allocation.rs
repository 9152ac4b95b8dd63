//! A warm stage allocates nothing.

mod allocations;

use allocations::allocations;
use epiline::camera::{Brown, CameraModel, Pose, StereoCalibration};
use epiline::image::Image;
use epiline::preprocess::{GaussianLowPass, equalize_histogram};
use epiline::rectification::{AlignmentMeter, AlignmentOptions, Rectifier};
use nalgebra::{Matrix3, Vector3};

#[test]
fn warm_stages_allocate_nothing() {
    let camera = CameraModel {
        focal_px: [200.0, 200.0],
        center_px: [130.0, 97.0],
        lens: Brown { k1: -0.2, ..Brown::default() }.into(),
        width: 260,
        height: 195,
    };
    let pose = Pose { rotation: Matrix3::identity(), translation_m: Vector3::new(-0.1, 0.001, 0.0) };
    let calibration = StereoCalibration::new(camera, camera, pose).expect("an ordinary rig");
    let rectifier = Rectifier::new(&calibration).expect("an ordinary rig");
    let mut meter = AlignmentMeter::new(AlignmentOptions::default()).expect("legal");
    let mut low_pass = GaussianLowPass::new(260, 195, 20.0).expect("legal");

    let texture = |shift: usize| {
        Image::from_fn(260, 195, move |x, y| (((x + shift) / 5 * 7919 + y / 5 * 104_729) % 251) as u8)
    };
    let (left, right) = (texture(0), texture(9));
    let values = Image::from_fn(260, 195, |x, y| (x * y % 97) as f32);
    let [mut equalized, mut aligned_left, mut aligned_right] = [(); 3].map(|()| Image::default());
    let mut filtered = Image::default();

    let mut process = || {
        equalize_histogram(left.view(), &mut equalized);
        rectifier.rectify_left(equalized.view(), &mut aligned_left).expect("sizes agree");
        rectifier.rectify_right(right.view(), &mut aligned_right).expect("sizes agree");
        low_pass.apply(values.view(), &mut filtered).expect("sizes agree");
        let valid = [rectifier.left_valid(), rectifier.right_valid()];
        let result = meter
            .measure(aligned_left.view(), aligned_right.view(), Some(valid[0]), Some(valid[1]))
            .expect("sizes agree");
        assert!(result.matches.len() >= 15, "the test must exercise matching: {}", result.matches.len());
    };
    assert!(allocations(&mut process) > 0, "the counter must count");
    assert_eq!(allocations(process), 0);
}
