"""Nearest ranges of regions of KITTI's frames against the laser's truth.

The truth covers a fifth of the pixels: where the map's nearest surface has none on it, nothing can be said, and the
region is left out. The laser's truth and the images do not quite agree: of all ten public frames OpenCV's SGBM and our
matchers alike answer about half a pixel less than it at 20 m. So every error is given as it is, and once more after the
frame's median difference between map and truth is taken from the disparity, as a calibration of the pair would.

The laser's truth scatters by 0.17 to 0.34 px about the planes that it shows, frame by frame, 1 % of its points by more
than 0.8 px: the nearest of a thousand points is a few percent too near. So the truth is read as the map is: the range
that as many of its points reach as make a surface. Where the map has few answers on the true nearest surface it is
blind to it, and the error is what stands behind: every error is given with and without such regions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline._core import DisparityMap, RectifiedGeometry, Region, RegionProfile, paper_regions, profile
from epiline.evaluation.obstacles.scoring import RangeSample
from epiline.evaluation.obstacles.truth import SUPPORT_PX, Floats
from epiline.evaluation.scenes import Scene
from epiline.sources.rendered import nearest_supported
from epiline.sources.rendered.truth import SURFACE_DEPTH_SHARE

# KITTI 2015, colour cameras; the errors are relative, so no frame's own differs enough to matter.
_FOCAL_PX, _BASELINE_M = 721.54, 0.5327
# Pixels of truth that make a surface.
_TRUE_SUPPORT_PX = 30
# Of the points of the true nearest surface, at least this share must have an answer, or the map is blind to it.
_SEEN_SHARE = 0.5
# How far about a place its surface is looked at, and how far its disparities may be from the place's, px.
_ABOUT_PX, _SURFACE_PX = 8, 1.0
# Larger differences between map and truth are mismatches, not the pair's offset, px.
_MATCHED_PX = 3.0


@dataclass(frozen=True)
class FrameRanges:
    """One frame.

    Attributes
    ----------
    samples, without_offset : list of RangeSample
        As measured, and with the pair's offset taken out.
    seen : list of bool
        For each of them, whether the map answers on the true nearest surface.
    silent : int
        Regions with a truth but without an answer.
    left_out : int
        Regions whose nearest surface has no truth on it.
    offset_px : float
        Median of map minus truth.
    """

    samples: list[RangeSample]
    without_offset: list[RangeSample]
    seen: list[bool]
    silent: int
    left_out: int
    offset_px: float


def region_boxes(width: int, height: int) -> Iterator[Region]:
    """The paper's bands, whole and in thirds."""
    for band in paper_regions(width, height):
        yield band
        for third in range(3):
            x = band.x + third * band.width // 3
            yield Region(f"{band.name}/{third}", x=x, y=band.y, width=band.width // 3, height=band.height)


def kitti_geometry(scene: Scene) -> RectifiedGeometry:
    """That of a frame of KITTI 2015."""
    height, width = scene.truth.shape
    return RectifiedGeometry(
        width=width,
        height=height,
        focal_px=_FOCAL_PX,
        cx_px=(width - 1) / 2,
        cy_px=(height - 1) / 2,
        baseline_m=_BASELINE_M,
    )


def compare(disparity: DisparityMap, truth: Floats, geometry: RectifiedGeometry) -> FrameRanges:
    """The regions of a map against a truth (H, W), px, NaN where unknown."""
    height, width = truth.shape
    off = disparity.values - truth
    matched = np.abs(off) < _MATCHED_PX
    offset_px = float(np.median(off[matched])) if matched.any() else float("nan")
    true_m = _range_m(truth, geometry)
    samples, without_offset, seen, silent, left_out = [], [], [], 0, 0
    for found in profile(disparity, list(region_boxes(width, height)), geometry=geometry):
        inside = true_m[_window(found.region)]
        nearest_m = range_reached(inside, _TRUE_SUPPORT_PX)
        if not np.isfinite(nearest_m):
            continue
        if found.nearest_at is None or not np.isfinite(found.range_m):
            silent += 1
        elif not _has_truth(found, disparity.values, truth):
            left_out += 1
        else:
            name = found.region.name
            scale = found.nearest_disparity_px / (found.nearest_disparity_px - offset_px)
            samples.append(RangeSample(name, found.range_m, nearest_m, found.sigma_m))
            without_offset.append(RangeSample(name, found.range_m * scale, nearest_m, found.sigma_m))
            answers = np.isfinite(disparity.values[_window(found.region)][_on_nearest(inside)])
            seen.append(bool(answers.mean() >= _SEEN_SHARE))
    return FrameRanges(samples, without_offset, seen, silent, left_out, offset_px)


def range_reached(ranges_m: Floats, count: int) -> float:
    """The range that `count` points of the nearest supported surface are at least as near as; NaN without one."""
    first = nearest_supported(ranges_m, count)
    behind = np.sort(ranges_m[ranges_m >= first])
    return float(behind[count - 1]) if behind.size else float("nan")


def _on_nearest(ranges_m: Floats) -> NDArray[np.bool_]:
    first = nearest_supported(ranges_m, _TRUE_SUPPORT_PX)
    return np.asarray((ranges_m >= first) & (ranges_m <= first * (1 + SURFACE_DEPTH_SHARE)))


def _range_m(disparity_px: Floats, geometry: RectifiedGeometry) -> Floats:
    height, width = disparity_px.shape
    x = (np.arange(width) - geometry.cx_px) / geometry.focal_px
    y = (np.arange(height) - geometry.cy_px)[:, None] / geometry.focal_px
    depth_m = geometry.focal_px * geometry.baseline_m / disparity_px
    return np.asarray(depth_m * np.sqrt(1 + x * x + y * y), float)


def _has_truth(found: RegionProfile, values: NDArray[np.float32], truth: Floats) -> bool:
    """Whether enough pixels of the surface found, about its nearest place, have a truth."""
    assert found.nearest_at is not None
    x, y = found.nearest_at
    around = np.s_[max(y - _ABOUT_PX, 0) : y + _ABOUT_PX + 1, max(x - _ABOUT_PX, 0) : x + _ABOUT_PX + 1]
    surface = np.abs(values[around] - found.nearest_disparity_px) <= _SURFACE_PX
    return int((surface & np.isfinite(truth[around])).sum()) >= SUPPORT_PX


def _window(region: Region) -> tuple[slice, slice]:
    return np.s_[region.y : region.y + region.height, region.x : region.x + region.width]
