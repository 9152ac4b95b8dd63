"""What a calibration shows of how the photographs were taken: squeezed pictures, a lens that was refocused."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from epiline._core import Error, StereoCalibration, calibrate_points
from epiline.targets import Observations
from epiline.targets.screening import LensModel

# Pixels of today's sensors are square. What a poor set of views makes of them stays well below two in a hundred.
_SQUARE_TOLERANCE = 0.02
_SQUARE_SIGMAS = 5.0
_ASPECTS = {"16:9": 16 / 9, "3:2": 3 / 2, "4:3": 4 / 3, "16:10": 16 / 10, "5:4": 5 / 4, "1:1": 1.0, "21:9": 21 / 9}
_ASPECT_TOLERANCE = 0.015

# The views before and after some moment are of two rigs if fitting them apart leaves this share of the squared error
# at most. Five real rigs, in the order taken and shuffled: 0.85 and more; one lens zoomed by 1 %: 0.15 to 0.79.
_ERROR_LEFT = 0.8
# Whether it was a focal length that changed: by so many standard deviations, and so much.
_FOCUS_SIGMAS, _FOCUS_SHARE = 2.5, 0.004
_VIEWS_A_PART = 4
_MAX_VIEWS = 48


def squeezed(calibration: StereoCalibration) -> str:
    """Says so if pixels are not square: a picture squeezed or stretched after it was taken. Else empty."""
    found = []
    sigma = calibration.sigma
    for side, camera in (("left", calibration.left), ("right", calibration.right)):
        fx, fy = float(camera.camera_matrix[0, 0]), float(camera.camera_matrix[1, 1])
        uncertain = math.hypot(sigma.get(f"{side}_fx", 0.0) / fx, sigma.get(f"{side}_fy", 0.0) / fy)
        if abs(fy / fx - 1) > max(_SQUARE_TOLERANCE, _SQUARE_SIGMAS * uncertain):
            found.append((side, fy / fx))
    if not found:
        return ""
    width, height = calibration.image_size
    aspect = float(np.mean([ratio for _, ratio in found])) * width / height
    name = next((name for name, value in _ASPECTS.items() if abs(aspect / value - 1) < _ASPECT_TOLERANCE), "")
    origin = f" from {name}" if name else ""
    ratios = " and ".join(f"fy/fx = {ratio:.3f} in the {side} camera" for side, ratio in found)
    return (
        f"pixels are not square: {ratios}; the {width}x{height} px pictures seem to be squeezed{origin} "
        "(or the board's squares are not square)"
    )


@dataclass(frozen=True)
class _Split:
    """The views before and from `at`, each fitted alone."""

    at: int
    squares_px2: float
    parts: tuple[StereoCalibration, StereoCalibration]


def refocused(calibration: StereoCalibration, observations: Observations) -> str:
    """Says at which view the rig changed, and by which camera's focal length, if it did. Else empty.

    Views are taken in the order given, which is that of time. Every split of them into two parts is tried.
    """
    views = observations.accepted
    if len(views) < 2 * _VIEWS_A_PART or len(views) > len(calibration.views):
        return ""
    step = max(1, len(views) // _MAX_VIEWS)
    chosen = list(range(0, len(views), step))
    model = model_of(calibration)
    whole = _fitted(observations, chosen, model)
    if whole is None:
        return ""
    splits = []
    for at in range(_VIEWS_A_PART, len(chosen) - _VIEWS_A_PART + 1, max(1, len(chosen) // 12)):
        parts = _fitted(observations, chosen[:at], model), _fitted(observations, chosen[at:], model)
        if parts[0] is not None and parts[1] is not None:
            squares = _squares_px2(parts[0]) + _squares_px2(parts[1])
            splits.append(_Split(at, squares, (parts[0], parts[1])))
    if not splits:
        return ""
    best = min(splits, key=lambda split: split.squares_px2)
    if best.squares_px2 > _ERROR_LEFT * _squares_px2(whole):
        return ""
    jumps = []
    for side in ("left", "right"):
        (before, sigma_before), (after, sigma_after) = (_focal_px(part, side) for part in best.parts)
        significance = abs(after - before) / math.hypot(sigma_before, sigma_after)
        if significance > _FOCUS_SIGMAS and abs(after / before - 1) > _FOCUS_SHARE:
            jumps.append((significance, side, before, after))
    view = views[chosen[best.at]]
    remedy = "calibrate with the views of one setting only"
    if not jumps:
        return f"the rig changed at about {view.name}: a camera was moved, refocused or zoomed; {remedy}"
    _, side, before, after = max(jumps)
    name = view.name_left if side == "left" else view.name_right
    return (
        f"the {side} camera was refocused or zoomed at about {name}: its focal length is {before:.1f} px before and "
        f"{after:.1f} px from there on; {remedy}"
    )


def model_of(calibration: StereoCalibration) -> LensModel:
    """Under which lens a calibration was made."""
    models: dict[str, LensModel] = {"rational": "rational", "thin-prism": "thin-prism", "kannala-brandt": "fisheye"}
    plain: LensModel = "brown5" if calibration.left.distortion[-1] else "brown4"
    return models.get(calibration.left.lens, plain)


def _fitted(observations: Observations, chosen: list[int], model: LensModel) -> StereoCalibration | None:
    left, right, board = observations.left_px, observations.right_px, observations.board_m
    try:
        return calibrate_points(
            [left[i] for i in chosen],
            [right[i] for i in chosen],
            [board[i] for i in chosen],
            observations.image_size,
            model=model,
            held_out=False,
        )
    except (Error, ValueError):
        return None


def _squares_px2(fit: StereoCalibration) -> float:
    """Sum over views of their mean squared errors."""
    return float(sum(view.left_rms_px**2 + view.right_rms_px**2 for view in fit.views))


def _focal_px(fit: StereoCalibration, side: str) -> tuple[float, float]:
    """Focal length along x and its standard deviation."""
    camera = fit.left if side == "left" else fit.right
    return float(camera.camera_matrix[0, 0]), fit.sigma[f"{side}_fx"]
