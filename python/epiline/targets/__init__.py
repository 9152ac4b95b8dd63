"""Finds boards in photographs. Needs OpenCV when boards are looked for, not before."""

from epiline.targets.boards import Board, Charuco, Chessboard, parse_board, parse_length
from epiline.targets.observations import Corners, Observations, SingleView, View
from epiline.targets.search import find_boards

__all__ = [
    "Board",
    "Charuco",
    "Chessboard",
    "Corners",
    "Observations",
    "SingleView",
    "View",
    "find_boards",
    "parse_board",
    "parse_length",
]
