"""Who runs: our matcher and OpenCV's, each reduced to one call that computes and one that shows the answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epiline._core import DisparityMap, Region, StereoMatcher
from epiline.benchmarking.pairs import Pair

Answer = NDArray[np.float32]
"""(H, W) disparity, px, NaN where there is none."""

# The tests OpenCV has too; each at the value of its samples.
_TESTS: dict[str, Any] = {
    "uniqueness_ratio": 10,
    "texture_threshold": 10,
    "left_right_max_diff": 1,
    "speckle_size": 100,
    "speckle_range": 2,
}
_NO_TESTS: dict[str, Any] = {
    "uniqueness_ratio": 0,
    "texture_threshold": 0,
    "left_right_max_diff": None,
    "speckle_size": 0,
}
SGBM_MODES = ("3WAY", "5-path", "HH")
SGBM_WINDOW = 5


@dataclass(frozen=True)
class Contestant:
    """One matcher on one pair; `work` is what is timed."""

    name: str
    work: Callable[[], object]
    answer: Callable[[], Answer]


def ours(name: str, pair: Pair, threads: int, **parameters: Any) -> Contestant:
    """Our matcher; its map is made once, as in a stream."""
    matcher = StereoMatcher(threads=threads, **parameters)

    made: list[DisparityMap] = []

    def work() -> None:
        made[:] = [matcher(pair.left, pair.right, out=made[0] if made else None)]

    def answer() -> Answer:
        if not made:
            work()
        return made[0].values

    return Contestant(name, work, answer)


def sad(
    pair: Pair,
    disparities: int,
    window: int,
    threads: int,
    *,
    tests: bool,
    regions: Sequence[Region] | None = None,
) -> Contestant:
    """Window sums as in `cv2.StereoBM`, with its tests or none; the whole image, or these regions of it."""
    chosen = {**(_TESTS if tests else _NO_TESTS), "num_disparities": disparities, "block_size": window}
    return ours(f"sad, window {window}", pair, threads, method="sad", regions=regions, **chosen)


def method(name: str, pair: Pair, disparities: int, threads: int, *, tests: bool) -> Contestant:
    """A method with its own window, with the tests of `cv2.StereoBM` or none."""
    chosen = {**(_TESTS if tests else _NO_TESTS), "method": name, "num_disparities": disparities}
    window = StereoMatcher(**chosen).parameters["block_size"]
    return ours(f"{name}, window {window}", pair, threads, **chosen)


def preset(name: str, pair: Pair, disparities: int, threads: int, *, tests: bool) -> Contestant:
    """A preset as it is, `accurate` filled, or with every test taken away."""
    filled = name == "accurate" and tests
    chosen: dict[str, Any] = {"fill": filled} if tests else _NO_TESTS
    label = f"{name}, filled" if filled else name
    return ours(label, pair, threads, preset=name, num_disparities=disparities, **chosen)


def stereo_bm(pair: Pair, disparities: int, window: int, *, tests: bool) -> Contestant:
    """`cv2.StereoBM` over the same prefilter."""
    import cv2

    matcher = cv2.StereoBM.create(disparities, window)
    matcher.setPreFilterType(cv2.StereoBM_PREFILTER_XSOBEL)
    matcher.setPreFilterCap(31)
    matcher.setUniquenessRatio(10 if tests else 0)
    matcher.setTextureThreshold(10 if tests else 0)
    matcher.setDisp12MaxDiff(1 if tests else -1)
    matcher.setSpeckleWindowSize(100 if tests else 0)
    # StereoBM counts it in sixteenths, StereoSGBM in whole pixels.
    matcher.setSpeckleRange(2 * 16)
    return _opencv("StereoBM", matcher, pair, 0)


def stereo_sgbm(mode: str, pair: Pair, disparities: int, *, tests: bool, padded: bool) -> Contestant:
    """`cv2.StereoSGBM` with the penalties of its documentation.

    As users call it, it leaves the left `disparities` columns without an answer; `padded` on the left it answers
    what we answer.
    """
    import cv2

    modes = {
        "3WAY": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        "5-path": cv2.STEREO_SGBM_MODE_SGBM,
        "HH": cv2.STEREO_SGBM_MODE_HH,
    }
    area = SGBM_WINDOW * SGBM_WINDOW
    checks = (1, 31, 10, 100, 2) if tests else (-1, 31, 0, 0, 2)
    matcher = cv2.StereoSGBM.create(0, disparities, SGBM_WINDOW, 8 * area, 32 * area, *checks, modes[mode])
    return _opencv(f"SGBM {mode}{' padded' if padded else ''}", matcher, pair, disparities if padded else 0)


def _opencv(name: str, matcher: Any, pair: Pair, padding: int) -> Contestant:
    import cv2

    left, right = (
        cv2.copyMakeBorder(image, 0, 0, padding, 0, cv2.BORDER_REPLICATE) for image in (pair.left, pair.right)
    )
    last: list[NDArray[np.int16]] = []

    def work() -> None:
        last[:] = [matcher.compute(left, right)]

    def answer() -> Answer:
        raw = last[0][:, padding:]
        values: Answer = raw.astype(np.float32) / np.float32(16)
        values[raw < 0] = np.nan
        return values

    return Contestant(name, work, answer)
