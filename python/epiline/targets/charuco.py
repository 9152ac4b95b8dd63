"""A ChArUco board's corners in one photograph, by OpenCV's detector: whatever part of the board is in sight."""

from __future__ import annotations

import functools

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Charuco
from epiline.targets.failure import NotFoundError
from epiline.targets.grid import on_grid
from epiline.targets.observations import MIN_CORNERS, Points
from epiline.targets.refinement import refined, windows

# Markers that must be read before anything is said about a board that has no corners.
_MIN_MARKERS = 4
# Half a refinement window is at least this wide, even if that is more than the gap between square and marker: the rim
# of a marker is parallel to the edges and harms less than a window that is smaller than their blur.
_MIN_HALF_WINDOW_PX = 4.0


def find_charuco(image: NDArray[np.uint8], board: Charuco) -> tuple[Points, NDArray[np.int64]]:
    """Corners between markers, and which of the board's they are.

    Boards with an even number of rows begin with a white square since OpenCV 4.6 and with a black one before: both
    are tried.

    Parameters
    ----------
    image : (H, W) uint8
    board : Charuco

    Returns
    -------
    corners_px : (N, 2) float64
    ids : (N,) int64
        Rows of the board's ``points_m``, ascending.

    Raises
    ------
    NotFoundError
        Too few corners; a mirrored photograph is recognised as such.
    """
    corners, ids, markers = _best(image, board)
    if len(ids) >= MIN_CORNERS:
        order = np.argsort(ids)
        return _refined(image, corners[order], ids[order], board), ids[order]
    mirrored = np.ascontiguousarray(image[:, ::-1])
    if len(_best(mirrored, board)[1]) >= MIN_CORNERS:
        raise NotFoundError("the photograph is mirrored: the board's markers can be read only when it is flipped")
    if markers >= _MIN_MARKERS:
        raise NotFoundError(
            f"{markers} markers of {board.dictionary} are in sight, but not where a board of {board.columns}x"
            f"{board.rows} squares has them: count squares, not corners, and check columns, rows and dictionary"
        )
    raise NotFoundError(f"no {board} board: {markers} markers of {board.dictionary} in sight")


def _refined(image: NDArray[np.uint8], corners: Points, ids: NDArray[np.int64], board: Charuco) -> Points:
    """Corners refined in windows that reach to the markers, or a little into them."""
    gap_share = (1 - board.marker_m / board.square_m) / 2
    half_sides = windows(on_grid(corners, ids, board), gap_share, _MIN_HALF_WINDOW_PX)
    return refined(image, corners, half_sides[:, ids])


def check_dictionary(board: Charuco) -> None:
    """Raises ValueError unless OpenCV knows the board's dictionary and it has enough markers."""
    _dictionary(board)


def _best(image: NDArray[np.uint8], board: Charuco) -> tuple[Points, NDArray[np.int64], int]:
    """Corners and ids of the layout that has more of them, and the markers read."""
    layouts = (False, True) if board.rows % 2 == 0 else (False,)
    markers, marker_ids, _ = _marker_detector(board).detectMarkers(image)
    nothing: tuple[Points, NDArray[np.int64]] = (np.empty((0, 2)), np.empty(0, np.int64))
    if marker_ids is None or len(marker_ids) < _MIN_MARKERS:
        return *nothing, 0 if marker_ids is None else len(marker_ids)
    found = [nothing]
    for layout in layouts:
        detector = _board_detector(board, legacy_layout=layout)
        corners, ids, _, _ = detector.detectBoard(image, markerCorners=markers, markerIds=marker_ids)
        if ids is not None and corners is not None:
            found.append((np.asarray(corners, np.float64).reshape(-1, 2), np.asarray(ids, np.int64).ravel()))
    return *max(found, key=lambda one: len(one[1])), len(marker_ids)


def _dictionary(board: Charuco) -> cv2.aruco.Dictionary:
    number = getattr(cv2.aruco, board.dictionary, None)
    if number is None:
        raise ValueError(f"dictionary = {board.dictionary!r}: not one of OpenCV's")
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    needed, held = board.columns * board.rows // 2, len(dictionary.bytesList)
    if held < needed:
        raise ValueError(
            f"dictionary = {board.dictionary!r} has {held} markers; "
            f"a board of {board.columns}x{board.rows} squares needs {needed}"
        )
    return dictionary


@functools.lru_cache(maxsize=8)
def _marker_detector(board: Charuco) -> cv2.aruco.ArucoDetector:
    return cv2.aruco.ArucoDetector(_dictionary(board))


@functools.lru_cache(maxsize=8)
def _board_detector(board: Charuco, *, legacy_layout: bool) -> cv2.aruco.CharucoDetector:
    layout = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square_m, board.marker_m, _dictionary(board))
    layout.setLegacyPattern(legacy_layout)
    return cv2.aruco.CharucoDetector(layout)
