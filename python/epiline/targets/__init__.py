"""Finds boards in photographs. Needs OpenCV when boards are looked for, not before."""

from epiline.targets.boards import Chessboard, parse_board, parse_length
from epiline.targets.observations import Observations, View
from epiline.targets.search import find_boards

__all__ = ["Chessboard", "Observations", "View", "find_boards", "parse_board", "parse_length"]
