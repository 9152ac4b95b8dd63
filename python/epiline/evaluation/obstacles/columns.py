"""The nearest return of every column of an image against ground truth: too near, or missed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline._core import DisparityMap, RectifiedGeometry, Region, StereoMatcher, grey, profile, scan
from epiline.evaluation.obstacles.truth import SUPPORT_PX, seen_by_both
from epiline.evaluation.scenes import Scene

Disparity: TypeAlias = NDArray[np.float32]
Columns: TypeAlias = NDArray[np.float32]

# Pixels of one surface lie within this of each other, and a return within twice that of the truth is right, px.
SURFACE_PX, OFF_PX = 1.0, 2.0
_BASELINE_M, _FAR_M = 0.1, 1000.0


@dataclass(frozen=True)
class ColumnScore:
    """Shares of the columns that have a true nearest surface, percent.

    Attributes
    ----------
    false_near : float
        A return more than `OFF_PX` nearer than the nearest surface.
    nothing_there : float
        The part of `false_near` where not one pixel of the truth is as near: the others are of things that show
        fewer than `SUPPORT_PX` pixels in the column.
    missed : float
        A return that much farther than the nearest surface, or none.
    missed_seen : float
        The same, of the nearest surface that both cameras see.
    unknown : float
        The part of `missed_seen` without any return: it says nothing where the others say that it is farther.
    columns : int
    """

    false_near: float
    nothing_there: float
    missed: float
    missed_seen: float
    unknown: float
    columns: int


@dataclass(frozen=True)
class ColumnMethod:
    """A way to a nearest return per column: px, NaN where there is none."""

    name: str
    returns: Callable[[Scene], Columns]


def nearest_supported_px(values: Disparity, support: int = SUPPORT_PX) -> Columns:
    """(W,) the largest disparity of each column that `support` of its pixels lie within `SURFACE_PX` below.

    A support of 1 is the column's maximum: the nearest single pixel, as depthimage_to_laserscan takes it.
    """
    if values.shape[0] < support:
        return np.full(values.shape[1], np.nan, np.float32)
    ordered = -np.sort(-np.asarray(values, np.float32), axis=0)  # NaN sorts last
    last = ordered[support - 1 :]
    first = ordered[: len(last)]
    with np.errstate(invalid="ignore"):
        supported = first - last <= SURFACE_PX
    best = supported.argmax(axis=0)
    nearest: Columns = np.take_along_axis(first, best[None], axis=0)[0]
    nearest[~supported.any(axis=0)] = np.nan
    return nearest


def score_columns(returns: Columns, truth: Disparity) -> ColumnScore:
    """A return for each column against a truth (H, W), px, NaN where unknown."""
    nearest, any_nearest = nearest_supported_px(truth), nearest_supported_px(truth, 1)
    seen = np.where(seen_by_both(np.nan_to_num(truth, nan=-1.0), np.ones(truth.shape, bool)), truth, np.nan)
    nearest_seen = nearest_supported_px(seen)
    with np.errstate(invalid="ignore"):
        too_near = returns > nearest + OFF_PX
        nothing_there = returns > any_nearest + OFF_PX
        missed = ~(returns >= nearest - OFF_PX)
        missed_seen = ~(returns >= nearest_seen - OFF_PX)
    known, known_seen = np.isfinite(nearest), np.isfinite(nearest_seen)
    return ColumnScore(
        false_near=_percent(too_near[known]),
        nothing_there=_percent(nothing_there[known]),
        missed=_percent(missed[known]),
        missed_seen=_percent(missed_seen[known_seen]),
        unknown=_percent(np.isnan(returns[known_seen])),
        columns=int(known.sum()),
    )


def column_methods(presets: tuple[str, ...], threads: int | None) -> list[ColumnMethod]:
    """OpenCV's StereoBM, and our presets, each by its column minimum and by supported u-disparity."""
    methods = []
    for padded in (False, True):
        name = f"StereoBM{' padded' if padded else ''}"
        methods += [
            ColumnMethod(f"{name}, column minimum", _of_stereo_bm(padded, 1)),
            ColumnMethod(f"{name}, u-disparity", _of_stereo_bm(padded, SUPPORT_PX)),
        ]
    for preset in presets:
        matcher = {"preset": preset, "threads": threads}
        methods += [
            ColumnMethod(f"{preset}, column minimum", _of_ours(matcher, _column_minimum)),
            ColumnMethod(f"{preset}, u-disparity", _of_ours(matcher, _u_disparity)),
            ColumnMethod(f"{preset}, profile", _of_ours(matcher, _profile)),
            ColumnMethod(f"{preset}, scan", _of_ours(matcher, _scan)),
        ]
    return methods


def _of_stereo_bm(padded: bool, support: int) -> Callable[[Scene], Columns]:
    """`cv2.StereoBM` with its defaults; padded on the left it answers the left border too."""

    def returns(scene: Scene) -> Columns:
        import cv2

        cv2.setNumThreads(1)
        matcher = cv2.StereoBM.create(scene.num_disparities)
        width = scene.num_disparities if padded else 0
        images = [cv2.copyMakeBorder(grey(i), 0, 0, width, 0, cv2.BORDER_REPLICATE) for i in (scene.left, scene.right)]
        raw = matcher.compute(*images)[:, width:]
        values = np.where(raw < 0, np.float32(np.nan), raw.astype(np.float32) / np.float32(16))
        return nearest_supported_px(values, support)

    return returns


def _of_ours(matcher: dict[str, Any], reduce: Callable[[DisparityMap], Columns]) -> Callable[[Scene], Columns]:
    def returns(scene: Scene) -> Columns:
        found = StereoMatcher(num_disparities=scene.num_disparities, **matcher)(scene.left, scene.right)
        return reduce(found)

    return returns


def _column_minimum(disparity: DisparityMap) -> Columns:
    return nearest_supported_px(disparity.values, 1)


def _u_disparity(disparity: DisparityMap) -> Columns:
    return nearest_supported_px(disparity.values, SUPPORT_PX)


def _profile(disparity: DisparityMap) -> Columns:
    height, width = disparity.shape
    (found,) = profile(disparity, [Region("image", x=0, y=0, width=width, height=height)], min_support=SUPPORT_PX)
    return found.nearest_px


def _scan(disparity: DisparityMap) -> Columns:
    """The scan without a ground: of a level camera its directions are the columns, from right to left."""
    height, width = disparity.shape
    # Any camera sees the same disparities; this one has no blind zone and no horizon within its reach.
    geometry = RectifiedGeometry(
        width=width,
        height=height,
        focal_px=width,
        cx_px=(width - 1) / 2,
        cy_px=(height - 1) / 2,
        baseline_m=_BASELINE_M,
    )
    found = scan(disparity, geometry, min_support=SUPPORT_PX, max_range_m=_FAR_M)
    depth_m = found.nearest_m * np.cos(found.angle_rad)
    return np.asarray(width * _BASELINE_M / depth_m, np.float32)[::-1]


def _percent(flags: NDArray[np.bool_]) -> float:
    return 100 * float(flags.mean()) if flags.size else float("nan")
