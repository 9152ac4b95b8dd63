"""How sharp a photograph is where it matters: on the edges between a board's squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from epiline.targets.observations import Points

# Edges of which the width is taken; more would cost time and not change a median.
_MAX_EDGES = 400
# Profiles reach so much of the spacing to either side: farther out begin the neighbouring squares and the markers.
_REACH = 0.3
_SAMPLES = 41
# Lower steps are no edges of a board but noise.
_MIN_STEP = 12.0
# From a step's width in standard deviations of a Gaussian blur to that between a tenth and nine tenths of it.
_TENTH_TO_NINE_TENTHS = 2.563


def edge_width_px(image: NDArray[np.uint8], grid: Points) -> float:
    """Width of the edges between squares, from a tenth to nine tenths of their step, px.

    Taken across the middle of every edge between two neighbouring corners; the median of the edges along the rows
    or of those along the columns, whichever is larger, so that a blur in one direction counts.

    Parameters
    ----------
    image : (H, W) uint8
    grid : (rows, columns, 2) float64
        Corners where they are on the board, NaN where there is none.

    Returns
    -------
    float
        NaN if no edge could be measured.
    """
    widths = [
        _median_width(image, grid[:, :-1].reshape(-1, 2), grid[:, 1:].reshape(-1, 2)),
        _median_width(image, grid[:-1].reshape(-1, 2), grid[1:].reshape(-1, 2)),
    ]
    finite = [width for width in widths if np.isfinite(width)]
    return max(finite, default=float("nan"))


def _median_width(image: NDArray[np.uint8], start: Points, end: Points) -> float:
    """Median over the edges from `start` to `end`."""
    import cv2

    known = np.isfinite(start).all(axis=1) & np.isfinite(end).all(axis=1)
    start, end = start[known], end[known]
    step = max(1, len(start) // _MAX_EDGES)
    start, end = start[::step], end[::step]
    if not len(start):
        return float("nan")
    along = end - start
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    reach = np.linspace(-_REACH, _REACH, _SAMPLES)
    at = ((start + end) / 2)[:, None] + reach[None, :, None] * across[:, None]
    maps = at.astype(np.float32)
    levels = cv2.remap(image, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profile = np.asarray(levels, np.float64)
    height = profile[:, -6:].mean(axis=1) - profile[:, :6].mean(axis=1)
    # A step's gradient, read as a density, has the blur's variance; negative gradients are noise or a marker.
    density = np.clip(np.diff(profile, axis=1) * np.sign(height)[:, None], 0.0, None)
    total = density.sum(axis=1)
    strong = (np.abs(height) > _MIN_STEP) & (total > 0)
    if not strong.any():
        return float("nan")
    density, spacing = density[strong] / total[strong, None], np.linalg.norm(across[strong], axis=1)
    centre = (reach[:-1] + reach[1:]) / 2
    mean = density @ centre
    variance = (density * np.square(centre[None] - mean[:, None])).sum(axis=1)
    return float(np.median(_TENTH_TO_NINE_TENTHS * np.sqrt(variance) * spacing))
