"""May this calibration be used? A grade, and the reasons in words."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from epiline._core import StereoCalibration

Grade = Literal["good", "usable", "do not use"]

# Vertical disparity of views the fit did not see. A quarter of a pixel is what ROS's tutorial asks of a good rig;
# makers of stereo cameras reject units somewhere between 0.6 and 1 px, where block matching starts to lose pixels.
_GOOD_EPIPOLAR_PX, _USABLE_EPIPOLAR_PX = 0.25, 0.6
# The baseline scales every range, so its relative uncertainty is a floor under theirs.
_GOOD_BASELINE_SHARE, _USABLE_BASELINE_SHARE = 0.005, 0.03
_GOOD_VIEWS, _USABLE_VIEWS = 8, 3
# A view far worse than the others holds a mis-found board.
_OUTLYING_VIEW = 4.0


@dataclass(frozen=True)
class Verdict:
    """A grade and why; ``reasons`` is empty only for a rig without remarks."""

    grade: Grade
    reasons: tuple[str, ...]

    def __str__(self) -> str:
        return self.grade + (": " + "; ".join(self.reasons) if self.reasons else "")


def judge(calibration: StereoCalibration) -> Verdict:
    """Grades a calibration by what it would do to ranges.

    Parameters
    ----------
    calibration : StereoCalibration

    Returns
    -------
    Verdict
        ``do not use`` if any figure rules the rig out, ``good`` if none gives cause for doubt.
    """
    doubts: list[str] = []
    bars: list[str] = []

    def grade(value: float, good: float, usable: float, text: str) -> None:
        if not value <= usable:
            bars.append(text)
        elif value > good:
            doubts.append(text)

    epipolar_px = calibration.epipolar_error_px
    if math.isnan(epipolar_px):
        doubts.append("no held-out epipolar error: nothing outside the fit confirms it")
    else:
        text = f"held-out epipolar error {epipolar_px:.2f} px (good is at most {_GOOD_EPIPOLAR_PX:g})"
        grade(epipolar_px, _GOOD_EPIPOLAR_PX, _USABLE_EPIPOLAR_PX, text)

    sigma = calibration.sigma
    if sigma:
        # The baseline's direction is almost x, so the sigma of T_x stands for its length.
        share = sigma["translation_x_m"] / calibration.baseline_m
        text = f"baseline known to {100 * share:.1f} % only (good is {100 * _GOOD_BASELINE_SHARE:g} %)"
        grade(share, _GOOD_BASELINE_SHARE, _USABLE_BASELINE_SHARE, text)

    views = calibration.views
    if views:
        text = f"{len(views)} views (good is at least {_GOOD_VIEWS})"
        grade(-len(views), -_GOOD_VIEWS, -_USABLE_VIEWS, text)
        rms = [max(view.left_rms_px, view.right_rms_px) for view in views]
        typical = sorted(rms)[len(rms) // 2]
        outlying = [str(i + 1) for i, value in enumerate(rms) if value > _OUTLYING_VIEW * typical]
        if outlying:
            doubts.append(f"view {', '.join(outlying)} fits {_OUTLYING_VIEW:g} times worse than the others: look at it")

    worst: Grade = "do not use" if bars else "usable" if doubts else "good"
    return Verdict(worst, tuple(bars + doubts))
