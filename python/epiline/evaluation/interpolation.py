"""An answer for every pixel, from the background side: KITTI's development kit, `interpolateBackground`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def interpolate_background(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """(H, W) px with every NaN answered.

    In a row, a gap takes the smaller of the two disparities that bound it, and its ends the nearest one; a row without
    any answer takes the nearest such row's; a map without any answer stays so.
    """
    filled = _nearest_in_rows(values)
    rows = np.flatnonzero(np.isfinite(filled).all(axis=1))
    if rows.size == 0:
        return filled
    nearest = np.clip(np.searchsorted(rows, np.arange(len(filled))), 0, rows.size - 1)
    before = np.clip(nearest - 1, 0, rows.size - 1)
    at = np.arange(len(filled))
    closer = np.abs(rows[before] - at) < np.abs(rows[nearest] - at)
    return np.ascontiguousarray(filled[np.where(closer, rows[before], rows[nearest])])


def _nearest_in_rows(values: NDArray[np.float32]) -> NDArray[np.float32]:
    width = values.shape[1]
    known = np.isfinite(values)
    columns = np.broadcast_to(np.arange(width), values.shape)
    left = np.maximum.accumulate(np.where(known, columns, -1), axis=1)
    right = np.minimum.accumulate(np.where(known, columns, width)[:, ::-1], axis=1)[:, ::-1]
    from_left = np.take_along_axis(values, left.clip(0), axis=1)
    from_right = np.take_along_axis(values, right.clip(max=width - 1), axis=1)
    bounds = np.where(left < 0, from_right, np.where(right == width, from_left, np.minimum(from_left, from_right)))
    return np.asarray(np.where(known, values, bounds), np.float32)
