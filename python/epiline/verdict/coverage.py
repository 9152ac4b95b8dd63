"""Which part of the picture, which tilts and which distances the boards have shown, and what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline._core import StereoCalibration
from epiline.targets import Observations

Floats = NDArray[np.float64]

_CELLS = 9
_COLUMN_NAMES, _ROW_NAMES = ("left", "middle", "right"), ("top", "middle", "bottom")
# An area of a third by a third of the picture counts as seen if corners lie in this share of its cells.
_SEEN_SHARE = 0.25
# A person can follow so many at a time.
_MAX_AREAS = 4
# A board turned by this much about an axis tells the focal length from the distance, seen along that axis.
_TILT_DEG = 15.0
_TILTED_VIEWS = 2
# Largest over smallest distance of the boards' centres.
_DISTANCE_RATIO = 1.25


@dataclass(frozen=True)
class Coverage:
    """What the views have shown.

    Attributes
    ----------
    share : (2,) tuple of float
        Share of the left and right picture that has corners nearby: of 9 x 9 cells.
    missing_areas : tuple of str
        Thirds of the pictures with hardly a corner, in words.
    tilts_about_x, tilts_about_y : int
        Views with the board turned about the horizontal and the vertical axis by 15 degrees or more.
    distance_ratio : float
        Of the farthest board to the nearest.
    """

    share: tuple[float, float]
    missing_areas: tuple[str, ...]
    tilts_about_x: int
    tilts_about_y: int
    distance_ratio: float

    def advice(self) -> tuple[str, ...]:
        """What to photograph next, most useful first; empty if nothing is missing."""
        wanted = []
        if self.tilts_about_y < _TILTED_VIEWS:
            wanted.append("turn the board to the left and to the right, by 30 degrees or more")
        if self.tilts_about_x < _TILTED_VIEWS:
            wanted.append("tip the board forward and backward, by 30 degrees or more")
        if self.missing_areas:
            wanted.append(f"bring the board to the {_listed(self.missing_areas[:_MAX_AREAS])}")
        if self.distance_ratio < _DISTANCE_RATIO:
            wanted.append("show the board nearer and farther: half and twice the distance")
        return tuple(wanted)


def coverage_of(calibration: StereoCalibration, observations: Observations) -> Coverage:
    """Measures the views of a calibration, which was made from these observations."""
    left_px, right_px = observations.left_px, observations.right_px
    size = calibration.image_size
    cells = {"left": occupied_cells(left_px, size), "right": occupied_cells(right_px, size)}
    missing = {side: _missing(seen) for side, seen in cells.items()}
    areas = [f"{area} of both pictures" for area in missing["left"] if area in missing["right"]]
    areas += [
        f"{area} of the {side} picture"
        for side, other in (("left", "right"), ("right", "left"))
        for area in missing[side]
        if area not in missing[other]
    ]
    tilts = np.array([_tilt_deg(view.rotation) for view in calibration.views]).reshape(-1, 2)
    middle_m = observations.board.points_m.mean(axis=0)
    distances = [float(np.linalg.norm(v.rotation @ middle_m + v.translation_m)) for v in calibration.views] or [1.0]
    return Coverage(
        (float(cells["left"].mean()), float(cells["right"].mean())),
        tuple(areas),
        int((np.abs(tilts[:, 0]) >= _TILT_DEG).sum()),
        int((np.abs(tilts[:, 1]) >= _TILT_DEG).sum()),
        max(distances) / max(min(distances), 1e-9),
    )


def occupied_cells(views_px: Sequence[Floats], size: tuple[int, int]) -> NDArray[np.bool_]:
    """(9, 9) bool: cells of the picture with a corner in them."""
    seen = np.zeros((_CELLS, _CELLS), np.bool_)
    for px in views_px:
        if len(px):
            at = np.floor((np.asarray(px) + 0.5) * _CELLS / np.array(size)).astype(int).clip(0, _CELLS - 1)
            seen[at[:, 1], at[:, 0]] = True
    return seen


def _missing(seen: NDArray[np.bool_]) -> list[str]:
    third = _CELLS // 3
    shares = seen.reshape(3, third, 3, third).mean(axis=(1, 3))
    return [
        "middle" if (row, column) == (1, 1) else f"{_ROW_NAMES[row]} {_COLUMN_NAMES[column]}"
        for row, column in np.argwhere(shares < _SEEN_SHARE)
    ]


def _tilt_deg(rotation: Floats) -> tuple[float, float]:
    """Turn of a board's normal about the camera's x and y axes, degrees."""
    x, y, z = rotation[:, 2]
    return float(np.degrees(np.arctan2(y, abs(z)))), float(np.degrees(np.arctan2(x, abs(z))))


def _listed(items: Sequence[str]) -> str:
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}"
