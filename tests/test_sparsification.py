"""Sparsification against its definition, and the matcher's confidence against ground truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import epiline as ep
from epiline.evaluation import load_scenes, sparsification


def test_curves_are_means_of_what_is_kept() -> None:
    random = np.random.default_rng(1)
    truth = random.uniform(5, 60, (20, 31))
    error = random.exponential(2.0, truth.shape)
    trust = random.permutation(truth.size).reshape(truth.shape).astype(float)
    curve = sparsification(truth + error, trust, truth, steps=10)
    order = np.argsort(-trust, axis=None)
    for density, actual, oracle in zip(curve.density, curve.error, curve.oracle_error, strict=True):
        kept = round(density * truth.size)
        assert actual == pytest.approx(error.ravel()[order[:kept]].mean())
        assert oracle == pytest.approx(np.sort(error, axis=None)[:kept].mean())
    assert curve.area == pytest.approx(curve.error.mean())
    assert curve.ratio == pytest.approx(curve.area / curve.oracle_area)
    assert curve.error[-1] == pytest.approx(curve.oracle_error[-1]) == pytest.approx(error.mean())


def test_the_error_itself_is_the_best_confidence_and_a_constant_tells_nothing() -> None:
    random = np.random.default_rng(2)
    truth = random.uniform(5, 60, (40, 50))
    values = truth + random.exponential(1.0, truth.shape)
    assert sparsification(values, -np.abs(values - truth), truth).ratio == pytest.approx(1)
    constant = sparsification(values, np.ones_like(truth), truth)
    np.testing.assert_allclose(constant.error, np.abs(values - truth).mean())
    wrong_way = sparsification(values, np.abs(values - truth), truth)
    assert wrong_way.area > constant.area


def test_bad_pixels_masks_and_missing_values() -> None:
    truth = np.array([[10.0, 10, 10, 10, np.nan, 10]])
    values = np.array([[10.0, 12, 10.5, np.nan, 10, 20]])
    trust = np.array([[0.9, np.nan, 0.8, 0.1, 0.5, 0.7]])
    mask = np.array([[True, True, True, True, True, False]])
    curve = sparsification(values, trust, truth, mask, bad_px=1.0, steps=3)
    assert curve.pixels == 3
    np.testing.assert_allclose(curve.error, [0, 0, 1 / 3])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"confidence": np.ones((2, 3))}, r"disp is \(2, 2\) but confidence is \(2, 3\)"),
        ({"truth": np.ones((1, 2))}, r"disp is \(2, 2\) but truth is \(1, 2\)"),
        ({"mask": np.zeros((2, 2), bool)}, r"no pixel has a disparity and a known truth"),
        ({"steps": 0}, r"steps = 0: must be at least 1"),
        ({"confidence": None}, r"confidence = None: only a DisparityMap brings its own"),
    ],
)
def test_what_cannot_be_scored_is_named(change: dict[str, Any], message: str) -> None:
    given: dict[str, Any] = {"disp": np.ones((2, 2)), "confidence": np.ones((2, 2)), "truth": np.ones((2, 2)), **change}
    with pytest.raises(ValueError, match=message):
        sparsification(**given)


def test_confidence_is_a_number_where_there_is_a_value_and_only_there() -> None:
    random = np.random.default_rng(3)
    left = random.integers(0, 256, (60, 120), np.uint8)
    disp = ep.match(left, np.roll(left, -5, 1), num_disparities=16, block_size=5, left_right_max_diff=0)
    confidence = disp.confidence
    assert confidence.dtype == np.float32
    assert confidence.shape == (60, 120)
    np.testing.assert_array_equal(np.isnan(confidence), np.isnan(disp.values))
    answered = confidence[np.isfinite(confidence)]
    assert 0 <= answered.min() < answered.max() <= 1


@pytest.mark.parametrize("preset", ["fast", "balanced", "accurate"])
def test_confidence_predicts_error_on_a_real_scene(data: Path, preset: Any) -> None:
    scene = next(scene for scene in load_scenes(data) if scene.name == "middlebury2003/teddy")
    disp = ep.match(scene.left, scene.right, preset=preset, num_disparities=scene.num_disparities)
    curve = sparsification(disp, None, scene.truth, scene.non_occluded)
    assert curve.ratio < 3
    assert curve.area < 0.75 * curve.error[-1]  # a constant confidence has the area error[-1]
