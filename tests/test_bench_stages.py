"""The contest of the stages before matching: every stage is there, and both sides give the same picture."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("cv2", reason="OpenCV is the peer")

from epiline.benchmarking import Plan
from epiline.benchmarking.pairs import Pair
from epiline.benchmarking.stages import stages


def test_every_stage_gives_the_picture_that_opencv_gives() -> None:
    random = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(240), np.arange(180))
    levels = 128 + 50 * np.sin(x / 7) * np.cos(y / 5) + random.normal(size=x.shape)
    pair = Pair(*(levels.round().astype(np.uint8) for _ in range(2)), "waves")
    plan = Plan(sizes=((160, 120, 16), (160, 120, 32)), repeats=3, budget_s=0.0)
    rows = list(stages("here", pair, plan))
    # One row a stage: a size counts once, however many disparities are asked for.
    assert [row.ours for row in rows] == ["equalize", "rectify, pair", "grey", "gaussian_low_pass"]
    for row in rows:
        assert row.check == "agree"
        assert row.checked > 0.99, row
        assert row.ratio > 0
        assert not row.differs
