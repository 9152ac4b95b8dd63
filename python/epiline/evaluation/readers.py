"""Ground truth as data sets store it, to disparity in pixels with NaN where unknown."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from epiline._images import MAX_SIDE_PX

# Magic, width, height, scale, each ended by white space; comments are not part of the format.
_PFM_HEADER = re.compile(rb"(P[Ff])\s+(\d{1,9})\s+(\d{1,9})\s+([-+0-9.eE]{1,40})\s")


def read_disparity(path: Path, *, scale: float = 1.0) -> NDArray[np.float32]:
    """A disparity file: ``.pfm``, ``.npy``, ``.npz`` (its only array), or an image of 8 or 16 bits.

    Parameters
    ----------
    path : Path
    scale : float
        What the stored values are divided by: 256 for KITTI's images, 2 to 16 for Middlebury's older ones.

    Returns
    -------
    (H, W) float32
        Pixels. Zero, negative and infinite values are unknown: NaN.

    Raises
    ------
    OSError
        The file cannot be read or is damaged.
    ValueError
        It holds no map, or `scale` is not positive.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise ValueError(f"scale = {scale}: must be positive")
    suffix = path.suffix.lower()
    if suffix == ".pfm":
        stored = read_pfm(path)
    elif suffix in (".npy", ".npz"):
        stored = _read_numpy(path)
    else:
        stored = _read_image(path)
    values: NDArray[np.float32] = np.asarray(stored, np.float32) / np.float32(scale)
    with np.errstate(invalid="ignore"):
        values[~(np.isfinite(values) & (values > 0))] = np.nan
    return values


def read_pfm(path: Path) -> NDArray[np.float32]:
    """A PFM file's first channel as stored, top row first.

    Raises OSError for a damaged or truncated file.
    """
    data = path.read_bytes()
    header = _PFM_HEADER.match(data)
    if header is None:
        raise OSError(f"{path}: not a PFM file: no header 'Pf WIDTH HEIGHT SCALE'")
    channels = 3 if header[1] == b"PF" else 1
    width, height = int(header[2]), int(header[3])
    try:
        scale = float(header[4])
    except ValueError:
        scale = float("nan")
    if not np.isfinite(scale) or scale == 0:
        raise OSError(
            f"{path}: damaged PFM: scale = {header[4].decode('ascii', 'replace')} must be finite and not zero"
        )
    if not (1 <= width <= MAX_SIDE_PX and 1 <= height <= MAX_SIDE_PX):
        raise OSError(f"{path}: damaged PFM: {width}x{height} px; each side must be 1 to {MAX_SIDE_PX} px")
    needed = 4 * channels * width * height
    body = data[header.end() : header.end() + needed]
    if len(body) < needed:
        raise OSError(f"{path}: truncated PFM: {len(body)} bytes of pixels, {width}x{height} px need {needed}")
    values = np.frombuffer(body, "<f4" if scale < 0 else ">f4").reshape(height, width, channels)
    return np.flipud(values[..., 0]).astype(np.float32)


def _read_numpy(path: Path) -> NDArray[np.float32]:
    try:
        loaded = np.load(path, allow_pickle=False)
        arrays = [loaded] if isinstance(loaded, np.ndarray) else [loaded[name] for name in loaded.files]
    except (ValueError, EOFError, KeyError) as error:
        raise OSError(f"{path}: not a NumPy file of numbers: {error}") from error
    if len(arrays) != 1 or arrays[0].ndim != 2 or not np.issubdtype(arrays[0].dtype, np.number):
        shapes = ", ".join(str(array.shape) for array in arrays)
        raise ValueError(f"{path}: expected one (H, W) array of numbers, got {shapes or 'none'}")
    return np.asarray(arrays[0], np.float32)


def _read_image(path: Path) -> NDArray[np.float32]:
    from epiline._images import read_levels

    levels = read_levels(path)
    return np.asarray(levels if levels.ndim == 2 else levels[..., 0], np.float32)
