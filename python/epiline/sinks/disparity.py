"""Disparity files as each ecosystem wants them."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from epiline._files import StrPath, write_atomically
from epiline.sinks.pictures import write_picture

DISPARITY_SUFFIXES = (".pfm", ".png", ".npy")

_KITTI_SCALE = 256.0


def write_disparity(path: StrPath, values_px: NDArray[np.float32]) -> None:
    """Writes a disparity map in the format its file name ends with.

    Parameters
    ----------
    path : path-like
        ``.pfm``: Middlebury's, float32 little-endian, bottom row first, +inf where unknown. ``.png``: KITTI's,
        16 bits, 256·d, 0 where unknown. ``.npy``: NumPy's, float32, NaN where unknown.
    values_px : (H, W) float32
        Disparity, pixels; NaN where unknown.

    Raises
    ------
    ValueError
        Another suffix, or a disparity of 256 px or more for ``.png``, which cannot hold it.
    OSError
        The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix == ".pfm":
        write_atomically(path, pfm_bytes(values_px))
    elif suffix == ".png":
        write_picture(path, kitti_levels(values_px))
    elif suffix == ".npy":
        buffer = io.BytesIO()
        np.save(buffer, np.asarray(values_px, np.float32))
        write_atomically(path, buffer.getvalue())
    else:
        raise ValueError(f"{path}: expected one of {' '.join(DISPARITY_SUFFIXES)}")


def pfm_bytes(values_px: NDArray[np.float32]) -> bytes:
    """A PFM file: text header, then rows from the bottom; a negative scale says little-endian."""
    height, width = values_px.shape
    rows = np.flipud(np.where(np.isnan(values_px), np.inf, values_px)).astype("<f4")
    return f"Pf\n{width} {height}\n-1.0\n".encode() + rows.tobytes()


def kitti_levels(values_px: NDArray[np.float32]) -> NDArray[np.uint16]:
    """256·d in 16 bits, 0 where unknown; a known disparity of zero becomes the smallest level above it."""
    known = np.isfinite(values_px)
    levels = np.rint(np.where(known, values_px, 0) * _KITTI_SCALE)
    largest = float(levels.max(initial=0.0))
    if largest > np.iinfo(np.uint16).max:
        raise ValueError(
            f"disparity = {largest / _KITTI_SCALE:g} px: a KITTI PNG holds less than 256 px; use .pfm or .npy"
        )
    return np.where(known, np.maximum(levels, 1), 0).astype(np.uint16)
