"""Whether the lens model follows the lenses: residuals that go with the radius, and what another model would do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline._core import Error, StereoCalibration, calibrate_points
from epiline.targets import Observations
from epiline.targets.observations import SIDES, CalibrationView, Side
from epiline.targets.screening import LensModel
from epiline.verdict.oddities import model_of

Floats = NDArray[np.float64]

# Rings around the principal point with as many corners each, and the fewest that tell anything.
_RINGS, _MIN_CORNERS_A_RING = 10, 8
# Of a lens that is followed, the medians of the rings scatter by chance alone. So many times that, and so large a share
# of the noise of single corners, is the lens: on five real rigs at most 2.5 times and 0.29 with a model that suits
# them, 60 times and 3.3 with one that does not.
_CHANCE_RATIO, _NOISE_SHARE = 3.0, 0.25
# From the median of absolute values to the standard deviation, and the efficiency of a median.
_SIGMA_OF_MEDIAN_ABSOLUTE, _MEDIAN_SPREAD = 1.4826, 1.2533
# Another model is worth naming if it leaves at most this share of the held-out error.
_WORTH_SHARE = 0.8
# Views on which models are compared.
_MAX_VIEWS = 24
_OTHERS: tuple[LensModel, ...] = ("brown5", "rational", "fisheye")


@dataclass(frozen=True)
class Misfit:
    """A lens that its model does not follow.

    Attributes
    ----------
    side : {"left", "right"}
    worst_px : float
        Largest median, over rings around the principal point, of how far corners lie outside of (positive) or inside
        of (negative) their prediction.
    radius_px : float
        Of that ring.
    """

    side: Side
    worst_px: float
    radius_px: float


def misfit(calibration: StereoCalibration, observations: Observations) -> Misfit | None:
    """The worse of the two lenses, if its residuals go with the radius; corners that the fit left out count too."""
    views = observations.calibration_views
    if len(views) != len(calibration.views):
        return None
    found = [one for side in SIDES if (one := _misfit_of(calibration, observations, views, side)) is not None]
    return max(found, key=lambda one: abs(one.worst_px), default=None)


def remedy(calibration: StereoCalibration, observations: Observations) -> str:
    """What another lens model does to the error of held-out views, in words."""
    step = max(1, len(observations) // _MAX_VIEWS)
    chosen = observations.accepted[::step]
    if len(chosen) < 4:
        return "too few views to tell which model would"
    own = model_of(calibration)
    error_px = _held_out_px(observations, step, own)
    others = {model: _held_out_px(observations, step, model) for model in _OTHERS if model != own}
    known = {model: px for model, px in others.items() if np.isfinite(px)}
    if not known:
        return "no other model can be fitted to these views"
    best = min(known, key=lambda model: known[model])
    # A fit that breaks down without some of its views has no held-out error: any that has one is better.
    if not known[best] <= (_WORTH_SHARE * error_px if np.isfinite(error_px) else np.inf):
        return "no other model does better on held-out views: is the board flat, and is it at rest in every view?"
    # The simplest of those next to the best.
    model = next(model for model in _OTHERS if known.get(model, np.inf) <= 1.05 * known[best])
    before = f"instead of {error_px:.2f} px" if np.isfinite(error_px) else "where this one breaks down"
    return f"calibrate with model {model!r}: {known[model]:.2f} px on held-out views {before}"


def _misfit_of(
    calibration: StereoCalibration, observations: Observations, views: list[CalibrationView], side: Side
) -> Misfit | None:
    camera = calibration.left if side == "left" else calibration.right
    centre = np.array(camera.camera_matrix)[:2, 2]
    radii, outward = [], []
    for view, pose in zip(views, calibration.views, strict=True):
        points_m = observations.board.points_m[view.ids] @ pose.rotation.T + pose.translation_m
        if side == "right":
            points_m = points_m @ calibration.rotation.T + calibration.translation_m
        seen = view.left_px if side == "left" else view.right_px
        predicted = camera.project(points_m)
        known = np.isfinite(seen).all(axis=1) & np.isfinite(predicted).all(axis=1)
        from_centre = (seen - centre)[known]
        radius = np.linalg.norm(from_centre, axis=1)
        radii.append(radius)
        outward.append(((seen - predicted)[known] * from_centre).sum(axis=1) / np.maximum(radius, 1e-9))
    radius, error = np.concatenate(radii), np.concatenate(outward)
    if len(radius) < _RINGS * _MIN_CORNERS_A_RING:
        return None
    rings = np.array_split(np.argsort(radius), _RINGS)
    medians = np.array([np.median(error[ring]) for ring in rings])
    spread = np.median([np.median(np.abs(error[ring] - m)) for ring, m in zip(rings, medians, strict=True)])
    noise_px = _SIGMA_OF_MEDIAN_ABSOLUTE * float(spread)
    chance_px = _MEDIAN_SPREAD * noise_px / np.sqrt(len(radius) / _RINGS)
    swing_px = float(np.sqrt(np.mean(np.square(medians))))
    if swing_px <= max(_CHANCE_RATIO * chance_px, _NOISE_SHARE * noise_px):
        return None
    worst = int(np.abs(medians).argmax())
    return Misfit(side, float(medians[worst]), float(np.median(radius[rings[worst]])))


def _held_out_px(observations: Observations, step: int, model: LensModel) -> float:
    sides = observations.left_px, observations.right_px, observations.board_m
    left, right, board = (part[::step] for part in sides)
    try:
        return calibrate_points(left, right, board, observations.image_size, model=model).epipolar_error_px
    except (Error, ValueError):
        return float("nan")
