"""A board that is not the one asked for: another number of corners."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Chessboard
from epiline.targets.grid import MAX_IRREGULARITY, irregularity
from epiline.targets.observations import Points

# How far from the number asked for a miscount lies: one row, or squares counted for corners, or both.
_REACH = 2
# The wrong counts are tried at this size: recognising needs fewer pixels than measuring.
_TRY_SIDE_PX = 640
# A corner where four squares meet has this share of the contrast of the others; the rim of a board a quarter at most.
_CORNER_SHARE = 0.5
# Where the squares of the next row would be, as a share of the spacing from its corners.
_DIAGONAL = 0.25


def other_count(image: NDArray[np.uint8], asked: Chessboard) -> Chessboard | None:
    """The board that is in a photograph in which the one asked for is not: a few corners more or fewer.

    Parameters
    ----------
    image : (H, W) uint8
    asked : Chessboard

    Returns
    -------
    Chessboard or None
        The largest that is found whole, with the same squares.
    """
    import cv2

    scale = _TRY_SIDE_PX / max(image.shape)
    if scale < 1:
        image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
    steps = range(-_REACH, _REACH + 1)
    counts = [(asked.columns + i, asked.rows + j) for i in steps for j in steps if (i, j) != (0, 0)]
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    for columns, rows in sorted(counts, key=lambda c: (-c[0] * c[1], abs(c[0] - asked.columns))):
        if min(columns, rows) < 3 or max(columns, rows) > 100:
            continue
        board = replace(asked, columns=columns, rows=rows)
        found, corners = cv2.findChessboardCorners(image, board.corner_grid, flags=flags)
        if found and irregularity(np.asarray(corners, np.float64).reshape(-1, 2), board) < MAX_IRREGULARITY:
            return board
    return None


def count_beyond(image: NDArray[np.uint8], corners: Points, board: Chessboard) -> tuple[int, int] | None:
    """Columns and rows of a board that goes on beyond the corners found on it, or None if it ends with them.

    A detector that is asked for fewer corners than a board has may answer with a part of it, a different part in
    every photograph.

    Parameters
    ----------
    image : (H, W) uint8
    corners : (N, 2) float64
        Row by row.
    board : Chessboard
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    own = float(np.median(np.abs(_saddles(image, grid[1:-1, 1:-1], grid))))
    if own < 1.0:
        return None
    more = [0, 0]
    for axis in (0, 1):
        for line in (grid, np.flip(grid, axis)):
            # The next line of corners, by the last three: a parabola follows perspective closely enough.
            last, before, third = (np.take(line, -k, axis) for k in (1, 2, 3))
            beyond = 3 * last - 3 * before + third
            height, width = image.shape
            inside = ((beyond > 2) & (beyond < (width - 3, height - 3))).all(axis=1)
            if inside.mean() < 0.8:
                continue
            there = np.abs(_saddles(image, beyond[inside][None], grid)) / own
            more[axis] += int(np.median(there) > _CORNER_SHARE)
    return (board.columns + more[1], board.rows + more[0]) if any(more) else None


def _saddles(image: NDArray[np.uint8], at: Points, grid: Points) -> NDArray[np.float64]:
    """How strongly opposite quarters around each place are alike and differ from the other two, grey levels."""
    along = np.diff(grid, axis=1).mean(axis=(0, 1)) * _DIAGONAL
    down = np.diff(grid, axis=0).mean(axis=(0, 1)) * _DIAGONAL
    height, width = image.shape

    def level(offset: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y = np.rint(at + offset).astype(int).clip(0, (width - 1, height - 1)).transpose(2, 0, 1)
        return np.asarray(image[y, x], np.float64)

    first = np.minimum(level(along + down), level(-along - down)), np.maximum(level(along + down), level(-along - down))
    second = (
        np.minimum(level(along - down), level(down - along)),
        np.maximum(level(along - down), level(down - along)),
    )
    # The darker of the bright pair against the brighter of the dark pair: an edge or the rim has no such gap.
    return np.asarray(np.maximum(first[0] - second[1], second[0] - first[1]).clip(0.0), np.float64)
