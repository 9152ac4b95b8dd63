//! The normal equations against numbers that do not come from them.

use nalgebra::{Rotation3, Vector3};

use super::super::lens::PixelCamera;
use super::equations::scaled_cholesky_solve;
use super::*;
use crate::camera::Brown;

const K: usize = 9;
const SHARED: usize = 2 * K + Freedom::POSE_AND_WARP;

type BrownCamera = PixelCamera<Brown, 5>;

fn board() -> Vec<[f64; 3]> {
    (0..12).map(|i| [f64::from(i % 4) * 0.04, f64::from(i / 4) * 0.04, 0.0]).collect()
}

fn estimate() -> Estimate<K> {
    let pose = |angles: [f64; 3], translation: [f64; 3]| Pose {
        rotation: Rotation3::from_scaled_axis(Vector3::from(angles)).into_inner(),
        translation_m: Vector3::from(translation),
    };
    Estimate {
        intrinsics: [
            SVector::from([510.0, 515.0, 322.0, 241.0, -0.25, 0.08, 1e-3, -5e-4, 0.01]),
            SVector::from([525.0, 520.0, 315.0, 236.0, -0.22, 0.06, -4e-4, 7e-4, 0.0]),
        ],
        right_from_left: pose([0.01, -0.03, 0.02], [-0.12, 0.003, -0.004]),
        left_from_board: vec![
            pose([0.3, -0.2, 0.1], [-0.05, -0.04, 0.5]),
            pose([-0.4, 0.3, -0.2], [-0.1, 0.02, 0.6]),
            pose([0.1, 0.5, 0.4], [0.03, -0.08, 0.45]),
        ],
        board_warp_m: Vector2::new(0.002, -0.001),
    }
}

/// Pixels that the estimate does not explain: predictions moved by up to a few pixels.
fn pixels(lens: &BrownCamera, board: &[[f64; 3]], camera: usize, view: usize) -> Vec<[f64; 2]> {
    let estimate = estimate();
    let pose = estimate.camera_from_board(camera, view);
    let see = |(i, p): (usize, &[f64; 3])| {
        let predicted = lens.project(&estimate.intrinsics[camera], &pose.apply(Vector3::from(*p)));
        let offset = Vector2::new((i as f64 * 1.7).sin() * 3.0, (i as f64 * 2.3).cos() * 2.0);
        (predicted.expect("in view").pixel + offset).into()
    };
    board.iter().enumerate().map(see).collect()
}

#[test]
fn gradient_matches_central_differences_of_the_cost() {
    let (lens, board, loss) = (BrownCamera::NEW, board(), Huber { threshold_px: 2.0 });
    let mut seen: Vec<_> = (0..3).map(|v| [0, 1].map(|c| pixels(&lens, &board, c, v))).collect();
    seen[0][1][4] = [f64::NAN; 2];
    let mut views: Vec<_> =
        seen.iter().map(|[l, r]| View { board_m: &board, pixels: [l.as_slice(), r] }).collect();
    // One view that only the left camera saw, one that only the right camera saw.
    views[1].pixels[1] = &[];
    views[2].pixels[0] = &[];
    // One focal length for both axes of the left camera, one k1 for both cameras.
    let freedom = Freedom::new(&[true; SHARED], &[(0, 1), (4, K + 4)]);
    let bundle = Bundle::new(&lens, &views, &freedom);
    let at = estimate();
    let system = bundle.assemble(&at, loss).expect("all in view");
    let zero = || Step {
        shared: DVector::zeros(freedom.count),
        poses: vec![Vector6::zeros(); 3],
        predicted_reduction: 0.0,
    };
    let cost = |step: &Step| bundle.assemble(&bundle.moved(&at, step), loss).expect("all in view").cost;
    let check = |name: String, analytic: f64, h: f64, set: &dyn Fn(&mut Step, f64)| {
        let (mut ahead, mut behind) = (zero(), zero());
        set(&mut ahead, h);
        set(&mut behind, -h);
        let numeric = (cost(&ahead) - cost(&behind)) / (2.0 * h);
        assert!((analytic - numeric).abs() < 1e-4 * (1.0 + numeric.abs()), "{name}: {analytic} {numeric}");
    };
    assert_eq!(freedom.count, SHARED - 2);
    for (i, slot) in freedom.slots.iter().enumerate() {
        let slot = slot.expect("everything is free");
        let h = if i < 2 * K && i % K < 4 { 1e-4 } else { 1e-7 };
        check(format!("shared {i}"), system.gradient[slot], h, &|step, h| step.shared[slot] = h);
    }
    for (v, block) in system.blocks.iter().enumerate() {
        for i in 0..6 {
            check(format!("pose {v} {i}"), block.gradient[i], 1e-7, &|step, h| step.poses[v][i] = h);
        }
    }
}

#[test]
fn normal_equations_are_the_slopes_of_the_gradient_where_nothing_is_left() {
    // Without residuals Gauss and Newton's matrix is the second derivative of the cost.
    let (lens, board, at) = (BrownCamera::NEW, board(), estimate());
    let shape = BoardShape::of(board.iter());
    let predicted = |camera, view| -> Vec<[f64; 2]> {
        let pose = at.camera_from_board(camera, view);
        let see = |p: &[f64; 3]| {
            let lifted = shape.lifted(p, &at.board_warp_m);
            lens.project(&at.intrinsics[camera], &pose.apply(lifted)).expect("in view").pixel.into()
        };
        board.iter().map(see).collect()
    };
    let seen: Vec<_> = (0..3).map(|v| [0, 1].map(|c| predicted(c, v))).collect();
    let views: Vec<_> =
        seen.iter().map(|[l, r]| View { board_m: &board, pixels: [l.as_slice(), r] }).collect();
    let freedom = Freedom::new(&[true; SHARED], &[(0, 1), (4, K + 4)]);
    let bundle = Bundle::new(&lens, &views, &freedom);
    let system = bundle.assemble(&at, Huber::SQUARED).expect("all in view");
    for (i, slot) in freedom.slots.iter().enumerate() {
        let slot = slot.expect("everything is free");
        let h = if i < 2 * K && i % K < 4 { 1e-4 } else { 1e-7 };
        let moved = |amount: f64| {
            let mut step = Step {
                shared: DVector::zeros(freedom.count),
                poses: vec![Vector6::zeros(); 3],
                predicted_reduction: 0.0,
            };
            step.shared[slot] = amount;
            bundle.assemble(&bundle.moved(&at, &step), Huber::SQUARED).expect("all in view")
        };
        let (ahead, behind) = (moved(h), moved(-h));
        let close = |analytic: f64, numeric: f64, other: f64, what: String| {
            // A covariance may be next to nothing beside the two variances.
            let scale = (system.shared[(slot, slot)] * other).sqrt();
            assert!((analytic - numeric).abs() < 1e-4 * scale, "{what}: {analytic} {numeric}");
        };
        for row in 0..freedom.count {
            let numeric = (ahead.gradient[row] - behind.gradient[row]) / (2.0 * h);
            let other = system.shared[(row, row)];
            close(system.shared[(row, slot)], numeric, other, format!("shared {row} by {i}"));
        }
        for (v, block) in system.blocks.iter().enumerate() {
            for k in 0..6 {
                let numeric = (ahead.blocks[v].gradient[k] - behind.blocks[v].gradient[k]) / (2.0 * h);
                close(block.coupling[(k, slot)], numeric, block.pose[(k, k)], format!("pose {v} {k} by {i}"));
            }
        }
    }
}

#[test]
fn elimination_solves_the_whole_system() {
    let (lens, board) = (BrownCamera::NEW, board());
    let seen: Vec<_> = (0..3).map(|v| [0, 1].map(|c| pixels(&lens, &board, c, v))).collect();
    let views: Vec<_> =
        seen.iter().map(|[l, r]| View { board_m: &board, pixels: [l.as_slice(), r] }).collect();
    // One coefficient of each camera held fixed.
    let mut free = [true; SHARED];
    (free[8], free[17]) = (false, false);
    let freedom = Freedom::new(&free, &[]);
    let bundle = Bundle::new(&lens, &views, &freedom);
    let system = bundle.assemble(&estimate(), Huber::SQUARED).expect("all in view");
    let (shared, damping) = (freedom.count, 1e-2);
    let size = shared + 18;
    let (mut whole, mut gradient) = (DMatrix::zeros(size, size), DVector::zeros(size));
    whole.view_mut((0, 0), (shared, shared)).copy_from(&system.shared);
    gradient.rows_mut(0, shared).copy_from(&system.gradient);
    for (v, block) in system.blocks.iter().enumerate() {
        let at = shared + 6 * v;
        whole.view_mut((at, at), (6, 6)).copy_from(&block.pose);
        whole.view_mut((at, 0), (6, shared)).copy_from(&block.coupling);
        whole.view_mut((0, at), (shared, 6)).copy_from(&block.coupling.transpose());
        gradient.rows_mut(at, 6).copy_from(&block.gradient);
    }
    for i in 0..size {
        whole[(i, i)] *= 1.0 + damping;
    }
    let expected = -scaled_cholesky_solve(&whole, &gradient).expect("positive definite");
    let step = system.solve(damping).expect("positive definite");
    for i in 0..shared {
        assert!((step.shared[i] - expected[i]).abs() < 1e-6 * (1e-6 + expected[i].abs()), "shared {i}");
    }
    for v in 0..3 {
        for i in 0..6 {
            let expected = expected[shared + 6 * v + i];
            assert!((step.poses[v][i] - expected).abs() < 1e-6 * (1e-6 + expected.abs()), "pose {v} {i}");
        }
    }
}
