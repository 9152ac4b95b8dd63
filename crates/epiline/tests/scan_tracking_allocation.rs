//! A warm scanner and a warm tracker allocate nothing.

mod allocations;

use allocations::allocations;
use epiline::image::Image;
use epiline::matching::DisparityMap;
use epiline::rectification::RectifiedGeometry;
use epiline::scan::{RobotFromCamera, Scan, ScanParams, Scanner};
use epiline::tracking::{Detection, TrackParams, Tracker};

#[test]
fn a_warm_scanner_allocates_nothing() {
    let geometry = RectifiedGeometry::new(160, 120, 150.0, 80.0, 60.0, 0.0, 0.12).expect("a rig");
    let tilted = RobotFromCamera::from_angles([0.0, 0.0, 0.5], 0.05, 0.2, 0.0).expect("a pose");
    let values = Image::from_fn(160, 120, |x, y| 16 * (5 + (x / 40 + y / 30) as u16));
    let map = DisparityMap::from_parts(values, Image::new(160, 120), 0, 64).expect("sizes agree");
    let (mut scanner, mut scan, params) = (Scanner::default(), Scan::default(), ScanParams::default());
    for mounting in [None, Some(&tilted)] {
        let mut work = || {
            scanner.scan(&map, &geometry, None, mounting, &params, &mut scan).expect("sizes agree");
        };
        work();
        assert_eq!(allocations(work), 0);
        assert!(scan.nearest_m.iter().any(|range_m| range_m.is_finite()), "the test must see something");
    }
}

#[test]
fn a_warm_tracker_allocates_nothing() {
    let mut tracker = Tracker::new(TrackParams::default()).expect("legal");
    let mut tracks = Vec::new();
    let seen = |frame: i64| {
        // Twelve things that walk, one of them in and out of sight, and a stray elsewhere in every frame.
        let things = (0..12).filter(move |i| i % 12 != 5 || frame % 3 > 0).map(move |i| {
            let bearing_rad = -0.6 + 0.1 * f64::from(i);
            Detection::level(6.0 + 0.02 * frame as f64 + f64::from(i), bearing_rad, 0.05)
        });
        things.chain([Detection::level(30.0 + 5.0 * (frame % 4) as f64, 0.65, 0.05)])
    };
    let mut update = |frame: i64| {
        tracker.update(seen(frame), frame * 100_000_000, None, &mut tracks).expect("legal");
    };
    (0..20).for_each(&mut update);
    assert_eq!(allocations(|| (20..40).for_each(update)), 0);
    assert!(tracks.iter().filter(|track| track.confirmed).count() >= 11);
}
