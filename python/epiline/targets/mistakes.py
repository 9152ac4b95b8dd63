"""Why a set of corners makes no rig: the mistake that, undone, makes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeAlias

import numpy as np

from epiline._core import Error, calibrate_points
from epiline.targets.boards import Board, Chessboard
from epiline.targets.grid import closest_reading
from epiline.targets.observations import Observations, Points

# A mistake undone must leave less than this share of the error, and what is left must be a calibration's.
_SHARE_LEFT = 0.3
_MAX_RMS_PX = 2.0
# Views to try a hypothesis on.
_MAX_VIEWS = 24

_Sides: TypeAlias = tuple[list[Points], list[Points]]


@dataclass(frozen=True)
class _Hypothesis:
    """A mistake, in words, and how the corners would be without it."""

    text: str
    undo: Callable[[_Sides], _Sides]


def explain(observations: Observations, rms_px: float = float("inf")) -> str:
    """What somebody did with the photographs if undoing it makes a rig of them.

    Parameters
    ----------
    observations : Observations
        Of which no calibration, or a poor one, came out.
    rms_px : float
        Reprojection error of the poor one.

    Returns
    -------
    str
        Empty if none of the mistakes known here explains it.
    """
    step = max(1, len(observations) // _MAX_VIEWS)
    boards = observations.board_m[::step]
    sides = observations.left_px[::step], observations.right_px[::step]
    found = []
    for hypothesis in _hypotheses(observations):
        left, right = hypothesis.undo(sides)
        try:
            fit = calibrate_points(left, right, boards, observations.image_size, held_out=False)
        except (Error, ValueError):
            continue
        if fit.rms_px < min(_MAX_RMS_PX, _SHARE_LEFT * rms_px):
            found.append((fit.rms_px, hypothesis.text))
    if not found:
        return ""
    best_px, text = min(found)
    return f"{text}: with that undone the corners fit to {best_px:.2f} px"


def _hypotheses(observations: Observations) -> list[_Hypothesis]:
    size = np.array(observations.image_size) - 1.0
    board = observations.board

    def one_side(own: list[Points], partner: list[Points], flip: tuple[bool, bool]) -> list[Points]:
        return [closest_reading(other, _flipped(px, board, size, flip)) for px, other in zip(own, partner, strict=True)]

    def left_flipped(flip: tuple[bool, bool], sides: _Sides) -> _Sides:
        return one_side(*sides, flip), sides[1]

    def right_flipped(flip: tuple[bool, bool], sides: _Sides) -> _Sides:
        return sides[0], one_side(sides[1], sides[0], flip)

    hypotheses = [
        _Hypothesis(
            "left and right photographs are swapped (or both are mirrored, or the rig is upside down)",
            lambda sides: (sides[1], sides[0]),
        )
    ]
    flips = [("upside down", (True, True))]
    if isinstance(board, Chessboard):
        # Markers of a mirrored ChArUco board cannot be read: it is recognised when boards are looked for.
        flips.append(("mirrored", (True, False)))
    for how, flip in flips:
        hypotheses += [
            _Hypothesis(f"the left photographs are {how}", partial(left_flipped, flip)),
            _Hypothesis(f"the right photographs are {how}", partial(right_flipped, flip)),
        ]
    if isinstance(board, Chessboard):
        # Flipping both pictures top to bottom leaves a rig, so one cannot tell which of them was.
        text = "the photographs of one camera, left or right, are flipped top to bottom"
        hypotheses.append(_Hypothesis(text, partial(right_flipped, (False, True))))
    return hypotheses


def _flipped(px: Points, board: Board, size: Points, flip: tuple[bool, bool]) -> list[Points]:
    """Corners of the photograph flipped along x, y or both, in the orders in which they are the board's.

    A chessboard is its own mirror image but for the way its corners are numbered.
    """
    flipped = np.where(flip, size - px, px)
    if flip[0] == flip[1]:
        return [flipped, flipped[::-1]] if _is_symmetric(board) else [flipped]
    columns, rows = board.corner_grid
    grid = flipped.reshape(rows, columns, 2)
    return [np.ascontiguousarray(way).reshape(-1, 2) for way in (grid[::-1], grid[:, ::-1])]


def _is_symmetric(board: Board) -> bool:
    """Whether the board turned by half looks the same."""
    return isinstance(board, Chessboard) and (board.columns + board.rows) % 2 == 0
