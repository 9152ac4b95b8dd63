"""The matcher against OpenCV where both answer the same question, and the rules of its Python interface."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep

LEFT_RIGHT, SPECKLE, NO_SOURCE, BORDER = 8, 32, 2, 1


def textured_pair(width: int, height: int, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Two planes before a slope, textured, with a little noise in the right image."""
    random = np.random.default_rng(seed)
    scene = cv2.GaussianBlur(random.integers(0, 256, (height, width + 64), np.uint8), (5, 5), 1.0)
    scene = cv2.normalize(scene, scene, 0, 255, cv2.NORM_MINMAX)
    rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
    disparity = 3 + 12 * rows / height
    disparity[height // 4 : height // 2, width // 3 : width // 2] = 21.5
    right = cv2.remap(scene, columns + disparity, rows, cv2.INTER_LINEAR)
    noise = random.integers(-2, 3, right.shape)
    return np.ascontiguousarray(scene[:, :width]), np.clip(right + noise, 0, 255).astype(np.uint8)


def stereo_bm(disparities: int, window: int, cap: int = 31) -> cv2.StereoBM:
    matcher = cv2.StereoBM.create(disparities, window)
    matcher.setPreFilterType(cv2.StereoBM_PREFILTER_XSOBEL)
    matcher.setPreFilterCap(cap)
    matcher.setTextureThreshold(0)
    matcher.setUniquenessRatio(0)
    matcher.setSpeckleWindowSize(0)
    matcher.setDisp12MaxDiff(-1)
    return matcher


def interior(shape: tuple[int, int], disparities: int, window: int) -> tuple[slice, slice]:
    """Where StereoBM answers and its windows lie inside both images."""
    radius = window // 2
    return np.s_[radius : shape[0] - radius, disparities - 1 + radius : shape[1] - radius]


@pytest.mark.parametrize("window", [5, 7, 9, 11, 15, 21])
@pytest.mark.parametrize("disparities", [32, 48, 64])
def test_interior_equals_stereo_bm_bit_for_bit(window: int, disparities: int) -> None:
    left, right = textured_pair(200, 120)
    expected = stereo_bm(disparities, window).compute(left, right)
    actual = ep.match(left, right, num_disparities=disparities, block_size=window).to_opencv()
    inside = interior(left.shape, disparities, window)
    np.testing.assert_array_equal(actual[inside], expected[inside])


def test_ties_are_broken_as_stereo_bm_breaks_them() -> None:
    stripes = np.tile(np.array([10, 90, 200, 90], np.uint8).repeat(2), (64, 24))  # a period of 8 px: ties everywhere
    expected = stereo_bm(32, 9).compute(stripes, stripes)
    actual = ep.match(stripes, stripes, num_disparities=32, block_size=9).to_opencv()
    inside = interior(stripes.shape, 32, 9)
    np.testing.assert_array_equal(actual[inside], expected[inside])


@pytest.mark.parametrize("ratio", [1, 10, 15, 25])
def test_uniqueness_equals_stereo_bm(ratio: int) -> None:
    left, right = textured_pair(220, 120, seed=1)
    right = cv2.GaussianBlur(right, (0, 0), 2.5)
    theirs = stereo_bm(48, 9)
    theirs.setUniquenessRatio(ratio)
    expected = theirs.compute(left, right)
    actual = ep.match(left, right, num_disparities=48, block_size=9, uniqueness_ratio=ratio).to_opencv()
    inside = interior(left.shape, 48, 9)
    np.testing.assert_array_equal(actual[inside], expected[inside])
    assert 0.02 < (actual[inside] < 0).mean() < 0.98


def test_texture_equals_stereo_bm() -> None:
    left, right = textured_pair(220, 120, seed=2)
    contrast = np.linspace(0.6, 0, 220)[None]
    left, right = (np.rint(128 + contrast * (image.astype(float) - 128)).astype(np.uint8) for image in (left, right))
    theirs = stereo_bm(32, 9)
    theirs.setTextureThreshold(600)
    expected = theirs.compute(left, right)
    disp = ep.match(left, right, num_disparities=32, block_size=9, texture_threshold=600)
    inside = interior(left.shape, 32, 9)
    np.testing.assert_array_equal(disp.to_opencv()[inside], expected[inside])
    assert 0.02 < (disp.validity[inside] == 16).mean() < 0.98


def test_xsobel_equals_the_prefilter_of_opencv() -> None:
    left, _ = textured_pair(61, 40)
    # OpenCV does not offer its prefilter; its Sobel with the same border does, and clipping is ours.
    derivative = cv2.Sobel(left, cv2.CV_16S, 1, 0, ksize=3, borderType=cv2.BORDER_REFLECT_101)
    np.testing.assert_array_equal(ep.xsobel(left, cap=31), np.clip(derivative, -31, 31) + 31)


@pytest.mark.parametrize(("size", "range_px"), [(1, 1), (30, 0), (30, 1), (200, 2)])
def test_speckles_equal_filter_speckles(size: int, range_px: int) -> None:
    left, right = textured_pair(220, 120, seed=3)
    right = cv2.GaussianBlur(right, (0, 0), 2.0)
    common: dict[str, Any] = {"num_disparities": 32, "block_size": 5, "left_right_max_diff": 1}
    before = ep.match(left, right, **common)
    expected = before.to_opencv()
    cv2.filterSpeckles(expected, -16, size, 16 * range_px)
    after = ep.match(left, right, **common, speckle_size=size, speckle_range=range_px)
    np.testing.assert_array_equal(after.to_opencv(), expected)
    np.testing.assert_array_equal(after.validity & (255 - SPECKLE), before.validity)


def test_left_right_agrees_with_matching_the_mirrored_pair() -> None:
    """The right image's own best match is what the matcher finds with the pair mirrored and swapped."""
    left, right = textured_pair(240, 100, seed=4)
    common: dict[str, Any] = {"num_disparities": 32, "block_size": 9, "subpixel": False}
    of_left = ep.match(left, right, **common, left_right_max_diff=1)
    mirrored = ep.match(right[:, ::-1], left[:, ::-1], **common)
    of_right = mirrored.raw[:, ::-1].astype(int) // 16
    d = of_left.raw.astype(int) // 16
    columns = np.arange(d.shape[1])
    difference = np.abs(np.take_along_axis(of_right, columns - d, axis=1) - d)
    rejected = (of_left.validity & LEFT_RIGHT) != 0
    # Windows at the borders are clamped to the reference image, which is not the same one; look at the interior.
    inside = interior(left.shape, 32, 9)
    np.testing.assert_array_equal(rejected[inside], (difference > 1)[inside])
    assert 0.01 < rejected[inside].mean() < 0.9


def test_left_border_is_answered_and_right() -> None:
    left, right = textured_pair(160, 90)
    disp = ep.match(left, right, num_disparities=48, block_size=9)
    assert disp.density == 1.0
    truth = 3 + 12 * np.arange(90) / 90
    error = np.abs(disp.values[:, 20:47] - truth[:, None])  # StereoBM answers none of these columns
    assert np.median(error) < 0.1
    assert (error < 1).mean() > 0.97


def test_half_pixel_is_found() -> None:
    left, right = textured_pair(200, 120)
    disp = ep.match(left, right, num_disparities=32, block_size=9)
    block = disp.values[36:54, 96:112]  # inside the plane at 21.5 px
    assert abs(np.median(block) - 21.5) <= 1 / 8


def test_every_level_and_thread_count_gives_the_same_answer(tmp_path: Path) -> None:
    left, right = textured_pair(180, 150, seed=5)
    np.savez(tmp_path / "pair.npz", left=left, right=right)
    code = """
import sys, numpy as np, epiline as ep
pair = np.load(sys.argv[1])
strict = dict(num_disparities=40, block_size=9, uniqueness_ratio=5, texture_threshold=10, left_right_max_diff=1,
              speckle_size=50)
disp = ep.StereoMatcher(**strict, threads=int(sys.argv[2]))(pair["left"], pair["right"])
np.savez(sys.argv[3], raw=disp.raw, validity=disp.validity, level=ep.simd_level())
"""
    answers = {}
    for level in ("scalar", "avx2", "avx512", "no such level"):
        for threads in ("1", "3"):
            out = tmp_path / f"{level}-{threads}.npz"
            command = [sys.executable, "-c", code, str(tmp_path / "pair.npz"), threads, str(out)]
            subprocess.run(command, check=True, env={**os.environ, "EPILINE_SIMD": level})
            answers[level, threads] = np.load(out)
    reference = answers["scalar", "1"]
    assert reference["level"] == "scalar"
    for key, answer in answers.items():
        np.testing.assert_array_equal(answer["raw"], reference["raw"], err_msg=str(key))
        np.testing.assert_array_equal(answer["validity"], reference["validity"], err_msg=str(key))


def test_pixels_without_source_have_no_answer_and_are_no_match() -> None:
    left, right = textured_pair(160, 90)
    left_valid, right_valid = np.ones((90, 160), bool), np.ones((90, 160), bool)
    left_valid[:, 150:] = False
    right_valid[20:30] = False
    matcher = ep.StereoMatcher(num_disparities=32, block_size=9, min_disparity=2)
    disp = matcher(left, right, left_valid=left_valid, right_valid=right_valid)
    assert (disp.validity[:, 150:] & NO_SOURCE).all()
    assert (disp.validity[20:30, 2:] & NO_SOURCE).all()
    assert (disp.validity[:, :2] & BORDER).all()
    assert np.isnan(disp.values[:, 150:]).all()
    assert not disp.validity[40:, 2:150].any()


def test_values_raw_and_exports_say_the_same() -> None:
    left, right = textured_pair(120, 60)
    disp = ep.match(left, right, num_disparities=32, min_disparity=1, block_size=9, left_right_max_diff=0)
    answered = disp.validity == 0
    assert 0 < answered.mean() == pytest.approx(disp.density)
    assert disp.values.dtype == np.float32
    np.testing.assert_array_equal(np.isnan(disp.values), ~answered)
    np.testing.assert_array_equal(disp.values[answered], disp.raw[answered] / np.float32(16))
    exported = disp.to_opencv()
    assert exported.dtype == np.int16
    np.testing.assert_array_equal(exported, np.where(answered, disp.raw.astype(np.int16), 0))
    assert (disp.shape, disp.min_disparity, disp.num_disparities) == ((60, 120), 1, 32)


def test_a_map_can_be_made_from_arrays() -> None:
    raw = np.array([[16, 40], [0, 0]], np.uint16)
    disp = ep.DisparityMap(raw, np.array([[0, 128], [2, 4]], np.uint8), num_disparities=8)
    np.testing.assert_array_equal(disp.values, np.array([[1, 2.5], [np.nan, np.nan]], np.float32))
    np.testing.assert_array_equal(disp.to_opencv(), [[16, 40], [-16, -16]])
    with pytest.raises(ValueError, match=r"raw is 2x2 px but validity is 2x1 px"):
        ep.DisparityMap(raw, np.zeros((1, 2), np.uint8))
    with pytest.raises(ValueError, match=r"raw: expected a uint16 array"):
        ep.DisparityMap(raw.astype(float), np.zeros((2, 2), np.uint8))  # type: ignore[arg-type]


def test_out_is_overwritten_and_returned() -> None:
    matcher = ep.StereoMatcher(num_disparities=16, block_size=5)
    out = matcher(*textured_pair(80, 40))
    fresh = matcher(*textured_pair(100, 50, seed=7))
    assert matcher(*textured_pair(100, 50, seed=7), out=out) is out
    np.testing.assert_array_equal(out.raw, fresh.raw)


def test_colour_strides_and_read_only_arrays_are_fine() -> None:
    left, right = textured_pair(100, 50)
    expected = ep.match(left, right, num_disparities=16).raw
    colour = [np.repeat(image[..., None], 3, axis=2) for image in (left, right)]
    np.testing.assert_array_equal(ep.match(*colour, num_disparities=16).raw, expected)
    strided = [np.repeat(image, 2, axis=1)[:, ::2] for image in (left, right)]
    for image in strided:
        image.flags.writeable = False
    np.testing.assert_array_equal(ep.match(*strided, num_disparities=16).raw, expected)


def test_one_matcher_serves_two_threads() -> None:
    matcher = ep.StereoMatcher(num_disparities=32, block_size=9)
    pairs = [textured_pair(160, 90, seed=8), textured_pair(160, 90, seed=9)]
    expected = [matcher(*pair).raw for pair in pairs]
    wrong: list[int] = []

    def work(index: int) -> None:
        for _ in range(5):
            if not np.array_equal(matcher(*pairs[index]).raw, expected[index]):
                wrong.append(index)

    threads = [threading.Thread(target=work, args=(index,)) for index in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"num_disparities": 0}, r"num_disparities = 0 px: must be 1 to 1024"),
        ({"num_disparities": -4}, r"num_disparities = -4: must not be negative"),
        ({"block_size": 8}, r"block_size = 8 px: must be odd"),
        ({"block_size": 33}, r"block_size = 33 px: must be odd, 1 to 31"),
        ({"min_disparity": -1}, r"min_disparity = -1: must not be negative"),
        ({"prefilter": "blur"}, r"prefilter = 'blur': must be 'xsobel', 'none' or None"),
        ({"prefilter_cap": 64}, r"prefilter_cap = 64: must be 1 to 63"),
        ({"method": "magic"}, r"method = 'magic': must be 'sad'"),
        ({"uniqueness_ratio": 101}, r"uniqueness_ratio = 101 %: must be 0 to 100"),
        ({"threads": 0}, r"threads = 0: must be at least 1"),
        ({"subpixel": "spline"}, r"subpixel = 'spline': must be True, False, 'v' or 'parabola'"),
    ],
)
def test_parameters_outside_their_range_are_named(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ep.StereoMatcher(**parameters)


def test_images_that_do_not_fit_are_named() -> None:
    left, right = textured_pair(100, 50)
    matcher = ep.StereoMatcher(num_disparities=64)
    with pytest.raises(ValueError, match=r"left is 100x50 px but right is 100x49 px"):
        matcher(left, right[:-1])
    with pytest.raises(ValueError, match=r"num_disparities = 64 px: .* 64 px must not exceed .* width of 60 px"):
        matcher(left[:, :60], right[:, :60])
    with pytest.raises(ValueError, match=r"left: expected a uint8 array"):
        matcher(left.astype(np.float32), right)  # type: ignore[arg-type]


def costs_of_whole_windows(left: NDArray[np.uint8], right: NDArray[np.uint8], count: int, side: int) -> NDArray[Any]:
    """(count, H, W) sums of absolute differences; meaningless where the window leaves either image."""
    from scipy.ndimage import uniform_filter

    shifted = [np.abs(left.astype(float) - np.roll(right, d, axis=1)) for d in range(count)]
    return np.rint(np.stack([uniform_filter(costs, side) * side**2 for costs in shifted])).astype(np.int64)


@pytest.mark.parametrize("fit", [True, "v", "parabola", False])
def test_sub_pixel_fits_are_those_of_their_formulas(fit: Any) -> None:
    left, right = textured_pair(160, 90)
    count, side = 32, 9
    settings = {"num_disparities": count, "block_size": side, "prefilter": "none", "subpixel": fit}
    actual = ep.match(left, right, **settings).values  # type: ignore[arg-type]
    costs = costs_of_whole_windows(left, right, count, side)
    whole = count - 1 - np.argmin(costs[::-1], axis=0)
    at = lambda d: np.take_along_axis(costs, np.clip(d, 0, count - 1)[None], axis=0)[0]  # noqa: E731
    smaller, best, larger = at(whole - 1), at(whole), at(whole + 1)
    curvature = (smaller + larger if fit == "parabola" else np.maximum(smaller, larger) + best) - 2 * best
    inner = (whole > 0) & (whole < count - 1) & (curvature > 0)
    offset = np.where(inner, (smaller - larger) / np.maximum(2 * curvature, 1), 0) if fit else np.zeros(whole.shape)
    inside = np.s_[side:-side, count + side : -side]
    # Rounded up to a sixteenth, of a 256th that is rounded toward the whole.
    assert np.abs(actual - (whole + offset))[inside].max() <= 17 / 256
    assert np.unique(actual[inside] % 1).size > 4 or not fit


def test_parameters_are_reported_and_make_the_same_matcher() -> None:
    given = {"num_disparities": 40, "left_right_max_diff": 2, "prefilter": "none", "threads": 2}
    parameters = ep.StereoMatcher(**given).parameters  # type: ignore[arg-type]
    assert {name: parameters[name] for name in given} == given
    assert ep.StereoMatcher(**parameters).parameters == parameters


def test_accuracy_on_a_real_scene(data: Path) -> None:
    """Cones: with all tests few wrong answers, without any an answer everywhere."""
    folder = data / "middlebury2003" / "cones"
    scene = json.loads((data / "manifest.json").read_text())["middlebury2003/cones"]
    left, right = (cv2.imread(str(folder / scene[side]), cv2.IMREAD_GRAYSCALE) for side in ("left", "right"))
    truth = cv2.imread(str(folder / scene["gt"]), cv2.IMREAD_UNCHANGED).astype(float)
    truth = truth.reshape(*truth.shape[:2], -1)[..., 0] / scene["gt_scale"]
    strict = {"uniqueness_ratio": 5, "texture_threshold": 10, "left_right_max_diff": 1, "speckle_size": 200}
    disp = ep.match(left, right, num_disparities=scene["num_disp"], block_size=11, **strict)
    scored = (truth > 0) & (disp.validity == 0)
    assert scored.mean() > 0.6
    assert (np.abs(disp.values - truth)[scored] > 2).mean() < 0.06
    assert ep.match(left, right, num_disparities=scene["num_disp"]).density == 1.0
