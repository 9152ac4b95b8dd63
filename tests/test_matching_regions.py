"""Matching of regions only, from Python; and what the matcher refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep

BORDER = 1


def pair(width: int = 160, height: int = 96) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Two shifts, noise, a flat patch."""
    random = np.random.default_rng(4)
    left = random.integers(0, 256, (height, width + 32), np.uint8)
    left[20:40, 60:90] = 90
    right = np.roll(left, -7, axis=1)
    right[height // 2 :] = np.roll(left, -12, axis=1)[height // 2 :]
    return np.ascontiguousarray(left[:, :width]), np.ascontiguousarray(right[:, :width])


COMMON: dict[str, Any] = {
    "num_disparities": 24,
    "block_size": 7,
    "uniqueness_ratio": 5,
    "left_right_max_diff": 1,
    "speckle_size": 40,
    "texture_threshold": 20,
}


def assert_region(actual: ep.DisparityMap, expected: ep.DisparityMap, box: tuple[int, int, int, int]) -> None:
    x, y, width, height = box
    inside = np.s_[y : y + height, x : x + width]
    np.testing.assert_array_equal(actual.raw[inside], expected.raw[inside])
    np.testing.assert_array_equal(actual.validity[inside], expected.validity[inside])
    np.testing.assert_array_equal(actual.values[inside], expected.values[inside])


@pytest.mark.parametrize("method", ["sad", "sad5", "census", "bt", "sgm"])
def test_regions_have_the_answers_of_the_whole_image_and_nothing_around(method: Any) -> None:
    left, right = pair()
    whole = ep.match(left, right, method=method, **COMMON)
    boxes = [(10, 5, 60, 30), (40, 20, 100, 25), (0, 90, 160, 6)]
    disp = ep.match(
        left, right, method=method, **COMMON, regions=[ep.Region("a", x=10, y=5, width=60, height=30), *boxes[1:]]
    )
    outside = np.ones(left.shape, bool)
    for box in boxes:
        assert_region(disp, whole, box)
        x, y, width, height = box
        outside[y : y + height, x : x + width] = False
    assert (disp.validity[outside] == BORDER).all()
    assert np.isnan(disp.values[outside]).all()
    assert 0 < disp.density < whole.density


def test_each_region_has_its_own_disparities() -> None:
    left, right = pair()
    regions = [
        ep.Region("near", x=10, y=50, width=100, height=20, disparities=(8, 16)),
        ep.Region("far", x=10, y=5, width=100, height=20, disparities=(0, 10)),
    ]
    disp = ep.match(left, right, **COMMON, regions=regions)
    for region in regions:
        assert region.disparities is not None
        first, count = region.disparities
        whole = ep.match(left, right, **{**COMMON, "min_disparity": first, "num_disparities": count})
        assert_region(disp, whole, (region.x, region.y, region.width, region.height))
    assert (disp.min_disparity, disp.num_disparities) == (0, 24)


def test_a_metric_range_covers_every_ray_of_the_region() -> None:
    left, right = pair()
    geometry = ep.RectifiedGeometry(
        width=160, height=96, focal_px=100, cx_px=79.5, cy_px=47.5, baseline_m=0.5, doffs_px=1.0
    )
    region = ep.Region("wide", x=0, y=50, width=160, height=40, range_m=(4.0, 20.0))
    disp = ep.match(left, right, **COMMON, regions=[region], geometry=geometry)
    # d = f b / Z - doffs with Z = range / |ray|: the box's rays are 1.0003 (beside the principal point) to 1.35 long.
    corner = np.sqrt(1 + (79.5 / 100) ** 2 + (41.5 / 100) ** 2)
    beside = np.sqrt(1 + (2.5 / 100) ** 2)
    last = np.ceil(50 * corner / 4 - 1) + 1
    first = np.floor(50 * beside / 20 - 1) - 1
    assert (disp.min_disparity, disp.min_disparity + disp.num_disparities - 1) == (first, last)
    assert_region(
        disp,
        ep.match(left, right, **{**COMMON, "min_disparity": int(first), "num_disparities": int(last - first) + 1}),
        (0, 50, 160, 40),
    )
    beyond = ep.Region("far", x=0, y=50, width=160, height=40, range_m=(1e-9, float("inf")))
    disp = ep.match(left, right, **COMMON, regions=[beyond], geometry=geometry)
    assert (disp.min_disparity, disp.num_disparities) == (0, 160)
    with pytest.raises(ValueError, match=r"range_m = \(4, 20\) m of region 'wide': needs the geometry"):
        ep.match(left, right, **COMMON, regions=[region])


def test_a_matcher_keeps_its_regions_until_a_call_names_others() -> None:
    left, right = pair()
    matcher = ep.StereoMatcher(**COMMON, regions=[(0, 0, 30, 10)])
    assert matcher(left, right).density == pytest.approx(matcher(left, right).density)
    assert (matcher(left, right).validity[10:] == BORDER).all()
    other = matcher(left, right, regions=[(0, 30, 160, 10)])
    assert (other.validity[:30] == BORDER).all()
    again = ep.StereoMatcher(**matcher.parameters)
    np.testing.assert_array_equal(again(left, right).validity, matcher(left, right).validity)


@pytest.mark.parametrize(
    ("regions", "message"),
    [
        ([], r"regions = 0 boxes: must be 1 to 256"),
        ([(0, 0, 0, 5)], r"regions = 0x5 px at \(0, 0\): must not be empty"),
        ([(100, 0, 61, 5)], r"must lie inside the image of 160x96 px"),
        ([(0, 96, 5, 5)], r"must lie inside the image of 160x96 px"),
        ([(2**62, 2**62, 2**62, 2**62)], r"must lie inside the image of 160x96 px"),
        ([(-1, 0, 5, 5)], r"regions: x = -1: must not be negative"),
        ([(0, 0, float("nan"), 5)], r"regions: got \(0, 0, nan, 5\): must be a sequence of epiline.Region or"),
        ([(0, 0, 5.5, 5)], r"regions: got \(0, 0, 5.5, 5\): must be"),
        ([(0, 0, 2**70, 5)], r"regions: got \(0, 0, 1180591620717411303424, 5\): must be"),
        ([(0, 0, 5)], r"regions: got \(0, 0, 5\): must be"),
        (7, r"regions: got 7: must be"),
        ([ep.Region("r", x=0, y=0, width=9, height=9, disparities=(150, 20))], r"170 px must not exceed .* 160 px"),
        ([ep.Region("r", x=0, y=0, width=9, height=9, disparities=(0, 0))], r"num_disparities = 0 px"),
        (
            [ep.Region("r", x=0, y=0, width=9, height=9, range_m=(0, 3))],
            r"range_m = \(0, 3\) m of region 'r': must be two",
        ),
        ([ep.Region("r", x=0, y=0, width=9, height=9, range_m=(3, 3))], r"0 < near < far"),
        ([ep.Region("r", x=0, y=0, width=9, height=9, range_m=(float("nan"), 3))], r"0 < near < far"),
    ],
)
def test_regions_that_make_no_sense_are_named(regions: Any, message: str) -> None:
    left, right = pair()
    with pytest.raises(ValueError, match=message):
        ep.match(left, right, **COMMON, regions=regions)


def test_a_region_has_one_kind_of_range() -> None:
    with pytest.raises(ValueError, match=r"region 'r': give either disparities or range_m"):
        ep.Region("r", x=0, y=0, width=9, height=9, disparities=(0, 9), range_m=(1, 2))
    with pytest.raises(ValueError, match=r"disparities\[0\] = -1: must not be negative"):
        ep.Region("r", x=0, y=0, width=9, height=9, disparities=(-1, 9))
    region = ep.Region("r", x=0, y=1, width=9, height=9, range_m=(1, 2.5))
    assert (region.range_m, region.disparities) == ((1, 2.5), None)
    assert repr(region) == "Region('r', x=0, y=1, width=9, height=9, range_m=(1, 2.5))"
    assert region != ep.Region("r", x=0, y=1, width=9, height=9)


@pytest.mark.parametrize(
    "image",
    [
        np.full((40, 60), np.nan),
        np.zeros((40, 60), np.float32),
        np.zeros((40, 60), np.uint16),
        np.zeros((40, 60), np.int8),
        np.zeros((40, 60), bool),
        np.zeros((40, 60, 4), np.uint8),
        np.zeros((40, 60, 1), np.uint8),
        np.zeros(60, np.uint8),
        np.zeros((0, 0), np.uint8),
        np.zeros((0, 60), np.uint8),
        np.empty((40, 60), object),
        None,
        "left.png",
    ],
)
def test_what_is_no_image_of_bytes_is_refused(image: Any) -> None:
    fine = np.zeros((40, 60), np.uint8)
    for left, right in ((image, fine), (fine, image)):
        with pytest.raises(ValueError, match=r"left|right|image"):
            ep.match(left, right, num_disparities=16)


@pytest.mark.parametrize("method", ["sad", "sad5", "census", "bt", "sgm"])
@pytest.mark.parametrize(("width", "height"), [(1, 1), (3, 1), (1, 9), (7, 3)])
def test_images_smaller_than_the_window_are_answered(method: Any, width: int, height: int) -> None:
    random = np.random.default_rng(5)
    left = random.integers(0, 256, (height, width), np.uint8)
    disp = ep.match(
        left,
        left,
        method=method,
        num_disparities=1,
        block_size=15,
        left_right_max_diff=1,
        texture_threshold=1,
        fill=True,
    )
    assert disp.shape == (height, width)
    assert (disp.raw == 0).all()


@pytest.mark.parametrize("method", ["sad", "sad5", "census", "bt", "sgm"])
def test_disparities_beyond_the_width_are_refused(method: Any) -> None:
    image = np.zeros((20, 60), np.uint8)
    with pytest.raises(ValueError, match=r"num_disparities = 61 px: .* must not exceed the images' width of 60 px"):
        ep.match(image, image, method=method, num_disparities=61)
    with pytest.raises(ValueError, match=r"num_disparities = 60 px: .* = 61 px must not exceed"):
        ep.match(image, image, method=method, num_disparities=60, min_disparity=1)


def test_any_memory_layout_gives_the_same_answer() -> None:
    left, right = pair()
    expected = ep.match(left, right, **COMMON)
    for layout in (
        lambda image: np.asfortranarray(image),
        lambda image: np.flipud(np.flipud(image).copy()),
        lambda image: np.fliplr(np.fliplr(image).copy()),
        lambda image: np.pad(image, 3)[3:-3, 3:-3],
    ):
        views = [layout(left), layout(right)]
        for view in views:
            view.flags.writeable = False
        disp = ep.match(*views, **COMMON)
        np.testing.assert_array_equal(disp.raw, expected.raw)
        np.testing.assert_array_equal(disp.validity, expected.validity)


def test_saturated_windows_are_marked() -> None:
    left, right = pair()
    left[60:80, 100:130] = 255
    disp = ep.match(left, right, num_disparities=24, block_size=7, saturation_threshold=50)
    assert (disp.validity[64:76, 104:126] & 64).all()
    assert np.isnan(disp.values[64:76, 104:126]).all()
    assert not (disp.validity[:50] & 64).any()
    with pytest.raises(ValueError, match=r"saturation_threshold = 101 %: must be 0 to 100 %"):
        ep.StereoMatcher(saturation_threshold=101)
