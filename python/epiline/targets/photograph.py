"""One photograph: what of the board is in it, in a form that can be kept in a file."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Board, Chessboard
from epiline.targets.observations import Corners, Points

Photograph: TypeAlias = "str | os.PathLike[str] | NDArray[np.uint8]"


@dataclass(frozen=True)
class Look:
    """What a look at one photograph gave.

    Attributes
    ----------
    size : (width, height) or None
        Pixels; None if the file could not be read.
    readings : tuple of Corners
        The board, once for each way to number its corners that the picture allows; empty if there is none.
    failure : str
        Why there is none.
    """

    size: tuple[int, int] | None
    readings: tuple[Corners, ...]
    failure: str = ""

    def as_json(self) -> dict[str, Any]:
        """Numbers and text only; `from_json` gives the same look back, to the last bit."""
        return {
            "size": self.size,
            "failure": self.failure,
            "readings": [
                {
                    "px": seen.px.ravel().tolist(),
                    "ids": seen.ids.tolist(),
                    "edge_width_px": seen.edge_width_px if np.isfinite(seen.edge_width_px) else None,
                    "remark": seen.remark,
                    "found_again": seen.found_again,
                }
                for seen in self.readings
            ],
        }

    @staticmethod
    def from_json(value: Any) -> Look:
        """Raises KeyError, TypeError or ValueError for what `as_json` did not write."""
        readings = tuple(
            Corners(
                np.asarray(seen["px"], np.float64).reshape(-1, 2),
                np.asarray(seen["ids"], np.int64),
                float("nan") if seen["edge_width_px"] is None else float(seen["edge_width_px"]),
                str(seen["remark"]),
                bool(seen["found_again"]),
            )
            for seen in value["readings"]
        )
        if any(len(seen.px) != len(seen.ids) for seen in readings):
            raise ValueError("corners without ids")
        size = value["size"]
        return Look(None if size is None else (int(size[0]), int(size[1])), readings, str(value["failure"]))


def look_at(photograph: Photograph, board: Board, half_window: int | None = None) -> Look:
    """Looks for a board in one photograph.

    Parameters
    ----------
    photograph : path or (H, W) or (H, W, 3) uint8 array
    board : Chessboard or Charuco
    half_window : int, optional
        Half the side of the window in which a chessboard's corner is refined, px; follows the board if not given.

    Returns
    -------
    Look
        An unreadable file and a missing board are failures in words, not exceptions.
    """
    from epiline.targets.failure import NotFoundError

    try:
        image = read_grey(photograph)
    except (OSError, ValueError) as error:
        return Look(None, (), str(error))
    size = (image.shape[1], image.shape[0])
    try:
        readings = _chessboard(image, board, half_window) if isinstance(board, Chessboard) else _charuco(image, board)
    except NotFoundError as failure:
        return Look(size, (), str(failure))
    return Look(size, readings)


def read_grey(photograph: Photograph) -> NDArray[np.uint8]:
    """(H, W) uint8 of a file or an array. Raises OSError or ValueError."""
    from epiline._core import grey
    from epiline._images import read_image

    return grey(photograph if isinstance(photograph, np.ndarray) else read_image(photograph))


def _chessboard(image: NDArray[np.uint8], board: Chessboard, half_window: int | None) -> tuple[Corners, ...]:
    from epiline.targets.chessboard import find_corners
    from epiline.targets.grid import readings

    sighting = find_corners(image, board, half_window=half_window)
    ids = np.arange(board.columns * board.rows, dtype=np.int64)
    return tuple(
        _corners(image, px, ids, board, sighting.remark, found_again=bool(sighting.remark))
        for px in readings(image, sighting.corners_px, board)
    )


def _charuco(image: NDArray[np.uint8], board: Board) -> tuple[Corners, ...]:
    from epiline.targets.boards import Charuco
    from epiline.targets.charuco import find_charuco

    assert isinstance(board, Charuco)
    return (_corners(image, *find_charuco(image, board), board, "", found_again=False),)


def _corners(
    image: NDArray[np.uint8], px: Points, ids: NDArray[np.int64], board: Board, remark: str, *, found_again: bool
) -> Corners:
    from epiline.targets.grid import on_grid
    from epiline.targets.sharpness import edge_width_px

    return Corners(px, ids, edge_width_px(image, on_grid(px, ids, board)), remark, found_again)
