"""The window sums besides `sad`, held to their definitions in NumPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import epiline as ep

METHODS = ("sad5", "census", "bt")


def scene(width: int = 90, height: int = 40) -> tuple[np.ndarray, np.ndarray]:
    """A textured plane at 9 px in front of one at 3 px, with a little noise."""
    rng = np.random.default_rng(8)
    left = rng.integers(0, 230, (height, width), np.uint8)
    right = np.roll(left, -3, axis=1)
    right[10:30, 21:51] = left[10:30, 30:60]
    return left, right + rng.integers(0, 20, right.shape, np.uint8)


def clamped(image: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """The image moved so that pixel (y, x) is that of (y + rows, x + columns), clamped to the image."""
    height, width = image.shape
    return image[
        np.clip(np.arange(height) + rows, 0, height - 1)[:, None],
        np.clip(np.arange(width) + columns, 0, width - 1)[None, :],
    ]


def x_sobel(image: np.ndarray, cap: int) -> np.ndarray:
    padded = np.pad(image.astype(int), 1, mode="reflect")
    slope = padded[:, 2:] - padded[:, :-2]
    return np.clip(slope[:-2] + 2 * slope[1:-1] + slope[2:], -cap, cap)


def census(image: np.ndarray) -> np.ndarray:
    """(24, H, W) bool."""
    around = [(j, i) for j in range(-2, 3) for i in range(-2, 3) if (j, i) != (0, 0)]
    return np.stack([clamped(image, j, i) < image for j, i in around])


def birchfield_tomasi(left: np.ndarray, right: np.ndarray, d: int) -> np.ndarray:
    def around(image: np.ndarray) -> np.ndarray:
        means = [(image + clamped(image, 0, i) + 1) // 2 for i in (-1, 1)]
        return np.stack([image, *means])

    def outside(value: np.ndarray, spanned: np.ndarray) -> np.ndarray:
        return np.maximum(0, np.maximum(value - spanned.max(0), spanned.min(0) - value))

    def opposite(image: np.ndarray) -> np.ndarray:
        return clamped(image, 0, -d)

    spanned = np.stack([opposite(plane) for plane in around(right)])
    return np.minimum(outside(left, spanned), outside(opposite(right), around(left)))


def pixel_costs(method: str, left: np.ndarray, right: np.ndarray, d: int) -> np.ndarray:
    if method == "census":
        ours, theirs = census(left), census(right)
        return np.sum([a != clamped(b, 0, -d) for a, b in zip(ours, theirs, strict=True)], axis=0)
    filtered = x_sobel(left, 31), x_sobel(right, 31)
    if method == "sad5":
        return np.abs(filtered[0] - clamped(filtered[1], 0, -d))
    return birchfield_tomasi(*filtered, d) + birchfield_tomasi(left.astype(int), right.astype(int), d) // 4


def whole_disparities(method: str, left: np.ndarray, right: np.ndarray, count: int, side: int) -> np.ndarray:
    """The cheapest candidate; of equals the largest disparity."""
    radius = side // 2
    offsets = range(-radius, radius + 1)
    costs = []
    for d in range(count):
        pixels = pixel_costs(method, left, right, d)
        cost = boxes = np.sum([clamped(pixels, j, i) for j in offsets for i in offsets], axis=0)
        if method == "sad5":
            corners = [clamped(boxes, j, i) for j in (-radius, radius) for i in (-radius, radius)]
            cost = boxes + np.sum(np.sort(corners, axis=0)[:2], axis=0)
        costs.append(np.where(np.arange(left.shape[1]) >= d, cost, 10**9))
    return count - 1 - np.argmin(costs[::-1], axis=0)


@pytest.mark.parametrize("side", [1, 3, 9])
@pytest.mark.parametrize("method", METHODS)
def test_disparities_are_those_of_the_definition(method: Any, side: int) -> None:
    left, right = scene()
    disp = ep.match(left, right, method=method, num_disparities=20, block_size=side, subpixel=False)
    np.testing.assert_array_equal(disp.values, whole_disparities(method, left, right, 20, side))


@pytest.mark.parametrize("method", METHODS)
def test_planes_are_found_with_every_test_on(method: Any) -> None:
    tests: dict[str, Any] = {
        "uniqueness_ratio": 5,
        "texture_threshold": 50,
        "left_right_max_diff": 1,
        "speckle_size": 20,
    }
    disp = ep.match(*scene(), method=method, num_disparities=20, **tests)
    assert np.nanmax(np.abs(disp.values[15:25, 35:55] - 9)) < 0.5
    assert np.nanmax(np.abs(disp.values[2:5, 20:80] - 3)) < 0.5
    assert disp.density > 0.5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("prefilter", ["xsobel", "none"])
def test_the_largest_window_and_contrast_do_not_overflow(method: Any, prefilter: Any) -> None:
    """A bright bar on black: wrapped sums would have their minimum anywhere."""
    left = np.zeros((64, 128), np.uint8)
    left[:, 60:64] = 255
    right = np.roll(left, -6, axis=1)
    disp = ep.match(
        left, right, method=method, num_disparities=16, block_size=31, prefilter=prefilter, prefilter_cap=63
    )
    assert np.all(np.abs(disp.values[:, 55:68] - 6) <= 0.5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("threads", [1, 2])
def test_a_row_and_a_column_of_pixels_are_answered(method: Any, threads: int) -> None:
    rng = np.random.default_rng(1)
    for shape in ((1, 40), (40, 1)):
        image = rng.integers(0, 256, shape, np.uint8)
        disp = ep.match(image, image, method=method, num_disparities=1, threads=threads, left_right_max_diff=0)
        assert (disp.raw == 0).all()
        assert disp.density == 1.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"block_size": 33}, "block_size = 33 px"),
        ({"block_size": 8}, "block_size = 8 px"),
        ({"block_size": 0}, "block_size = 0 px"),
        ({"num_disparities": 1025}, "num_disparities = 1025 px"),
        ({"num_disparities": 0}, "num_disparities = 0 px"),
        ({"min_disparity": 4095}, "min_disparity = 4095 px"),
        ({"prefilter_cap": 0}, "prefilter_cap = 0"),
        ({"prefilter_cap": 64}, "prefilter_cap = 64"),
        ({"uniqueness_ratio": 101}, "uniqueness_ratio = 101 %"),
    ],
)
def test_wrong_parameters_are_refused_by_name(method: Any, parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ep.StereoMatcher(method=method, **parameters)


def test_an_unknown_method_is_refused_with_those_there_are() -> None:
    with pytest.raises(ValueError, match="'magic': must be 'sad', 'sad5', 'census', 'bt' or 'sgm'"):
        ep.StereoMatcher(method="magic")  # type: ignore[arg-type]


def test_defaults_belong_to_the_method() -> None:
    sides = {method: ep.StereoMatcher(method=method).parameters["block_size"] for method in METHODS}
    assert sides == {"sad5": 9, "census": 11, "bt": 11}


def test_match_takes_a_method_instead_of_a_preset(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2 = pytest.importorskip("cv2")
    from epiline.cli import main

    left, right = scene()
    files = [tmp_path / "left.png", tmp_path / "right.png"]
    for file, image in zip(files, (left, right), strict=True):
        cv2.imwrite(str(file), image)
    out = tmp_path / "out.npy"
    common = ["match", *map(str, files), "-o", str(out), "--disparities", "20"]
    assert main([*common, "--method", "census"]) == 0
    expected = ep.match(left, right, method="census", num_disparities=20).values
    np.testing.assert_array_equal(np.load(out), expected)
    with pytest.raises(SystemExit) as caught:
        main([*common, "--method", "census", "--preset", "fast"])
    assert caught.value.code == 2
    capsys.readouterr()


def test_census_and_five_windows_beat_sad_on_cones(data: Path) -> None:
    from epiline.evaluation import evaluate, load_scenes

    cones = next(s for s in load_scenes(data) if s.name == "middlebury2003/cones")

    def bad1(**parameters: Any) -> float:
        disp = ep.match(cones.left, cones.right, num_disparities=cones.num_disparities, **parameters)
        return evaluate(disp.values, cones.truth, cones.non_occluded).bad1_total

    sad = bad1(block_size=11)
    assert bad1(method="census") < sad
    assert bad1(method="sad5") < sad
