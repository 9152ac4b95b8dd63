"""What a grid of corners tells by itself: its spacing, whether it is regular, and the ways to read it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Board, Chessboard
from epiline.targets.observations import Points

# A lens bends a plane's picture smoothly: beyond a homography, polynomials of this degree follow it.
_LENS_DEGREE = 3
# Irregularity of 253 good grids of four rigs: at most 0.062. Of the mis-found ones: 0.22 and more.
MAX_IRREGULARITY = 0.12


def smallest_spacing(corners: Points, board: Chessboard) -> float:
    """Smallest distance between neighbouring corners of a whole board, px."""
    grid = corners.reshape(board.rows, board.columns, 2)
    along, down = np.diff(grid, axis=1), np.diff(grid, axis=0)
    return float(min(np.linalg.norm(along, axis=-1).min(), np.linalg.norm(down, axis=-1).min()))


def on_grid(px: Points, ids: NDArray[np.int64], board: Board) -> Points:
    """(rows, columns, 2) corners where they are on the board, NaN where there is none."""
    columns, rows = board.corner_grid
    grid = np.full((rows * columns, 2), np.nan)
    grid[ids] = px
    return grid.reshape(rows, columns, 2)


def irregularity(corners: Points, board: Chessboard) -> float:
    """Largest distance of a corner from where the others put it, as a share of the smallest spacing.

    The others say where by a homography, which is what perspective does to a plane, and a cubic on top of it for
    the lens. However steep the view, a rightly found grid leaves only the detector's noise.
    """
    import cv2

    x, y = np.meshgrid(np.linspace(-1, 1, board.columns), np.linspace(-1, 1, board.rows))
    flat = np.stack([x.ravel(), y.ravel()], axis=1)
    homography, _ = cv2.findHomography(flat, corners)
    if homography is None:
        return float("inf")
    left_over = corners - cv2.perspectiveTransform(flat[None], np.asarray(homography, np.float64))[0]
    # No power that so few corners a side could follow wherever they are.
    powers = [
        (i, j)
        for i in range(min(_LENS_DEGREE, board.columns - 2) + 1)
        for j in range(min(_LENS_DEGREE, board.rows - 2) + 1)
        if i + j <= _LENS_DEGREE
    ]
    terms = np.stack([flat[:, 0] ** i * flat[:, 1] ** j for i, j in powers], axis=1)
    left_over = left_over - terms @ np.linalg.lstsq(terms, left_over, rcond=None)[0]
    return float(np.linalg.norm(left_over, axis=1).max() / max(smallest_spacing(corners, board), 1e-9))


def readings(image: NDArray[np.uint8], corners: Points, board: Chessboard) -> list[Points]:
    """The orders in which these corners can be the board's, given the colours of its squares.

    A board turned by half, or a square one by a quarter, has its corners in the same places. If it has its colours
    in the same places too, the picture does not tell which way up it is, and there is more than one reading;
    otherwise the one whose first square between four corners is dark is the board's. All of them are right-handed,
    as a board is that faces the camera.

    Parameters
    ----------
    image : (H, W) uint8
    corners : (N, 2) float64
        Row by row.
    board : Chessboard

    Returns
    -------
    list of (N, 2) float64
        One, two or four.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    if not _is_right_handed(grid):
        grid = grid[::-1]
    quarters = range(4) if board.rows == board.columns else (0, 2)
    turned = [np.rot90(grid, quarter) for quarter in quarters]
    fitting = [reading for reading in turned if _first_square_is_dark(image, reading)]
    return [np.ascontiguousarray(reading).reshape(-1, 2) for reading in fitting or turned]


def closest_reading(left: Points, right_readings: list[Points]) -> Points:
    """The right image's reading that differs least from the left corners by more than a shift.

    Two cameras of a rig look the same way, so a board's pictures in them are shifted and a little distorted, not
    turned.
    """
    centred = left - left.mean(axis=0)
    return min(right_readings, key=lambda right: float(np.square(right - right.mean(axis=0) - centred).sum()))


def _is_right_handed(grid: Points) -> bool:
    along, down = grid[:, -1] - grid[:, 0], grid[-1] - grid[0]
    (ax, ay), (dx, dy) = along.mean(axis=0), down.mean(axis=0)
    return bool(ax * dy - ay * dx > 0)


def _first_square_is_dark(image: NDArray[np.uint8], grid: Points) -> bool:
    centres = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    x, y = np.rint(centres).astype(int).clip(0, np.array(image.shape[::-1]) - 1).transpose(2, 0, 1)
    levels = image[y, x].astype(np.float64)
    row, col = np.indices(levels.shape)
    as_first = (row + col) % 2 == 0
    return float(levels[as_first].mean()) < float(levels[~as_first].mean())
