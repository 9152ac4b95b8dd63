"""Scaling curves: what a pixel and disparity costs as the image, the search range or the window grows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TypeAlias

import numpy as np

from epiline.benchmarking import contestants as run
from epiline.benchmarking.contestants import Contestant
from epiline.benchmarking.contests import Curve, Plan
from epiline.benchmarking.pairs import Pair
from epiline.benchmarking.rounds import ratio, time_in_turns

Point: TypeAlias = tuple[int, int, int, int]
"""Width, height, disparities, window, px."""
Opponents: TypeAlias = Callable[[Pair, Point], tuple[Contestant, Contestant]]

# Each curve varies one thing from the same middle.
_HEIGHT, _WIDTH, _DISPARITIES, _WINDOW = 360, 640, 64, 15
CURVES: dict[str, tuple[tuple[int, Point], ...]] = {
    "width": tuple((w, (w, _HEIGHT, _DISPARITIES, _WINDOW)) for w in (160, 320, 640, 1280, 1920, 2560)),
    "disparities": tuple((d, (_WIDTH, _HEIGHT, d, _WINDOW)) for d in (16, 32, 48, 64, 96, 128, 192, 256)),
    "window": tuple((w, (_WIDTH, _HEIGHT, _DISPARITIES, w)) for w in (5, 9, 15, 21, 25, 31)),
}


def curves(level: str, pair: Pair, plan: Plan) -> Iterator[Curve]:
    """Every point of every curve: `sad` without tests against StereoBM, `balanced` against SGBM 3WAY; one thread."""
    import cv2

    cv2.setNumThreads(1)
    for along, points in CURVES.items():
        yield from _curve(level, pair, plan, along, points, _block_matching)
        if along != "window":
            yield from _curve(level, pair, plan, along, points, _semi_global)


def _curve(
    level: str, pair: Pair, plan: Plan, along: str, points: tuple[tuple[int, Point], ...], opponents: Opponents
) -> Iterator[Curve]:
    first = float("nan")
    for at, point in points:
        width, height, disparities, _ = point
        mine, theirs = opponents(pair.resized(width, height), point)
        times = time_in_turns((mine, theirs), plan.repeats, plan.budget_s, one_thread=True)
        cost = float(np.median(times[:, 0])) / (width * height * disparities)
        first = cost if np.isnan(first) else first
        yield Curve(
            level=level,
            # The window is what varies in one of them, so the name must not say it.
            ours=mine.name.split(",")[0],
            theirs=theirs.name,
            along=along,
            at=at,
            per_pixel_disparity=round(cost / first, 3),
            ratio=round(ratio(times[:, 1], times[:, 0]).median, 3),
        )


def _block_matching(pair: Pair, point: Point) -> tuple[Contestant, Contestant]:
    _, _, disparities, window = point
    return (
        run.sad(pair, disparities, window, 1, tests=False),
        run.stereo_bm(pair, disparities, window, tests=False),
    )


def _semi_global(pair: Pair, point: Point) -> tuple[Contestant, Contestant]:
    disparities = point[2]
    return (
        run.preset("balanced", pair, disparities, 1, tests=True),
        run.stereo_sgbm("3WAY", pair, disparities, tests=True, padded=False),
    )
