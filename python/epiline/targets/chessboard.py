"""A chessboard's inner corners in one photograph: OpenCV's detector, then a refinement that follows the board."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Chessboard
from epiline.targets.failure import NotFoundError
from epiline.targets.grid import MAX_IRREGULARITY, irregularity, smallest_spacing
from epiline.targets.observations import Points
from epiline.targets.refinement import refined, windows

# Closer neighbours lie inside the smallest window.
_MIN_SPACING_PX = 3.0
# Boards in larger photographs are looked for in a copy of this many pixels a side: the detector's thresholds are
# local, and the time it spends on a texture that is no board grows faster than the area (opencv#23558).
_SEARCH_SIDE_PX = 1600
# So much of the spacing is more than any window, so it means that the corner settled on a neighbour.
_MAX_REFINEMENT_SHARE = 0.5


@dataclass(frozen=True)
class Sighting:
    """A board in one photograph.

    Attributes
    ----------
    corners_px : (N, 2) float64
        Row by row, in an order the detector chose.
    remark : str
        What went wrong on the way, if anything did: the first grid found was not regular.
    """

    corners_px: Points
    remark: str = ""


def find_corners(image: NDArray[np.uint8], board: Chessboard, *, half_window: int | None = None) -> Sighting:
    """Inner corners of a board, refined to fractions of a pixel.

    Where the grid found at one size of the photograph is not regular, the next size is tried: a row that ended on
    a wrong edge at 10 px a square ends on the right one at 20.

    Parameters
    ----------
    image : (H, W) uint8
    board : Chessboard
    half_window : int, optional
        Half the side of a square refinement window, px; by default the window follows the board at each corner.

    Returns
    -------
    Sighting

    Raises
    ------
    NotFoundError
        No board, or none whose grid is regular.
    """
    failure = ""
    for scale, flags in _attempts(max(image.shape)):
        rough = _detect(image, board, scale, flags)
        if rough is None:
            continue
        corners, problem = _refine(image, rough, board, half_window)
        if not problem:
            return Sighting(corners, f"{failure}; found again at {scale:g} times the size" if failure else "")
        failure = failure or problem
    raise NotFoundError(failure or f"no {board} board")


def _attempts(side_px: int) -> Iterator[tuple[float, int]]:
    """Scales to look at the photograph, and the detector's flags."""
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    if side_px > _SEARCH_SIDE_PX:
        yield _SEARCH_SIDE_PX / side_px, flags
        # A board too small for the copy; the detector's own quick look bounds the time.
        yield 1.0, flags | cv2.CALIB_CB_FAST_CHECK
        return
    yield 1.0, flags
    if 2 * side_px <= _SEARCH_SIDE_PX:
        yield 2.0, flags


def _detect(image: NDArray[np.uint8], board: Chessboard, scale: float, flags: int) -> Points | None:
    copy = image
    if scale != 1.0:
        kind = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        copy = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=kind), np.uint8)
    found, corners = cv2.findChessboardCorners(copy, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    # Pixel centres, not pixel borders, are whole numbers: hence the half pixel on both sides of the scaling.
    return (np.asarray(corners, np.float64).reshape(-1, 2) + 0.5) / scale - 0.5


def _refine(image: NDArray[np.uint8], rough: Points, board: Chessboard, half_window: int | None) -> tuple[Points, str]:
    """The refined corners, and what is wrong with them."""
    spacing = smallest_spacing(rough, board)
    if spacing < _MIN_SPACING_PX:
        return rough, f"two corners are {spacing:.1f} px apart; they must be {_MIN_SPACING_PX:g} px or more"
    if half_window is None:
        corners = refined(image, rough, windows(rough.reshape(board.rows, board.columns, 2)))
    else:
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)
        start = rough.astype(np.float32).reshape(-1, 1, 2)
        square = cv2.cornerSubPix(image, start, (half_window, half_window), (-1, -1), criteria)
        corners = np.asarray(square, np.float64).reshape(-1, 2)
    moved = float(np.linalg.norm(corners - rough, axis=1).max())
    if moved > _MAX_REFINEMENT_SHARE * spacing:
        return corners, f"refinement moved a corner by {moved:.1f} px, {moved / spacing:.2f} of the spacing"
    off = irregularity(corners, board)
    if off > MAX_IRREGULARITY:
        return corners, f"the grid is not regular: a corner is off by {off:.2f} of the spacing"
    return corners, ""
