"""Views that harm a calibration: repeated, blurred, mis-found at first, or not of one moment. Each is named."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline._core import Error, calibrate_points
from epiline.targets.boards import Board
from epiline.targets.observations import SIDES, Corners, Observations, Points, Side, View

LensModel: TypeAlias = Literal["brown4", "brown5", "rational", "thin-prism", "fisheye", "auto"]

# Corners of two views closer than this on average, in both cameras, are one view twice. Hand-held boards differ by
# tens of pixels; a tripod's drift and the noise of the corners stay below one.
_SAME_VIEW_PX = 1.0
# Blurred against the other views of its camera: so many times the usual width of edges, and wide in itself. The sharp
# views of four rigs are at most 1.28 times as wide as is usual there.
_BLUR_RATIO, _BLUR_PX = 1.8, 4.0
# With so many regular views one whose grid was mis-found at first is not worth its risk. On real pairs such views,
# found again, changed the held-out error by 0.3 % at most, in either direction.
_ENOUGH_VIEWS = 8
# Poses between the cameras that views give by themselves differ by noise. So many times the usual difference, and
# more than this angle or share of the baseline, is another moment or a mis-found grid. Photographs that are not of
# one moment were 65 % off; a lens refocused by 3 %, which is another mistake and said elsewhere, put views 21 % off.
_POSE_RATIO, _POSE_ANGLE_RAD, _POSE_BASELINE_SHARE = 6.0, np.deg2rad(1.0), 0.25
_MIN_VIEWS_TO_COMPARE = 4
# A view that fits so many times worse than usual does not belong to the others, provided that the lens model suits
# them: their error is below this.
_RESIDUAL_RATIO, _SUITED_PX = 4.0, 1.0
# Views from which a rough lens is taken: a calibration's cost grows with their cube in OpenCV.
_LENS_VIEWS = 24


def screened(
    views: tuple[View, ...], board: Board, image_size: tuple[int, int], model: LensModel = "brown4"
) -> tuple[View, ...]:
    """The views, those that harm a calibration rejected with their reason.

    Parameters
    ----------
    views : tuple of View
    board : Chessboard or Charuco
    image_size : (width, height)
        Pixels.
    model : str
        Lens of :func:`epiline.calibrate`: views that a lens cannot follow are not their fault.

    Returns
    -------
    tuple of View
        The same views in the same order.
    """
    views = _without_repetitions(views)
    views = _without_blur(views)
    views = _without_second_attempts(views)
    views = _of_one_moment(views, board, image_size)
    return _of_one_rig(views, board, image_size, model)


def _rejected(view: View, reason: str, *, usable_alone: bool) -> View:
    return replace(view, accepted=False, reason=reason, usable_alone=usable_alone)


def _without_repetitions(views: tuple[View, ...]) -> tuple[View, ...]:
    """The first of several equal views stays: repetitions teach nothing, and make held-out views known ones."""
    kept: list[View] = []
    # Centres of gravity first: comparing every corner of every two of a thousand views takes long.
    centres: list[Points] = []
    result = []
    for view in views:
        if not view.accepted or view.left is None or view.right is None:
            result.append(view)
            continue
        centre = np.concatenate([view.left.px.mean(axis=0), view.right.px.mean(axis=0)])
        near = np.abs(np.array(centres).reshape(-1, 4) - centre).max(axis=1) < 10 * _SAME_VIEW_PX
        twin = next((kept[i] for i in np.flatnonzero(near) if _is_same(kept[i], view)), None)
        if twin is None:
            kept.append(view)
            centres.append(centre)
            result.append(view)
        else:
            result.append(_rejected(view, f"the same view as {twin.name}", usable_alone=False))
    return tuple(result)


def _is_same(one: View, other: View) -> bool:
    return all(_mean_distance_px(one.seen(side), other.seen(side)) < _SAME_VIEW_PX for side in SIDES)


def _mean_distance_px(one: Corners | None, other: Corners | None) -> float:
    if one is None or other is None:
        return float("inf")
    common = np.intersect1d(one.ids, other.ids, assume_unique=True)
    if 2 * len(common) < max(len(one.ids), len(other.ids)):
        return float("inf")
    apart = one.px[np.isin(one.ids, common)] - other.px[np.isin(other.ids, common)]
    return float(np.linalg.norm(apart, axis=1).mean())


def _without_blur(views: tuple[View, ...]) -> tuple[View, ...]:
    reasons: dict[int, list[str]] = {}
    for side in SIDES:
        widths = np.array([_edge_width_px(view, side) for view in views])
        if not np.isfinite(widths).any():
            continue
        usual = float(np.nanmedian(widths))
        for i in np.flatnonzero(widths > max(_BLUR_RATIO * usual, _BLUR_PX)):
            text = f"{side}: blurred: its edges are {widths[i]:.1f} px wide, usually {usual:.1f} px"
            reasons.setdefault(int(i), []).append(text)
    return tuple(
        _rejected(view, "; ".join(reasons[i]), usable_alone=False) if i in reasons else view
        for i, view in enumerate(views)
    )


def _edge_width_px(view: View, side: Side) -> float:
    seen = view.seen(side)
    return seen.edge_width_px if view.accepted and seen is not None else float("nan")


def _without_second_attempts(views: tuple[View, ...]) -> tuple[View, ...]:
    def again(view: View) -> bool:
        return any(seen is not None and seen.found_again for seen in (view.left, view.right))

    if sum(view.accepted and not again(view) for view in views) < _ENOUGH_VIEWS:
        return views
    return tuple(
        _rejected(view, view.remark, usable_alone=False) if view.accepted and again(view) else view for view in views
    )


@dataclass(frozen=True)
class _RelativePose:
    rotation: NDArray[np.float64]
    translation_m: NDArray[np.float64]


def _of_one_moment(views: tuple[View, ...], board: Board, image_size: tuple[int, int]) -> tuple[View, ...]:
    """Rejects pairs whose own pose between the cameras is not that of the others.

    The board or the rig moved between the two photographs, the pair was put together from two moments, or a grid is
    mis-found in a regular way.
    """
    accepted = [i for i, view in enumerate(views) if view.accepted]
    if len(accepted) < _MIN_VIEWS_TO_COMPARE:
        return views
    poses = _relative_poses([views[i] for i in accepted], board, image_size)
    if poses is None:
        return views
    baseline_m = float(np.median([np.linalg.norm(pose.translation_m) for pose in poses]))
    angles = np.array([[_angle_rad(a.rotation @ b.rotation.T) for b in poses] for a in poses])
    shifts = np.array([[np.linalg.norm(a.translation_m - b.translation_m) for b in poses] for a in poses])
    share = shifts / max(baseline_m, 1e-9)
    middle = int((np.median(angles, axis=1) + np.median(share, axis=1)).argmin())
    angle, share = angles[middle], share[middle]
    limit_angle = max(_POSE_RATIO * float(np.median(angle)), _POSE_ANGLE_RAD)
    limit_share = max(_POSE_RATIO * float(np.median(share)), _POSE_BASELINE_SHARE)
    off = (angle > limit_angle) | (share > limit_share)
    # A majority that disagrees is no set of outliers: the fit will say what is wrong with it.
    if 2 * off.sum() >= len(off):
        return views
    result = list(views)
    for i, is_off, turn, shift in zip(accepted, off, np.rad2deg(angle), 100 * share, strict=True):
        if is_off:
            reason = (
                f"the two photographs are not of one moment, or the board is mis-found in one: it puts the cameras "
                f"{turn:.1f} degrees and {shift:.0f} % of the baseline away from where the other pairs put them"
            )
            result[i] = _rejected(views[i], reason, usable_alone=True)
    return tuple(result)


def _of_one_rig(
    views: tuple[View, ...], board: Board, image_size: tuple[int, int], model: LensModel
) -> tuple[View, ...]:
    """Rejects pairs that a fit of all of them leaves far off."""
    accepted = [i for i, view in enumerate(views) if view.accepted]
    if len(accepted) < _MIN_VIEWS_TO_COMPARE:
        return views
    chosen = Observations(board, image_size, tuple(views[i] for i in accepted))
    try:
        fit = calibrate_points(
            chosen.left_px,
            chosen.right_px,
            chosen.board_m,
            image_size,
            model="brown5" if model == "auto" else model,
            held_out=False,
        )
    except (Error, ValueError):
        # The calibration will say why.
        return views
    rms_px = np.array([max(view.left_rms_px, view.right_rms_px) for view in fit.views])
    usual_px = float(np.median(rms_px))
    off = rms_px > _RESIDUAL_RATIO * usual_px
    result = list(views)
    if usual_px > _SUITED_PX:
        return views
    if 4 * off.sum() <= len(off):
        for i, error_px in zip(np.array(accepted)[off], rms_px[off], strict=True):
            reason = f"its corners are {error_px:.2f} px off where the other pairs put them, usually {usual_px:.2f} px"
            result[i] = _rejected(views[i], reason, usable_alone=False)
    return tuple(result)


def _relative_poses(views: list[View], board: Board, image_size: tuple[int, int]) -> list[_RelativePose] | None:
    """Right from left camera by each view alone, under a rough lens; None where no lens can be had."""
    import cv2

    points_m = board.points_m
    chosen = np.unique(np.linspace(0, len(views) - 1, _LENS_VIEWS).round().astype(int))
    turns: list[list[NDArray[np.float64]]] = []
    shifts: list[list[NDArray[np.float64]]] = []
    for side in SIDES:
        seen = [corners for view in views if (corners := view.seen(side)) is not None]
        boards = [points_m[corners.ids].astype(np.float32) for corners in seen]
        pixels = [corners.px.astype(np.float32) for corners in seen]
        try:
            _, matrix, lens, _, _ = cv2.calibrateCamera(
                [boards[i] for i in chosen], [pixels[i] for i in chosen], image_size, None, None
            )
            solved = [cv2.solvePnP(b, p, matrix, lens) for b, p in zip(boards, pixels, strict=True)]
        except cv2.error:
            return None
        turns.append([np.asarray(cv2.Rodrigues(turn)[0], np.float64) for _, turn, _ in solved])
        shifts.append([np.asarray(shift, np.float64).ravel() for _, _, shift in solved])
    poses = []
    for left, right, left_m, right_m in zip(*turns, *shifts, strict=True):
        rotation = right @ left.T
        poses.append(_RelativePose(rotation, right_m - rotation @ left_m))
    return poses


def _angle_rad(rotation: NDArray[np.float64]) -> float:
    return float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1.0, 1.0)))
