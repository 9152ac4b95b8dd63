"""How a camera turned between two photographs, told from far points alone: what of a pitch is a vehicle's nodding."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from epiline._core import DisparityMap, RectifiedGeometry

Floats = NDArray[np.float64]
Greys = NDArray[np.uint8]

# Points farther than this share of f·b move by rotation, nearer ones mostly by translation; of the farthest, depth is
# anybody's guess.
FAR_PX, FARTHEST_PX = 12.0, 0.5
# A point tracked there and back must return this near; fewer points determine nothing.
RETURN_PX, MIN_POINTS = 0.3, 30
# Residuals from which on a point counts less, and rounds of reweighting.
HUBER_PX, ROUNDS = 0.5, 12


def nod_rad(before: Greys, after: Greys, disparity: DisparityMap, geometry: RectifiedGeometry) -> float:
    """How much the camera pitched down from one left image to the next, radians; NaN where too little is seen.

    Far corners are tracked by optical flow (Lucas and Kanade), forth and back. With their depths from the disparity of
    `before`, rotation and translation are fitted to where they went (Gauss-Newton with Huber's weights), so that what
    moves by translation alone, away from the focus of expansion, is not taken for a turn. The floor has no part in it.

    Parameters
    ----------
    before, after : (H, W) uint8
    disparity : DisparityMap
        Of `before`.
    geometry : RectifiedGeometry
    """
    start, end, seen_px = _tracks(before, after, disparity, geometry.doffs_px)
    if len(start) < MIN_POINTS:
        return float("nan")
    depth_m = geometry.focal_px * geometry.baseline_m / seen_px
    center = np.array([geometry.cx_px, geometry.cy_px])
    points_m = np.column_stack([(start - center) / geometry.focal_px, np.ones(len(start))]) * depth_m[:, None]
    turn, move_m = np.zeros(3), np.zeros(3)
    for _ in range(ROUNDS):
        x, y, z = (points_m + np.cross(turn, points_m) + move_m).T
        f, one, nothing = geometry.focal_px, np.ones_like(z), np.zeros_like(z)
        off = np.concatenate([f * x / z + center[0] - end[:, 0], f * y / z + center[1] - end[:, 1]])
        # By turn and move, of the columns and then of the rows.
        columns = f * np.column_stack([-x * y / z**2, 1 + x**2 / z**2, -y / z, one / z, nothing, -x / z**2])
        rows = f * np.column_stack([-1 - y**2 / z**2, x * y / z**2, x / z, nothing, one / z, -y / z**2])
        jacobian = np.vstack([columns, rows])
        weight = np.sqrt(np.minimum(1.0, HUBER_PX / np.maximum(np.abs(off), 1e-12)))
        step = np.linalg.lstsq(jacobian * weight[:, None], -off * weight, rcond=None)[0]
        turn, move_m = turn + step[:3], move_m + step[3:]
    # What is seen turns up, about the axis to the right, as the camera turns down.
    return float(turn[0])


def _tracks(before: Greys, after: Greys, disparity: DisparityMap, doffs_px: float) -> tuple[Floats, Floats, Floats]:
    """Far corners in both images, (N, 2) px each, and their disparities counted from infinity, px."""
    import cv2

    nothing = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0)
    corners = cv2.goodFeaturesToTrack(before, 1500, 0.01, 8)
    if corners is None:
        return nothing
    how = {"winSize": (21, 21), "maxLevel": 4}
    there, found, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, None, **how)  # type: ignore[call-overload]
    back, returned, _ = cv2.calcOpticalFlowPyrLK(after, before, there, None, **how)  # type: ignore[call-overload]
    start, end = corners.reshape(-1, 2).astype(float), there.reshape(-1, 2).astype(float)
    x, y = np.rint(start).astype(int).T
    seen_px = disparity.values[y, x].astype(float) + doffs_px
    kept = (found.ravel() == 1) & (returned.ravel() == 1)
    kept &= np.hypot(*(back.reshape(-1, 2) - start).T) < RETURN_PX
    # Where there is no disparity it is NaN, and compares with nothing.
    kept &= (seen_px > FARTHEST_PX) & (seen_px < FAR_PX)
    return start[kept], end[kept], seen_px[kept]
