"""Regions against NumPy's brute force, on random maps and on the ground truth of real scenes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

import epiline as ep

Floats = NDArray[np.float32]


def clustered_map(seed: int, shape: tuple[int, int]) -> ep.DisparityMap:
    rng = np.random.default_rng(seed)
    cluster = rng.integers(0, 5, shape) * 4
    raw = (16 * (2 + cluster + rng.uniform(0, 3, shape))).astype(np.uint16)
    return ep.DisparityMap(raw, (rng.random(shape) < 0.4).astype(np.uint8), num_disparities=28)


def nearest_supported(column: Floats, min_support: int) -> float:
    """The definition, word by word."""
    values = column[np.isfinite(column)]
    supported = [d for d in values if np.sum(np.abs(values - d) <= 1) >= min_support]
    return max(supported, default=np.nan)


@pytest.mark.parametrize("min_support", [1, 3, 6])
def test_columns_are_brute_force(min_support: int) -> None:
    disparity = clustered_map(min_support, (40, 91))
    box = ep.Region("box", x=5, y=3, width=77, height=31)
    profile = ep.profile(disparity, [box], min_support=min_support)[0]
    values = disparity.values[3:34, 5:82]
    expected = [nearest_supported(column, min_support) for column in values.T]
    np.testing.assert_array_equal(profile.nearest_px, np.array(expected, np.float32))
    np.testing.assert_array_equal(profile.median_px, np.nanmedian(values, axis=0))
    np.testing.assert_array_equal(profile.minimum_px, np.nanmin(values, axis=0))
    np.testing.assert_array_equal(profile.maximum_px, np.nanmax(values, axis=0))
    np.testing.assert_array_equal(profile.count, np.isfinite(values).sum(axis=0))
    np.testing.assert_array_equal(profile.unknown, np.isnan(values).sum(axis=0))
    np.testing.assert_allclose(profile.unknown_share, np.isnan(values).mean(axis=0), rtol=1e-6)
    spread = stats.median_abs_deviation(values.astype(np.float64), axis=0, nan_policy="omit", scale="normal")
    np.testing.assert_allclose(profile.spread_px, spread, rtol=1e-5)
    valid = values[np.isfinite(values)]
    np.testing.assert_array_equal(profile.histogram, np.bincount(np.floor(valid + 0.5).astype(int), minlength=28))
    assert profile.total == pytest.approx(valid.sum(dtype=np.float64))
    assert (profile.minimum, profile.maximum) == (valid.min(), valid.max())
    assert profile.valid_share == valid.size / values.size
    assert profile.nearest_range_m is None
    assert np.isnan([profile.range_m, profile.sigma_m]).all()
    assert profile.region == box


def test_ranges_need_a_geometry_and_follow_it() -> None:
    disparity = ep.DisparityMap(np.full((60, 80), 10 * 16, np.uint16), np.zeros((60, 80), np.uint8))
    geometry = ep.RectifiedGeometry(width=80, height=60, focal_px=100, cx_px=39.5, cy_px=29.5, baseline_m=0.2)
    profile = ep.profile(disparity, [ep.Region("r", x=0, y=20, width=80, height=20)], geometry=geometry)[0]
    rays = np.sqrt(1 + ((np.arange(80) - 39.5) / 100) ** 2)
    np.testing.assert_allclose(profile.nearest_range_m, 2 * rays, rtol=1e-6)
    assert profile.range_m == pytest.approx(2, rel=1e-3)
    # Of 1600 pixels: a surface keeps half of a disparity's variance, and 60 of its pixels as much again.
    assert profile.sigma_m == pytest.approx(4 * 0.25 * np.sqrt(0.5 + 60 / 1600) / 20, rel=1e-3)
    assert profile.nearest_disparity_px == pytest.approx(10)
    assert profile.support == 1600
    assert profile.nearest_at is not None
    assert abs(profile.nearest_at[0] - 39.5) < 8
    wider = ep.profile(disparity, [profile.region], geometry=geometry, disparity_sigma_px=0.5)[0]
    assert wider.sigma_m == pytest.approx(2 * profile.sigma_m)


def test_paper_regions() -> None:
    sizes = [(r.name, r.x, r.width, r.height) for r in ep.paper_regions(320, 240)]
    assert sizes == [(f"band_{h}", 0, 320, h) for h in (20, 30, 40, 50)]
    bands = ep.paper_regions(1280, 720)
    assert [b.y for b in bands] == [300, 360, 450, 570]
    assert bands[-1].y + bands[-1].height == 720
    with pytest.raises(ValueError, match="image_size"):
        ep.paper_regions(320, 8)


def test_bad_regions_are_named() -> None:
    disparity = clustered_map(0, (20, 30))
    with pytest.raises(ValueError, match=r"'far', 30x1 px at \(1, 0\).*30x20"):
        ep.profile(disparity, [ep.Region("far", x=1, y=0, width=30, height=1)])
    with pytest.raises(ValueError, match="x = -1"):
        ep.Region("left", x=-1, y=0, width=3, height=1)
    with pytest.raises(ValueError, match="min_support = 0"):
        ep.profile(disparity, [ep.Region("r", x=0, y=0, width=3, height=1)], min_support=0)


def nearest_window(values: Floats, support: int) -> float:
    """The largest disparity with `support` pixels within 1 px behind it in it and 5 columns on either side."""
    nearest = 0.0
    for x in range(values.shape[1]):
        near = values[:, max(0, x - 5) : x + 6]
        ordered = np.sort(near[np.isfinite(near)])[::-1]
        behind = ordered[support - 1 :]
        enough = ordered[: behind.size][ordered[: behind.size] - behind <= 1]
        nearest = max(nearest, float(enough.max(initial=0.0)))
    return nearest


def test_nearest_surface_of_real_ground_truth(data: Path) -> None:
    seen = 0
    for name in ("middlebury2003/cones", "middlebury2003/teddy"):
        truth = cv2.imread(str(data / name / "gt_left.png"), cv2.IMREAD_GRAYSCALE)
        assert truth is not None
        disparity = ep.DisparityMap(truth.astype(np.uint16) * 4, (truth == 0).astype(np.uint8), num_disparities=64)
        height, width = truth.shape
        for profile in ep.profile(disparity, ep.paper_regions(width, height)):
            region = profile.region
            values = disparity.values[region.y : region.y + region.height, region.x : region.x + region.width]
            supported = [nearest_supported(column, 3) for column in values.T]
            np.testing.assert_array_equal(profile.nearest_px, np.array(supported, np.float32))
            assert profile.nearest_disparity_px == pytest.approx(nearest_window(values, 30), abs=2)
            seen += 1
    assert seen == 8
