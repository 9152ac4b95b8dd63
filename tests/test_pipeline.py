"""The pipeline from Python: its results are those of the steps, and stay what they were."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep

Image = NDArray[np.uint8]
MATCHER = {"num_disparities": 48, "block_size": 9, "uniqueness_ratio": 10, "left_right_max_diff": 1}


@pytest.fixture
def geometry() -> ep.RectifiedGeometry:
    return ep.RectifiedGeometry(width=320, height=240, focal_px=300, cx_px=159.5, cy_px=119.5, baseline_m=0.12)


def pair(seed: int) -> tuple[Image, Image]:
    """A textured wall at 6 m and, before it, a board at 2 m."""
    rng = np.random.default_rng(seed)
    wall = rng.integers(0, 256, (240, 330), dtype=np.uint8)
    board = rng.integers(0, 256, (120, 80), dtype=np.uint8)
    left, right = wall[:, :320].copy(), wall[:, 6:326].copy()
    left[60:180, 120:200] = board
    right[60:180, 120 - 18 : 200 - 18] = board
    return left, right


def test_a_frame_is_what_its_steps_give(geometry: ep.RectifiedGeometry) -> None:
    left, right = pair(1)
    matcher = ep.StereoMatcher(**MATCHER)
    regions = [ep.Region("middle", x=0, y=90, width=320, height=60)]
    pipeline = ep.Pipeline(geometry, matcher=matcher, regions=regions, max_range_m=4, disparity_sigma_px=0.3)
    result = pipeline.process(left, right)
    disparity = matcher(left, right)
    np.testing.assert_array_equal(result.disparity.values, disparity.values)
    np.testing.assert_array_equal(
        result.range.sigma_m, ep.to_range(disparity, geometry, disparity_sigma_px=0.3).sigma_m
    )
    expected = ep.profile(disparity, regions, geometry=geometry, disparity_sigma_px=0.3)[0]
    assert result.profiles[0].range_m == expected.range_m == pytest.approx(2, rel=0.02)
    np.testing.assert_array_equal(result.profiles[0].nearest_px, expected.nearest_px)
    obstacles = ep.find_obstacles(disparity, geometry, regions=regions, max_range_m=4, disparity_sigma_px=0.3)
    assert result.obstacles == obstacles
    assert [o.depth_m for o in obstacles] == [pytest.approx(2, rel=0.02)]
    np.testing.assert_array_equal(result.pair.left, left)
    np.testing.assert_array_equal(result.pair.right, right)
    assert result.pair.left_valid.all()
    assert result.alignment is not None
    assert result.alignment.median_px < 0.1
    stages = result.stage_ms
    before = ["equalize", "rectify", "match", "range", "regions"]
    assert list(stages) == [*before, "ground", "obstacles", "tracks", "scan", "alignment", "total"]
    assert stages["total"] >= stages["match"] > 0
    assert pipeline.regions == regions
    assert pipeline.matcher_parameters == matcher.parameters


def test_results_outlive_the_frames_after_them(geometry: ep.RectifiedGeometry) -> None:
    pipeline = ep.Pipeline(geometry, matcher=ep.StereoMatcher(**MATCHER))
    results = [pipeline.process(*pair(seed)) for seed in range(6)]
    ranges = results[0].range
    first = ranges.depth_m.copy()
    del results[0]
    results.extend(pipeline.process(*pair(seed)) for seed in range(6, 9))
    np.testing.assert_array_equal(ranges.depth_m, first)
    for seed, result in enumerate(results, start=1):
        fresh = ep.Pipeline(geometry, matcher=ep.StereoMatcher(**MATCHER)).process(*pair(seed))
        np.testing.assert_array_equal(result.disparity.raw, fresh.disparity.raw)
        np.testing.assert_array_equal(result.pair.left, pair(seed)[0])


def test_raw_pairs_are_rectified_as_the_rectifier_does() -> None:
    camera = ep.CameraModel([[300, 0, 160], [0, 300, 120], [0, 0, 1]], [-0.1, 0.02, 0, 0, 0], width=320, height=240)
    angle = 0.05
    rotation = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    rig = ep.StereoCalibration(camera, camera, rotation, [-0.12, 0.001, 0.0])
    left, right = pair(3)
    pipeline = ep.Pipeline(rig, equalize=True, alignment=False)
    result = pipeline.process(left, right)
    aligned = ep.Rectifier(rig)(ep.equalize(left), ep.equalize(right))
    for name in ("left", "right", "left_valid", "right_valid"):
        np.testing.assert_array_equal(getattr(result.pair, name), getattr(aligned, name))
    assert not result.pair.left_valid.all() or not result.pair.right_valid.all()
    assert result.alignment is None
    assert [r.name for r in pipeline.regions] == ["band_20", "band_30", "band_40", "band_50"]
    assert pipeline.geometry.baseline_m == pytest.approx(rig.baseline_m)


def test_colour_is_taken(geometry: ep.RectifiedGeometry) -> None:
    left, right = pair(1)
    pipeline = ep.Pipeline(geometry, matcher=ep.StereoMatcher(**MATCHER))
    colour = [np.repeat(image[:, :, None], 3, axis=2) for image in (left, right)]
    np.testing.assert_array_equal(pipeline.process(*colour).disparity.raw, pipeline.process(left, right).disparity.raw)


def test_bad_input_is_one_clear_error(geometry: ep.RectifiedGeometry) -> None:
    left, right = pair(1)
    pipeline = ep.Pipeline(geometry)
    with pytest.raises(ValueError, match=r"320x240.*320x239"):
        pipeline.process(left, right[1:])
    with pytest.raises(ValueError, match=r"318x240.*320x240"):
        pipeline.process(left[:, 2:], right[:, 2:])
    with pytest.raises(ValueError, match="uint8"):
        pipeline.process(left.astype(np.float32), right)
    with pytest.raises(ValueError, match="'out'"):
        ep.Pipeline(geometry, regions=[ep.Region("out", x=0, y=0, width=321, height=1)])
    with pytest.raises(ValueError, match="min_support = 0 px"):
        ep.Pipeline(geometry, min_support=0)
    with pytest.raises(TypeError, match="StereoCalibration"):
        ep.Pipeline("rig.yaml")  # type: ignore[arg-type]
    pipeline.process(left, right)


def test_a_floor_seen_too_steeply_to_scan_does_not_end_a_run() -> None:
    """The lowest rows look straight down: directions over the floor would meet in them."""
    pitch_rad, height_m = 0.9, 0.5
    geometry = ep.RectifiedGeometry(width=320, height=240, focal_px=150, cx_px=159.5, cy_px=119.5, baseline_m=0.12)
    y = (np.arange(240) - geometry.cy_px) / geometry.focal_px
    disparity_px = geometry.focal_px * geometry.baseline_m * (np.cos(pitch_rad) * y + np.sin(pitch_rad)) / height_m
    left = np.random.default_rng(4).integers(0, 256, (240, 400)).astype(float)
    columns = np.arange(320)
    right = [
        np.interp(columns + shift_px, np.arange(400), row) for row, shift_px in zip(left, disparity_px, strict=True)
    ]
    pipeline = ep.Pipeline(geometry, matcher=ep.StereoMatcher(num_disparities=64, block_size=9), scanner=ep.Scanner())
    result = pipeline.process(left[:, :320].astype(np.uint8), np.round(right).astype(np.uint8))
    assert result.ground is not None
    assert result.ground.pitch_rad == pytest.approx(pitch_rad, abs=0.02)
    assert result.ground.camera.height_m == result.ground.camera_height_m == pytest.approx(height_m, rel=0.05)
    with pytest.raises(ep.Error, match="too steeply"):
        ep.scan(result.disparity, geometry, ground=result.ground)
    expected = ep.scan(result.disparity, geometry)
    np.testing.assert_array_equal(result.scan.nearest_m, expected.nearest_m)
