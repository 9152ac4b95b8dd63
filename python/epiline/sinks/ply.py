"""Point clouds as PLY files."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from epiline._files import StrPath, write_atomically

_HEADER = """ply
format binary_little_endian 1.0
comment left aligned optical frame: x right, y down, z forward, metres
element vertex {count}
property float x
property float y
property float z
{colour}end_header
"""
_COLOUR = "property uchar red\nproperty uchar green\nproperty uchar blue\n"


def write_ply(path: StrPath, points: NDArray[np.float32]) -> None:
    """Writes points as binary little-endian PLY.

    Parameters
    ----------
    path : path-like
    points : (N, 3) or (N, 6) float32
        x, y, z in metres; then red, green, blue from 0 to 255.

    Raises
    ------
    ValueError
        Another shape.
    OSError
        The file cannot be written.
    """
    if points.ndim != 2 or points.shape[1] not in (3, 6):
        raise ValueError(f"points: expected shape (N, 3) or (N, 6), got {points.shape}")
    coloured = points.shape[1] == 6
    fields = [("xyz", "<f4", 3)] + ([("rgb", "u1", 3)] if coloured else [])
    vertices = np.zeros(len(points), np.dtype(fields))
    vertices["xyz"] = points[:, :3]
    if coloured:
        vertices["rgb"] = np.clip(np.rint(points[:, 3:]), 0, 255)
    header = _HEADER.format(count=len(points), colour=_COLOUR if coloured else "")
    write_atomically(path, header.encode("ascii") + vertices.tobytes())
