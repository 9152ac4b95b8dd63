"""May this calibration be used? A grade, the reasons in words, and what to photograph next."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from epiline.verdict.rig import vertical_sigma_px

if TYPE_CHECKING:
    from epiline._core import StereoCalibration
    from epiline.targets import Observations

__all__ = ["Grade", "Verdict", "judge", "vertical_sigma_px"]

Grade = Literal["good", "usable", "do not use"]

# Vertical disparity of views the fit did not see. A quarter of a pixel is what ROS's tutorial asks of a good rig;
# makers of stereo cameras reject units somewhere between 0.6 and 1 px, where block matching starts to lose pixels.
_GOOD_EPIPOLAR_PX, _USABLE_EPIPOLAR_PX = 0.25, 0.6
# The baseline scales every range, so its relative uncertainty is a floor under theirs.
_GOOD_BASELINE_SHARE, _USABLE_BASELINE_SHARE = 0.005, 0.03
_GOOD_VIEWS, _USABLE_VIEWS = 8, 3
# A view far worse than the others holds a mis-found board.
_OUTLYING_VIEW = 4.0
# Corners are found to tenths of a pixel; what is off by so much on the average does not follow the lens model.
_GOOD_RMS_PX, _USABLE_RMS_PX = 0.75, 2.0
# A lens is known only where there were corners: below these shares of the picture its border is extrapolated.
_GOOD_COVERAGE, _USABLE_COVERAGE = 0.4, 0.12
# Mean magnitude of a Gaussian of unit variance.
_MEAN_OF_GAUSSIAN = math.sqrt(2 / math.pi)
# Depths at which the uncertainty of the alignment is taken, in distances of the boards.
_DEPTHS = (1.0, 10.0)


@dataclass(frozen=True)
class Verdict:
    """A grade and why.

    Attributes
    ----------
    grade : {"good", "usable", "do not use"}
    reasons : tuple of str
        Empty only for a rig without remarks.
    photograph_next : tuple of str
        What further photographs should show, most useful first; empty if nothing is missing.
    """

    grade: Grade
    reasons: tuple[str, ...]
    photograph_next: tuple[str, ...] = ()

    def __str__(self) -> str:
        return self.grade + (": " + "; ".join(self.reasons) if self.reasons else "")


class _Reasons:
    """Collects reasons by how bad they are."""

    def __init__(self) -> None:
        self.bars: list[str] = []
        self.doubts: list[str] = []

    def grade(self, value: float, good: float, usable: float, text: str) -> None:
        if not value <= usable:
            self.bars.append(text)
        elif value > good:
            self.doubts.append(text)


def judge(calibration: StereoCalibration, observations: Observations | None = None) -> Verdict:
    """Grades a calibration by what it would do to ranges.

    Parameters
    ----------
    calibration : StereoCalibration
    observations : Observations, optional
        What it was made from: without them the coverage of the pictures, and some mistakes, are not judged.

    Returns
    -------
    Verdict
        ``do not use`` if any figure rules the rig out, ``good`` if none gives cause for doubt.
    """
    found = _Reasons()
    _judge_alignment(calibration, found)
    sigma = calibration.sigma
    if sigma:
        # The baseline's direction is almost x, so the sigma of T_x stands for its length.
        share = sigma["translation_x_m"] / calibration.baseline_m
        text = f"baseline known to {100 * share:.1f} % only (good is {100 * _GOOD_BASELINE_SHARE:g} %)"
        found.grade(share, _GOOD_BASELINE_SHARE, _USABLE_BASELINE_SHARE, text)
    _judge_views(calibration, found)
    from epiline.verdict.oddities import refocused, squeezed

    if text := squeezed(calibration):
        found.doubts.append(text)
    advice: tuple[str, ...] = ()
    if observations is not None:
        found.doubts += observations.remarks
        if text := refocused(calibration, observations):
            found.bars.append(text)
        _judge_lens(calibration, observations, found)
        advice = _judge_coverage(calibration, observations, found)
    worst: Grade = "do not use" if found.bars else "usable" if found.doubts else "good"
    return Verdict(worst, tuple(found.bars + found.doubts), advice)


def _judge_alignment(calibration: StereoCalibration, found: _Reasons) -> None:
    """What was measured on held-out views, and what the covariance says of the rest of the picture."""
    epipolar_px = calibration.epipolar_error_px
    if math.isnan(epipolar_px):
        found.doubts.append("no held-out epipolar error: nothing outside the fit confirms it")
    else:
        text = f"held-out epipolar error {epipolar_px:.2f} px (good is at most {_GOOD_EPIPOLAR_PX:g})"
        found.grade(epipolar_px, _GOOD_EPIPOLAR_PX, _USABLE_EPIPOLAR_PX, text)
    predicted_px = expected_misalignment_px(calibration)
    if math.isfinite(predicted_px):
        text = (
            f"rows may be off by {predicted_px:.2f} px on average over the whole picture, near and far, "
            f"by the uncertainty of the fit (good is at most {_GOOD_EPIPOLAR_PX:g})"
        )
        found.grade(predicted_px, _GOOD_EPIPOLAR_PX, _USABLE_EPIPOLAR_PX, text)


def expected_misalignment_px(calibration: StereoCalibration) -> float:
    """Mean vertical disparity to be expected over the picture, at the boards' distance and ten times it, px.

    From the covariance alone, so it speaks of places that no view has shown, too; the held-out error speaks of those
    that some have. NaN if the covariance or the views are not known.
    """
    if not calibration.views:
        return math.nan
    distance_m = float(np.median([np.linalg.norm(view.translation_m) for view in calibration.views]))
    sigma = np.concatenate([vertical_sigma_px(calibration, depth * distance_m).ravel() for depth in _DEPTHS])
    known = sigma[np.isfinite(sigma)]
    return _MEAN_OF_GAUSSIAN * float(known.mean()) if known.size else math.nan


def _judge_views(calibration: StereoCalibration, found: _Reasons) -> None:
    views = calibration.views
    if not views:
        return
    text = f"{len(views)} views (good is at least {_GOOD_VIEWS})"
    found.grade(-len(views), -_GOOD_VIEWS, -_USABLE_VIEWS, text)
    text = (
        f"corners miss their predictions by {calibration.rms_px:.1f} px rms: the lens model does not follow these "
        "lenses (very wide ones need another), or the board is not flat"
    )
    found.grade(calibration.rms_px, _GOOD_RMS_PX, _USABLE_RMS_PX, text)
    # NaN: a camera that did not see the board.
    rms = [float(np.fmax(view.left_rms_px, view.right_rms_px)) for view in views]
    typical = sorted(rms)[len(rms) // 2]
    outlying = [str(i + 1) for i, value in enumerate(rms) if value > _OUTLYING_VIEW * typical]
    if outlying:
        text = f"view {', '.join(outlying)} fits {_OUTLYING_VIEW:g} times worse than the others: look at it"
        found.doubts.append(text)


def _judge_lens(calibration: StereoCalibration, observations: Observations, found: _Reasons) -> None:
    from epiline.verdict.lens import misfit, remedy
    from epiline.verdict.oddities import model_of

    bad = misfit(calibration, observations)
    if bad is None:
        return
    where = "outward" if bad.worst_px > 0 else "inward"
    text = (
        f"the lens model {model_of(calibration)!r} does not follow the {bad.side} lens: {bad.radius_px:.0f} px from "
        f"its centre corners lie {abs(bad.worst_px):.2f} px {where} of their prediction; "
        f"{remedy(calibration, observations)}"
    )
    found.grade(abs(bad.worst_px), 0.0, _USABLE_EPIPOLAR_PX, text)


def _judge_coverage(calibration: StereoCalibration, observations: Observations, found: _Reasons) -> tuple[str, ...]:
    from epiline.verdict.coverage import coverage_of

    coverage = coverage_of(calibration, observations)
    side = "left" if coverage.share[0] <= coverage.share[1] else "right"
    least = min(coverage.share)
    text = f"corners in {100 * least:.0f} % of the {side} picture (good is at least {100 * _GOOD_COVERAGE:.0f} %)"
    found.grade(-least, -_GOOD_COVERAGE, -_USABLE_COVERAGE, text)
    advice = list(coverage.advice())
    missing = _GOOD_VIEWS - len(observations)
    if missing > 0:
        advice.append(f"take {missing} more pairs or more, each from another side")
    return tuple(advice)
