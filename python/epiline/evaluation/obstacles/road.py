"""Obstacles on KITTI's streets against the laser's truth.

The ground is taken from the truth itself. A band of columns is *asked for* where the laser sees something stand: the
nearest surface of enough pixels between 0.3 and 2 m over the ground. It is found by an obstacle that covers it at that
depth; one that is part of something that recedes may be nearer. A report is judged where the laser looked: it is
*false* if hardly any of the laser's pixels in its box stand and lie at its depth.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from epiline._core import DisparityMap, GroundEstimator, GroundPlane, Obstacle, RectifiedGeometry, find_obstacles
from epiline.evaluation.obstacles.columns import nearest_supported_px
from epiline.evaluation.obstacles.truth import SUPPORT_PX, Floats

# Columns of a band: the laser's rows are too far apart for single columns.
_BAND_PX = 8
# What is asked for: heights over the ground, and depths.
_LOW_M, _HIGH_M, _FAR_M = 0.3, 2.0, 25.0
# Depths that agree: a report may be nearer than a band, of which it is the nearest part, but hardly farther.
_NEARER, _FARTHER = 0.7, 1.1
# What stands at all, and the share of the laser's pixels in a box that must stand at its depth.
_STANDS_M, _SAME_DEPTH, _SHARE = 0.04, 0.15, 0.1


@dataclass(frozen=True)
class RoadScore:
    """One frame, or several added up.

    Attributes
    ----------
    asked, found : int
        Bands.
    judged, false : int
        Reports up to 25 m where the laser looked.
    grounds : int
        Frames with a ground of their own.
    """

    asked: int = 0
    found: int = 0
    judged: int = 0
    false: int = 0
    grounds: int = 0

    def __add__(self, other: RoadScore) -> RoadScore:
        return RoadScore(*(one + another for one, another in zip(astuple(self), astuple(other), strict=True)))

    def figures(self) -> dict[str, float]:
        """Percentages of bands and reports, and the counts they are of."""
        return {
            "bands": self.asked,
            "found": 100 * self.found / max(self.asked, 1),
            "reports": self.judged,
            "false": 100 * self.false / max(self.judged, 1),
            "grounds": self.grounds,
        }


def compare_road(disparity: DisparityMap, truth: Floats, geometry: RectifiedGeometry) -> RoadScore:
    """Obstacles of a map against a truth (H, W), px, NaN where unknown; nothing is asked where that has no ground."""
    true_ground = _ground_of(truth, geometry)
    if true_ground is None:
        return RoadScore()
    ground = GroundEstimator()(disparity, geometry)
    obstacles = [o for o in find_obstacles(disparity, geometry, ground=ground) if o.depth_m <= _FAR_M]
    height_m = _heights(truth, true_ground)
    depth_m = geometry.focal_px * geometry.baseline_m / truth
    asked = _nearest_standing_m(truth, height_m, geometry)
    found = sum(_is_found(band, z, obstacles) for band, z in asked)
    judged = [real for o in obstacles if (real := _is_real(o, height_m, depth_m)) is not None]
    return RoadScore(len(asked), found, len(judged), judged.count(False), int(ground is not None))


def _ground_of(truth: Floats, geometry: RectifiedGeometry) -> GroundPlane | None:
    known = np.isfinite(truth)
    raw = np.where(known, np.round(16 * np.nan_to_num(truth)), 0).astype(np.uint16)
    no_source = np.uint8(2)
    return GroundEstimator()(DisparityMap(raw, np.where(known, np.uint8(0), no_source)), geometry)


def _heights(truth: Floats, ground: GroundPlane) -> Floats:
    """(H, W), metres over the ground; NaN where unknown."""
    height_m = np.full(truth.shape, np.nan)
    for y, x in zip(*np.nonzero(np.isfinite(truth)), strict=True):
        height_m[y, x] = ground.height_m(float(x), float(y), float(truth[y, x]))
    return height_m


def _nearest_standing_m(truth: Floats, height_m: Floats, geometry: RectifiedGeometry) -> list[tuple[int, float]]:
    """First column and depth of each band where something stands."""
    stands = np.where((height_m > _LOW_M) & (height_m < _HIGH_M), truth, np.nan)
    asked = []
    for first in range(0, truth.shape[1] - _BAND_PX + 1, _BAND_PX):
        values = np.asarray(stands[:, first : first + _BAND_PX].reshape(-1, 1), np.float32)
        nearest_px = float(nearest_supported_px(values)[0])
        if nearest_px * _FAR_M >= geometry.focal_px * geometry.baseline_m:
            asked.append((first, geometry.focal_px * geometry.baseline_m / nearest_px))
    return asked


def _is_found(first: int, depth_m: float, obstacles: list[Obstacle]) -> bool:
    middle = first + _BAND_PX // 2
    return any(
        o.box[0] <= middle < o.box[0] + o.box[2] and _NEARER * depth_m <= o.depth_m <= _FARTHER * depth_m
        for o in obstacles
    )


def _is_real(obstacle: Obstacle, height_m: Floats, depth_m: Floats) -> bool | None:
    """`None` where the laser has too few pixels in the box."""
    x, y, width, height = obstacle.box
    window = np.s_[y : y + height, x : x + width]
    known = int(np.isfinite(height_m[window]).sum())
    if known < SUPPORT_PX:
        return None
    with np.errstate(invalid="ignore"):
        at_depth = np.abs(depth_m[window] / obstacle.depth_m - 1) < _SAME_DEPTH
        stands = height_m[window] > _STANDS_M
    return int((at_depth & stands).sum()) >= max(SUPPORT_PX // 2, _SHARE * known)
