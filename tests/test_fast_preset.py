"""Window sums guided by coarse costs, and the preset made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import epiline as ep


@pytest.fixture(scope="module")
def blank_wall() -> tuple[np.ndarray, np.ndarray]:
    """A plane at 6 px whose texture is a fine noise, but for a blank stripe of 24 columns."""
    rng = np.random.default_rng(11)
    left = rng.integers(0, 256, (80, 200), dtype=np.uint8)
    left[:, 100:124] = 90
    return left, np.roll(left, -6, axis=1)


def test_coarse_costs_carry_the_surroundings_across_what_a_window_cannot_see(blank_wall):
    settings = {"num_disparities": 32, "block_size": 7, "threads": 1}
    inside = np.s_[20:60, 106:118]  # no window around these reaches the texture
    alone = ep.match(*blank_wall, **settings).values[inside]
    guided = ep.match(*blank_wall, **settings, coarse_weight=5).values[inside]
    assert np.mean(np.abs(guided - 6) <= 1) > 0.9 > 0.5 > np.mean(np.abs(alone - 6) <= 1)


def test_the_preset_uses_them_and_semi_global_matching_ignores_them(blank_wall):
    assert ep.StereoMatcher(preset="fast").parameters["coarse_weight"] > 0
    plain, weighted = (ep.match(*blank_wall, method="sgm", num_disparities=32, coarse_weight=w) for w in (0, 5))
    np.testing.assert_array_equal(plain.raw, weighted.raw)


def test_a_weight_outside_its_range_is_refused_by_name():
    with pytest.raises(ValueError, match="coarse_weight = 26 %"):
        ep.StereoMatcher(coarse_weight=26)


def test_fast_answers_more_with_fewer_errors_than_windows_alone(data: Path):
    from epiline.evaluation import evaluate, load_scenes

    for scene in load_scenes(data):
        if scene.name not in ("kitti2015/000007_10", "middlebury2003/cones"):
            continue
        fast, alone = (
            evaluate(
                ep.match(scene.left, scene.right, preset="fast", num_disparities=scene.num_disparities, **changed),
                scene.truth,
                scene.non_occluded,
            )
            for changed in ({}, {"coarse_weight": 0, "uniqueness_ratio": 3})
        )
        assert fast.density > alone.density, scene.name
        assert fast.bad2_total < alone.bad2_total, scene.name
