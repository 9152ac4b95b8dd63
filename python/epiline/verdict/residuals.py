"""Where a calibration puts the corners, against where they were seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline._core import StereoCalibration
from epiline.targets import Observations
from epiline.verdict.rig import Rig

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ViewErrors:
    """One accepted pair.

    Attributes
    ----------
    name : str
    left_px, right_px : (N, 2) float64
        The corners seen.
    left_off_px, right_off_px : (N, 2) float64
        Seen minus predicted.
    vertical_px : (N,) float64
        Vertical disparity after rectification, pixels of the aligned pair.
    raw_vertical_px : (N,) float64
        The same in the photographs as taken.
    """

    name: str
    left_px: Floats
    right_px: Floats
    left_off_px: Floats
    right_off_px: Floats
    vertical_px: Floats
    raw_vertical_px: Floats


def view_errors(calibration: StereoCalibration, observations: Observations) -> list[ViewErrors]:
    """Errors of each accepted pair; empty if the calibration was not made from these observations."""
    accepted = observations.accepted
    if len(calibration.views) < len(accepted):
        return []
    rig = Rig.of(calibration)
    sides = zip(observations.left_px, observations.right_px, observations.board_m, strict=True)
    result = []
    # Views of one camera alone come after the pairs.
    for view, pose, (left, right, board_m) in zip(accepted, calibration.views, sides, strict=False):
        in_left = board_m @ pose.rotation.T + pose.translation_m
        in_right = in_left @ calibration.rotation.T + calibration.translation_m
        result.append(
            ViewErrors(
                view.name,
                left,
                right,
                left - calibration.left.project(in_left),
                right - calibration.right.project(in_right),
                rig.vertical_px(left, right),
                left[:, 1] - right[:, 1],
            )
        )
    return result
