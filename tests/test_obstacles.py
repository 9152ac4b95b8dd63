"""Obstacles from Python: the core's own tests hold them to known worlds, these to the interface."""

from __future__ import annotations

import numpy as np
import pytest

import epiline as ep


@pytest.fixture
def geometry() -> ep.RectifiedGeometry:
    return ep.RectifiedGeometry(width=320, height=240, focal_px=300, cx_px=159.5, cy_px=119.5, baseline_m=0.12)


@pytest.fixture
def disparity(geometry: ep.RectifiedGeometry) -> ep.DisparityMap:
    """A level floor 0.5 m below, a wall at 9 m, a box 0.6 m wide at 3 m and a pole of 6 cm at 1.5 m."""
    x, y = np.meshgrid((np.arange(320) - 159.5) / 300, (np.arange(240) - 119.5) / 300)
    with np.errstate(divide="ignore"):
        depth_m = np.minimum(np.where(y > 0, 0.5 / y, np.inf), 9.0)
    for z, left, right, top in ((3.0, -0.9, -0.3, -0.2), (1.5, 0.2, 0.26, -0.7)):
        board = (x * z >= left) & (x * z < right) & (y * z >= top) & (y * z <= 0.5)
        depth_m = np.where(board, np.minimum(depth_m, z), depth_m)
    raw = np.round(16 * geometry.focal_px * geometry.baseline_m / depth_m)
    return ep.DisparityMap(raw.clip(0, 1023).astype(np.uint16), np.zeros((240, 320), np.uint8))


def test_box_and_pole_but_neither_floor_nor_far_wall(
    disparity: ep.DisparityMap, geometry: ep.RectifiedGeometry
) -> None:
    pole, box = ep.find_obstacles(disparity, geometry, max_range_m=8)
    assert [pole.id, box.id] == [0, 1]
    assert pole.region == box.region == "image"
    assert pole.depth_m == pytest.approx(1.5, rel=0.01)
    assert box.depth_m == pytest.approx(3.0, rel=0.01)
    assert pole.bearing_rad == pytest.approx(np.arctan(0.23 / 1.5), abs=0.005)
    assert box.bearing_rad == pytest.approx(np.arctan(-0.6 / 3), abs=0.005)
    assert pole.width_m == pytest.approx(0.06, abs=0.01)
    assert box.width_m == pytest.approx(0.6, abs=0.03)
    assert box.height_m == pytest.approx(0.7, abs=0.05)
    assert box.range_m == pytest.approx(np.hypot(3.0, 0.6), rel=0.01)
    assert box.sigma_m == pytest.approx(box.range_m * box.depth_m * 0.25 / 36, rel=1e-6)
    x, y, width, height = box.box
    assert abs(x - 69.5) <= 2
    assert abs(width - 60) <= 3
    assert abs(y - 99.5) <= 3
    assert abs(height - 70) <= 5
    assert box.support > 0.9 * 60 * 70


def test_regions_are_looked_at_one_by_one(disparity: ep.DisparityMap, geometry: ep.RectifiedGeometry) -> None:
    left = ep.Region("left", x=0, y=60, width=150, height=80)
    both = ep.Region("both", x=0, y=60, width=320, height=80)
    found = ep.find_obstacles(disparity, geometry, regions=(left, both), max_range_m=8)
    assert sorted(o.region for o in found) == ["both", "both", "left"]
    assert ep.find_obstacles(disparity, geometry, regions=[], max_range_m=8) == []


def test_nothing_valid_is_nothing_found(geometry: ep.RectifiedGeometry) -> None:
    nothing = ep.DisparityMap(np.full((240, 320), 300, np.uint16), np.ones((240, 320), np.uint8))
    assert ep.find_obstacles(nothing, geometry) == []


def test_bad_parameters_are_named(disparity: ep.DisparityMap, geometry: ep.RectifiedGeometry) -> None:
    with pytest.raises(ValueError, match="max_range_m = 0 m"):
        ep.find_obstacles(disparity, geometry, max_range_m=0)
    with pytest.raises(ValueError, match="min_support = -3"):
        ep.find_obstacles(disparity, geometry, min_support=-3)
    with pytest.raises(ValueError, match="'r'"):
        ep.find_obstacles(disparity, geometry, regions=[ep.Region("r", x=0, y=0, width=0, height=1)])
