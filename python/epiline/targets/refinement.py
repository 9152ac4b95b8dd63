"""Corners to hundredths of a pixel: where the gradients around them say that two edges cross."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline.targets.observations import Points

# Half the window as a share of the steps to the neighbours, and the standard deviation of its weight as a share of half
# the window. Chosen on two rigs and confirmed on two others, whose held-out vertical disparity fell from 0.103, 0.039
# and from 0.082, 0.185 px, with square windows of whole pixels and 0.35 of the smallest step, to 0.090, 0.034 and
# 0.042, 0.174 px. At 0.45 windows of steep boards reach into the next corners.
WINDOW_SHARE, _WEIGHT_SIGMA = 0.4, 0.5
# Noise is white and edges are not: blurred by this much they keep their place and lose half the noise.
_BLUR_PX = 0.7
# A window needs this much to hold the two edges, and this much is all that it gains from.
MIN_HALF_PX, _MAX_HALF_PX = 2.0, 32.0
# Samples of the gradient from the middle of a window to its rim: one a pixel, and never few.
_MIN_SAMPLES = 12
_ITERATIONS, _CONVERGED_PX = 30, 1e-3


def windows(grid: Points, share: float = WINDOW_SHARE, least_px: float = MIN_HALF_PX) -> Points:
    """The parallelograms that a board's own steps span around its corners.

    Parameters
    ----------
    grid : (rows, columns, 2) float64
        Corners where they are on the board, pixels; NaN where there is none.
    share : float
        Half a window's side as a share of the step to the next corner.
    least_px : float
        What it is at least, as far as it then stays clear of the next corner.

    Returns
    -------
    (2, rows * columns, 2) float64
        From each corner to the middle of its window's right and of its lower side, pixels.
    """
    steps = np.stack([_steps(grid, axis).reshape(-1, 2) for axis in (1, 0)])
    lengths = np.linalg.norm(steps, axis=2, keepdims=True)
    half_px = np.clip(share * lengths, np.minimum(least_px, WINDOW_SHARE * lengths), _MAX_HALF_PX)
    return np.asarray(steps * (np.maximum(half_px, MIN_HALF_PX) / np.maximum(lengths, 1e-9)), np.float64)


def refined(image: NDArray[np.uint8], rough: Points, half_sides: Points) -> Points:
    """Corners, each where the gradients in a window around it are square to the line from it.

    A point on an edge has a gradient square to the edge, hence to its line from the corner `q`, and inside a square
    there is none: least squares of ``g · (p - q) = 0`` over the points `p` of a window (Förstner & Gülch, 1987). A
    window that follows the board covers the same part of the squares however the board is tilted and however small it
    is; its weight falls off towards its rim.

    Parameters
    ----------
    image : (H, W) uint8
    rough : (N, 2) float64
        Right to a pixel or two.
    half_sides : (2, N, 2) float64
        Of their windows, as :func:`windows` gives them.

    Returns
    -------
    (N, 2) float64
        Pixels; a corner without gradients stays where it was.
    """
    along, down = half_sides
    half_px = np.linalg.norm(half_sides, axis=2)
    samples = max(math.ceil(half_px.max()), _MIN_SAMPLES)
    u, v = (axis.ravel() for axis in np.meshgrid(*[np.linspace(-1.0, 1.0, 2 * samples + 1)] * 2))
    weight = np.exp(-(u**2 + v**2) / (2 * _WEIGHT_SIGMA**2))
    window = u[None, :, None] * along[:, None] + v[None, :, None] * down[:, None]
    gradient, origin = _gradients(image, rough, np.abs(window).max(axis=1).max(axis=0))
    corners = rough - origin
    for _ in range(_ITERATIONS):
        at = (corners[:, None] + window).astype(np.float32)
        gx, gy = (
            cv2.remap(g, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
            for g in gradient
        )
        xx, xy, yy = (np.sum(weight * product, axis=1) for product in (gx * gx, gx * gy, gy * gy))
        across = weight * (gx * window[..., 0] + gy * window[..., 1])
        bx, by = np.sum(gx * across, axis=1), np.sum(gy * across, axis=1)
        determinant = xx * yy - xy * xy
        with np.errstate(divide="ignore", invalid="ignore"):
            move = np.stack([yy * bx - xy * by, xx * by - xy * bx], axis=1) / determinant[:, None]
        # Where there is one edge, or none, nothing tells a place along it.
        move[~(determinant > 1e-6 * (xx + yy) ** 2)] = 0.0
        corners = corners + move.clip(-1.0, 1.0)
        if np.abs(move).max() < _CONVERGED_PX:
            break
    return np.asarray(corners + origin, np.float64)


def _steps(grid: Points, axis: int) -> Points:
    """(rows, columns, 2): mean of the steps from the corner before and to the one after; the usual one without both."""
    step = np.diff(grid, axis=axis)
    nowhere = np.full_like(np.take(grid, [0], axis=axis), np.nan)
    both = np.stack([np.concatenate(parts, axis=axis) for parts in ([nowhere, step], [step, nowhere])])
    known = np.isfinite(both)
    count = known.sum(axis=0)
    usual = np.nanmedian(step.reshape(-1, 2), axis=0) if np.isfinite(step).any() else np.zeros(2)
    return np.where(count > 0, np.where(known, both, 0.0).sum(axis=0) / np.maximum(count, 1), usual)


def _gradients(
    image: NDArray[np.uint8], corners: Points, reach_px: Points
) -> tuple[tuple[NDArray[np.float32], NDArray[np.float32]], Points]:
    """Gradients along x and y of the part of an image around some corners, and where that part begins."""
    margin = np.ceil(reach_px) + 4 * np.ceil(_BLUR_PX)
    height, width = image.shape
    low = np.floor(corners.min(axis=0) - margin).astype(int).clip(0, (width - 1, height - 1))
    high = np.ceil(corners.max(axis=0) + margin).astype(int).clip(0, (width - 1, height - 1)) + 1
    part = image[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    smooth = cv2.GaussianBlur(part, (0, 0), _BLUR_PX)
    gx, gy = (cv2.Sobel(smooth, cv2.CV_32F, dx, dy, ksize=3, scale=1 / 8) for dx, dy in ((1, 0), (0, 1)))
    return (np.asarray(gx, np.float32), np.asarray(gy, np.float32)), low.astype(np.float64)
