"""A chessboard's inner corners in one photograph, by OpenCV's detector and sub-pixel refinement."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Chessboard
from epiline.targets.observations import Points

# Half the refinement window as a share of the smallest corner spacing. A larger window reaches into the next corner
# of a foreshortened board and pulls the estimate there; a smaller one wastes the edges that carry the signal. Held-out
# vertical disparity on thirteen real pairs: 0.106 px at 0.35, 0.133 px with a fixed 5 px, 0.200 px at 0.45.
_WINDOW_SHARE = 0.35
_MIN_HALF_WINDOW = 2
# Boards of more than this many pixels a side are found in a smaller copy first: the detector's thresholds are local.
_SEARCH_SIDE_PX = 1600
# Beyond this share of the spacing a corner sits on its neighbour's side: the grid is mis-found.
_MAX_REFINEMENT_SHARE = 0.5
# Largest bend of the grid that a lens explains: second differences along a row, as a share of the spacing.
_MAX_BEND_SHARE = 0.25


class NotFound(Exception):
    """There is no usable board in a photograph; the message says why."""


def find_corners(image: NDArray[np.uint8], board: Chessboard, *, half_window: int | None = None) -> Points:
    """Inner corners of a board, row by row.

    Parameters
    ----------
    image : (H, W) uint8
    board : Chessboard
    half_window : int, optional
        Half the side of the refinement window, px; 0.35 of the smallest corner spacing if not given.

    Returns
    -------
    (N, 2) float64
        Pixel coordinates; (0, 0) is the centre of the top-left pixel.

    Raises
    ------
    NotFound
        No board, or one whose grid is not regular.
    """
    rough = _repaired(_detect(image, board), board)
    spacing = smallest_spacing(rough, board)
    window = half_window or max(_MIN_HALF_WINDOW, int(_WINDOW_SHARE * spacing))
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
    refined = cv2.cornerSubPix(image, rough.astype(np.float32).reshape(-1, 1, 2), (window, window), (-1, -1), criteria)
    corners = np.asarray(refined, np.float64).reshape(-1, 2)
    moved = float(np.abs(corners - rough).max())
    if moved > _MAX_REFINEMENT_SHARE * spacing:
        raise NotFound(f"refinement moved a corner by {moved:.1f} px, {moved / spacing:.2f} of the spacing")
    bend = largest_bend(corners, board)
    if bend > _MAX_BEND_SHARE:
        raise NotFound(f"the grid is not regular: a corner is off its row by {bend:.2f} of the spacing")
    return corners


def _detect(image: NDArray[np.uint8], board: Chessboard) -> Points:
    size = (board.columns, board.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    side = max(image.shape)
    # As it is; then enlarged, for boards of a few pixels a square; a large image first in a smaller copy.
    scales = (1.0, 2.0) if side <= _SEARCH_SIDE_PX else (_SEARCH_SIDE_PX / side, 1.0)
    for scale in scales:
        copy = image
        if scale != 1.0:
            kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
            copy = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=kind), np.uint8)
        # The quick look costs little and spares the endless search on pictures without a board (opencv#23558).
        found, corners = cv2.findChessboardCorners(copy, size, flags=flags)
        if found:
            # Pixel centres, not corners, are whole numbers: hence the half pixel on both sides of the scaling.
            return (np.asarray(corners, np.float64).reshape(-1, 2) + 0.5) / scale - 0.5
    raise NotFound(f"no {board} board")


def _repaired(corners: Points, board: Chessboard) -> Points:
    """The corners; a single stray one is moved to where its row and column expect it, if that makes the grid regular.

    The detector at times ends a row on the wrong edge. One corner can be told from the 53 others; with more than one
    wrong the grid is mis-found and stays as it is, to be refused.
    """
    if largest_bend(corners, board) <= _MAX_BEND_SHARE:
        return corners
    grid = corners.reshape(board.rows, board.columns, 2)
    expected = (_expected_along(grid) + _expected_along(grid.swapaxes(0, 1)).swapaxes(0, 1)) / 2
    away = np.linalg.norm(grid - expected, axis=-1)
    # A stray corner spoils what its neighbours expect too, but nobody's as much as its own.
    stray = np.unravel_index(int(away.argmax()), away.shape)
    repaired = grid.copy()
    repaired[stray] = expected[stray]
    result = repaired.reshape(-1, 2)
    return result if largest_bend(result, board) <= _MAX_BEND_SHARE else corners


def _expected_along(grid: Points) -> Points:
    """Where each corner's neighbours in its row put it: the middle between two, or a parabola carried on at the ends."""
    expected = np.empty_like(grid)
    expected[:, 1:-1] = (grid[:, :-2] + grid[:, 2:]) / 2
    if grid.shape[1] > 3:
        expected[:, 0] = 3 * grid[:, 1] - 3 * grid[:, 2] + grid[:, 3]
        expected[:, -1] = 3 * grid[:, -2] - 3 * grid[:, -3] + grid[:, -4]
    else:
        expected[:, 0] = 2 * grid[:, 1] - grid[:, 2]
        expected[:, -1] = 2 * grid[:, -2] - grid[:, -3]
    return expected


def smallest_spacing(corners: Points, board: Chessboard) -> float:
    """Smallest distance between neighbouring corners, px."""
    grid = corners.reshape(board.rows, board.columns, 2)
    along, down = np.diff(grid, axis=1), np.diff(grid, axis=0)
    return float(min(np.linalg.norm(along, axis=-1).min(), np.linalg.norm(down, axis=-1).min()))


def largest_bend(corners: Points, board: Chessboard) -> float:
    """Largest departure of a corner from the middle of its neighbours, as a share of their distance.

    A plane seen by a camera gives smoothly growing spacings; a mis-found corner jumps.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    worst = 0.0
    for axis in (0, 1):
        lines = np.moveaxis(grid, axis, 0)
        bend = np.linalg.norm(lines[2:] - 2 * lines[1:-1] + lines[:-2], axis=-1)
        step = np.linalg.norm(lines[2:] - lines[:-2], axis=-1) / 2
        worst = max(worst, float((bend / np.maximum(step, 1e-9)).max()))
    return worst
