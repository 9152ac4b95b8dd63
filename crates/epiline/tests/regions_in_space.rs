//! Regions in metres and in shares, against points thrown into space and projected.

use std::f64::consts::FRAC_PI_2;

use epiline::matching::{DisparityMap, Validity};
use epiline::rectification::RectifiedGeometry;
use epiline::regions::{CameraOverGround, ProfileParams, Region, Search, Slab, profile};
use nalgebra::{Rotation3, Vector3};

/// A reproducible stream of numbers, evenly spread.
struct Random(f64);

impl Random {
    fn within(&mut self, low: f64, high: f64) -> f64 {
        self.0 = (self.0 * 997.0 + 0.123_456_7).fract();
        low + self.0 * (high - low)
    }
}

const WIDTH: usize = 40;
const HEIGHT: usize = 30;

fn geometry() -> RectifiedGeometry {
    RectifiedGeometry::new(WIDTH, HEIGHT, 32.0, 18.7, 15.4, 0.0, 0.3).expect("a rig")
}

/// Height above the ground and distance to the right of a point of the optical frame, by REP 103's rotations.
fn height_and_lateral_m(camera: &CameraOverGround, point: &Vector3<f64>) -> (f64, f64) {
    let body = Vector3::new(point.z, -point.x, -point.y);
    let pitch = Rotation3::from_axis_angle(&Vector3::y_axis(), camera.pitch_rad);
    let roll = Rotation3::from_axis_angle(&Vector3::x_axis(), camera.roll_rad);
    let world = pitch * roll * body;
    (camera.height_m + world.z, -world.y)
}

/// By how much a point lies inside the slab, metres; negative outside.
fn margin_m(slab: &Slab, camera: &CameraOverGround, point: &Vector3<f64>) -> f64 {
    let (height_m, lateral_m) = height_and_lateral_m(camera, point);
    let within = |value: f64, (low, high): (f64, f64)| (value - low).min(high - value);
    within(height_m, slab.height_m)
        .min(within(lateral_m, slab.lateral_m))
        .min(within(point.norm(), slab.range_m))
}

fn cases() -> Vec<(Slab, CameraOverGround)> {
    let mut random = Random(0.12);
    let mut cases = vec![
        (Slab::new((0.1, 1.8), (0.5, 5.0)), CameraOverGround::level(0.6)),
        // A layer so thin that it falls between the centres of rows.
        (Slab::new((0.01, 0.02), (3.0, 4.0)), CameraOverGround::level(0.6)),
        (Slab::new((f64::NEG_INFINITY, 0.3), (1.0, f64::INFINITY)), CameraOverGround::level(1.2)),
    ];
    for _ in 0..12 {
        let camera = CameraOverGround {
            height_m: random.within(0.3, 2.0),
            pitch_rad: random.within(-0.3, 0.5),
            roll_rad: random.within(-0.4, 0.4),
        };
        let (low_m, near_m, left_m) =
            (random.within(-0.3, 1.0), random.within(0.4, 3.0), random.within(-1.5, 0.6));
        cases.push((
            Slab {
                height_m: (low_m, low_m + random.within(0.05, 1.5)),
                range_m: (near_m, near_m + random.within(0.3, 6.0)),
                lateral_m: (left_m, left_m + random.within(0.2, 2.0)),
            },
            camera,
        ));
    }
    cases
}

#[test]
fn a_slab_is_held_whole_and_hardly_more() {
    const PER_PIXEL: usize = 5;
    let geometry = geometry();
    let mut seen = 0;
    for (slab, camera) in cases() {
        let context = format!("{slab:?} from {camera:?}");
        // Columns, rows and disparities of a cloud of points of the slab.
        let mut found = [(f64::INFINITY, f64::NEG_INFINITY); 3];
        for i in 0..WIDTH * HEIGHT * PER_PIXEL * PER_PIXEL {
            let across = WIDTH * PER_PIXEL;
            let at = |k: usize| ((k as f64 + 0.5) / PER_PIXEL as f64) - 0.5;
            let (x, y) = (at(i % across), at(i / across));
            let ray = Vector3::new((x - geometry.cx_px) / 32.0, (y - geometry.cy_px) / 32.0, 1.0);
            for step in 0..160 {
                let range_m = slab.range_m.0
                    * (slab.range_m.1.min(60.0) / slab.range_m.0).powf(f64::from(step) / 159.0);
                let point = ray * (range_m / ray.norm());
                if margin_m(&slab, &camera, &point) >= 0.0 {
                    for (found, value) in found.iter_mut().zip([x.round(), y.round(), 32.0 * 0.3 / point.z]) {
                        *found = (found.0.min(value), found.1.max(value));
                    }
                }
            }
        }
        let region = match Region::in_space("slab", slab, camera, &geometry) {
            Ok(region) => region,
            Err(error) => {
                assert!(found[0].0.is_infinite(), "{context}: {error}");
                assert!(error.to_string().contains("'slab'"), "{error}");
                continue;
            }
        };
        region.validate(WIDTH, HEIGHT).expect("inside the image");
        let Some(Search::Disparities { first, count }) = region.search else {
            panic!("{context}: no disparities")
        };
        if found[0].0.is_infinite() {
            // What the cloud of points misses altogether is next to nothing.
            assert!(region.width.min(region.height) <= 2, "{context}: {region:?}");
            continue;
        }
        seen += 1;
        let edges = [
            (region.x as f64, (region.x + region.width - 1) as f64),
            (region.y as f64, (region.y + region.height - 1) as f64),
        ];
        for ((low, high), found) in edges.into_iter().zip(found) {
            assert!(low <= found.0 && high >= found.1, "{context}: {low} to {high}, found {found:?}");
            assert!(
                found.0 - low <= 1.0 && high - found.1 <= 1.0,
                "{context}: {low} to {high}, found {found:?}"
            );
        }
        let (first, last) = (first as f64, (first + count - 1) as f64);
        assert!(first <= found[2].0 && last >= found[2].1, "{context}: {first} to {last} px, {:?}", found[2]);
        // One pixel beyond, and rounding to whole ones.
        assert!(
            found[2].0 - first <= 2.5 && last - found[2].1 <= 2.5,
            "{context}: {first} to {last}, {:?}",
            found[2]
        );
    }
    assert!(seen >= 8, "only {seen} slabs in view");
}

#[test]
fn a_profile_reads_what_lies_in_the_slab() {
    let geometry = geometry();
    let mut random = Random(0.77);
    let mut map = DisparityMap::new(WIDTH, HEIGHT);
    (map.min_disparity, map.num_disparities) = (0, 30);
    for (raw, bits) in map.values.as_mut_slice().iter_mut().zip(map.validity.as_mut_slice()) {
        *raw = random.within(8.0, 400.0) as u16;
        *bits = if random.within(0.0, 1.0) < 0.2 { Validity::LOW_TEXTURE } else { 0 };
    }
    let mut counted = 0;
    for (slab, camera) in cases() {
        let Ok(region) = Region::in_space("slab", slab, camera, &geometry) else { continue };
        let read = profile(&map, std::slice::from_ref(&region), Some(&geometry), &ProfileParams::default());
        let read = &read.expect("inside")[0];
        for column in 0..region.width {
            let x = region.x + column;
            let (mut surely, mut perhaps, mut unknown) = (0, 0, 0);
            for y in region.y..region.y + region.height {
                let Some(disparity_px) = map.at(x, y) else {
                    unknown += 1;
                    continue;
                };
                // Half a step of disparity to either side.
                let inside = [-0.5, 0.0, 0.5].map(|steps| {
                    let disparity_px = f64::from(disparity_px) + steps / 16.0;
                    let point = geometry.point_m(x as f64, y as f64, disparity_px).expect("in front");
                    margin_m(&slab, &camera, &point) >= 0.0
                });
                surely += u32::from(inside[1]);
                perhaps += u32::from(inside.contains(&true));
            }
            let got = read.count[column];
            assert!((surely..=perhaps).contains(&got), "column {x}: {got}, {surely} to {perhaps}");
            assert_eq!(read.unknown[column], unknown);
            counted += got;
        }
    }
    assert!(counted > 500, "only {counted} pixels in all slabs");
    let (slab, camera) = cases()[0];
    let region = Region::in_space("slab", slab, camera, &geometry).expect("in view");
    let error = profile(&map, &[region], None, &ProfileParams::default()).expect_err("no geometry");
    assert!(error.to_string().contains("'slab'") && error.to_string().contains("geometry"), "{error}");
}

#[test]
fn slabs_and_cameras_that_cannot_be_are_named() {
    let slab = Slab::new((0.1, 1.0), (1.0, 4.0));
    let camera = CameraOverGround::level(0.6);
    let refuse = |slab, camera, expected: &str| {
        let error = Region::in_space("front", slab, camera, &geometry()).expect_err(expected).to_string();
        assert!(error.contains(expected) && error.contains("'front'"), "{error}");
    };
    refuse(Slab { height_m: (1.0, 0.1), ..slab }, camera, "height_m = (1, 0.1) m");
    refuse(Slab { range_m: (0.0, 4.0), ..slab }, camera, "range_m = (0, 4) m");
    refuse(Slab { range_m: (1.0, f64::NAN), ..slab }, camera, "range_m = (1, NaN) m");
    refuse(Slab { lateral_m: (0.5, 0.5), ..slab }, camera, "lateral_m = (0.5, 0.5) m");
    refuse(slab, CameraOverGround::level(0.0), "camera height_m = 0 m");
    refuse(slab, CameraOverGround { pitch_rad: FRAC_PI_2, ..camera }, "camera pitch_rad = 1.57");
    refuse(slab, CameraOverGround { roll_rad: f64::NAN, ..camera }, "camera roll_rad = NaN rad");
    refuse(Slab { height_m: (90.0, 91.0), ..slab }, camera, "no pixel sees it");
    refuse(Slab { lateral_m: (50.0, 60.0), ..slab }, camera, "no pixel sees it");
}

#[test]
fn shares_that_meet_meet_in_pixels() {
    for (width, height) in [(320, 240), (641, 479), (7, 5)] {
        let mut end = 0;
        for i in 0..5 {
            let band = Region::from_shares("band", [0.0, f64::from(i) * 0.2, 1.0, 0.2], width, height)
                .expect("inside");
            assert_eq!((band.x, band.width, band.y), (0, width, end));
            end += band.height;
        }
        assert_eq!(end, height);
    }
    for shares in
        [[-0.1, 0.0, 0.5, 0.5], [0.0, 0.6, 0.5, 0.5], [0.0, 0.0, 0.0, 0.5], [0.0, f64::NAN, 0.5, 0.5]]
    {
        let error = Region::from_shares("part", shares, 320, 240).expect_err("no part").to_string();
        assert!(error.contains("'part'"), "{error}");
    }
    let error =
        Region::from_shares("sliver", [0.5, 0.0, 0.001, 1.0], 320, 240).expect_err("no pixel").to_string();
    assert!(error.contains("'sliver', 0x240 px"), "{error}");
}
