"""Semi-global matching, presets and filling from Python."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest

import epiline as ep


@pytest.fixture(scope="module")
def pair() -> tuple[np.ndarray, np.ndarray]:
    """A textured plane at 9 px in front of one at 3 px."""
    rng = np.random.default_rng(5)
    left = rng.integers(0, 256, (60, 120), dtype=np.uint8)
    right = np.roll(left, -3, axis=1)
    right[20:40, 31:71] = left[20:40, 40:80]
    return left, right


def test_planes_are_found_up_to_the_left_border(pair):
    disparity = ep.match(*pair, method="sgm", num_disparities=32, threads=1)
    assert np.all(np.abs(disparity.values[25:35, 45:75] - 9) < 0.5)
    assert np.all(np.abs(disparity.values[5:15, 4:110] - 3) < 0.5)
    assert disparity.density == 1.0


@pytest.mark.parametrize("method", ["sad", "sgm"])
def test_fill_answers_everything_and_marks_what_it_filled(pair, method):
    settings = {"method": method, "num_disparities": 32, "left_right_max_diff": 1, "uniqueness_ratio": 15}
    tested, filled = ep.match(*pair, **settings), ep.match(*pair, **settings, fill=True)
    assert 0.5 < tested.density < 1.0
    assert filled.density == 1.0
    np.testing.assert_array_equal(filled.validity == 128, tested.validity != 0)


def test_smooth_levels_a_noisy_plane_and_keeps_what_is_missing():
    rng = np.random.default_rng(2)
    left = rng.integers(100, 124, (60, 160), dtype=np.uint8)
    noise = rng.normal(0, 1, (2, *left.shape))
    # A plane between two whole disparities: the mean of two shifts.
    right = (np.roll(left, -4, axis=1).astype(float) + np.roll(left, -5, axis=1)) / 2
    pair = [np.clip(image + extra, 0, 255).astype(np.uint8) for image, extra in zip((left, right), noise, strict=True)]
    settings = {"method": "sgm", "num_disparities": 32, "uniqueness_ratio": 10}
    plain, smooth = ep.match(*pair, **settings), ep.match(*pair, **settings, smooth=True)
    np.testing.assert_array_equal(smooth.validity, plain.validity)
    inside = np.s_[8:-8, 40:-8]
    assert np.nanstd(smooth.values[inside]) < 0.8 * np.nanstd(plain.values[inside])


def test_presets_can_be_changed_parameter_by_parameter():
    balanced = ep.StereoMatcher(preset="balanced").parameters
    assert balanced["method"] == "sgm"
    assert balanced["paths"] == 3
    changed = ep.StereoMatcher(preset="balanced", left_right_max_diff=None, paths=4).parameters
    assert changed == {**balanced, "left_right_max_diff": None, "paths": 4}
    # What a matcher reports makes the same matcher.
    assert ep.StereoMatcher(**changed).parameters == changed


def test_defaults_belong_to_the_method():
    assert ep.StereoMatcher().parameters["block_size"] == 15
    assert ep.StereoMatcher(method="sgm").parameters["block_size"] == 3
    signature = inspect.signature(ep.StereoMatcher)
    assert set(signature.parameters) == {"preset", "regions", "geometry", *ep.StereoMatcher().parameters}


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"method": "sgm", "block_size": 17}, "block_size = 17 px"),
        ({"method": "sgm", "paths": 2}, "paths = 2"),
        ({"method": "sgm", "p1": 90, "p2": 80}, "p2 = 80"),
        ({"method": "graph cuts"}, "method = 'graph cuts'"),
        ({"preset": "best"}, "preset = 'best'"),
    ],
)
def test_wrong_parameters_are_refused_by_name(parameters, message):
    with pytest.raises(ValueError, match=message):
        ep.StereoMatcher(**parameters)
    with pytest.raises(TypeError, match="unexpected keyword argument 'windw'"):
        ep.StereoMatcher(windw=3)


def test_accurate_beats_the_best_peer_on_teddy(data: Path):
    cv2 = pytest.importorskip("cv2")
    from epiline.evaluation import evaluate, load_scenes

    scene = next(s for s in load_scenes(data) if s.name == "middlebury2003/teddy")
    ours = ep.match(scene.left, scene.right, preset="accurate", num_disparities=64, fill=True)
    left, right = (
        cv2.copyMakeBorder(cv2.cvtColor(i, cv2.COLOR_BGR2GRAY), 0, 0, 64, 0, cv2.BORDER_REPLICATE)
        for i in (scene.left, scene.right)
    )
    peer = cv2.StereoSGBM_create(0, 64, 5, 200, 800, 1, 31, 10, 100, 2, cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    theirs = peer.compute(left, right)[:, 64:] / 16.0
    assert (
        evaluate(ours, scene.truth, scene.non_occluded).bad2_total
        < evaluate(theirs, scene.truth, scene.non_occluded).bad2_total
    )
