"""Ground truth as data sets store it, to disparity in pixels with NaN where unknown."""

from __future__ import annotations

import re
import zipfile
import zlib
from pathlib import Path
from typing import IO, Any

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
        Pixels; NaN where unknown: 0 in an image, a negative or infinite number elsewhere.

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
    values: NDArray[np.float32] = stored / np.float32(scale)
    values[~(np.isfinite(values) & (values >= 0))] = np.nan
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
        with path.open("rb") as file:
            if path.suffix.lower() == ".npy":
                return _read_array(file)
            with zipfile.ZipFile(file) as archive:
                names = archive.namelist()
                if len(names) != 1:
                    raise ValueError(f"expected one array, it holds {len(names)}")
                with archive.open(names[0]) as member:
                    return _read_array(member)
    except (ValueError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error) as error:
        raise OSError(f"{path}: not a disparity map in NumPy's format: {error}") from error


def _read_array(stream: IO[bytes]) -> NDArray[np.float32]:
    """One array; its header is checked before memory is taken for what the header promises."""
    version = np.lib.format.read_magic(stream)
    readers: dict[tuple[int, int], Any] = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in readers:
        raise ValueError(f"format version {version}")
    shape, column_major, dtype = readers[version](stream)
    if len(shape) != 2 or dtype.kind not in "fiu":
        raise ValueError(f"expected an (H, W) array of real numbers, got {shape} of {dtype}")
    if not all(1 <= side <= MAX_SIDE_PX for side in shape):
        raise ValueError(f"shape {shape}; each side must be 1 to {MAX_SIDE_PX} px")
    needed = shape[0] * shape[1] * dtype.itemsize
    body = stream.read(needed)
    if len(body) < needed:
        raise ValueError(f"truncated: {len(body)} bytes, {shape} of {dtype} need {needed}")
    array = np.frombuffer(body, dtype).reshape(shape, order="F" if column_major else "C")
    # What is too large for float32 is no disparity: infinite, hence unknown.
    with np.errstate(over="ignore"):
        return np.asarray(array, np.float32)


def _read_image(path: Path) -> NDArray[np.float32]:
    from epiline._images import read_levels

    levels = read_levels(path)
    values = np.asarray(levels if levels.ndim == 2 else levels[..., 0], np.float32)
    return np.where(values == 0, np.float32(np.nan), values)
