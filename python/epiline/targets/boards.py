"""Calibration boards: what they look like, and how a person writes them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "": 1.0}


@dataclass(frozen=True, kw_only=True)
class Chessboard:
    """A chessboard, described by its inner corners.

    Parameters
    ----------
    columns, rows : int
        Inner corners along the board's x and y axis; a board of 10 x 7 squares has 9 x 6.
    square_m : float
        Side of a square, metres.

    Raises
    ------
    ValueError
        Fewer than 3 corners a side (fewer do not fix a camera), or a size that is not positive.
    """

    columns: int = 9
    rows: int = 6
    square_m: float = 0.025

    def __post_init__(self) -> None:
        for name in ("columns", "rows"):
            _check_count(name, getattr(self, name), 3, "inner corners")
        _check_length("square_m", self.square_m)

    @property
    def corner_grid(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        return self.columns, self.rows

    @property
    def points_m(self) -> NDArray[np.float64]:
        """(columns·rows, 3) corners in the board's frame, row by row, metres; z = 0."""
        return _grid_m(self.corner_grid, self.square_m)

    @property
    def description(self) -> str:
        """For people."""
        return f"{self} inner corners, {1e3 * self.square_m:g} mm"

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"


@dataclass(frozen=True, kw_only=True)
class Charuco:
    """A chessboard with a marker in every white square, so that any part of it tells which part it is.

    Parameters
    ----------
    columns, rows : int
        **Squares** along the board's x and y axis, as OpenCV counts a ChArUco board; its corners are one fewer a side.
    square_m, marker_m : float
        Side of a square and of a marker, metres.
    dictionary : str
        OpenCV's name of the markers' dictionary, such as ``"DICT_4X4_50"``. It must hold a marker for every second
        square. One that is larger than the board's own finds the same markers, with more room for errors.

    Raises
    ------
    ValueError
        Fewer than 4 squares a side, a length that is not positive, a marker as large as its square, or a name that
        is no dictionary's.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str = "DICT_4X4_50"

    def __post_init__(self) -> None:
        for name in ("columns", "rows"):
            _check_count(name, getattr(self, name), 4, "squares")
        for name in ("square_m", "marker_m"):
            _check_length(name, getattr(self, name))
        if self.marker_m >= self.square_m:
            raise ValueError(f"marker_m = {self.marker_m} m: must be less than square_m = {self.square_m} m")
        if not re.fullmatch(r"DICT_\w+", self.dictionary):
            raise ValueError(f"dictionary = {self.dictionary!r}: expected a name of OpenCV's, such as DICT_4X4_50")

    @property
    def corner_grid(self) -> tuple[int, int]:
        """Columns and rows of inner corners."""
        return self.columns - 1, self.rows - 1

    @property
    def points_m(self) -> NDArray[np.float64]:
        """((columns - 1)·(rows - 1), 3) inner corners in the board's frame, row by row, metres; z = 0."""
        return _grid_m(self.corner_grid, self.square_m)

    @property
    def description(self) -> str:
        """For people."""
        sides = f"{1e3 * self.square_m:g} mm squares, {1e3 * self.marker_m:g} mm markers"
        return f"ChArUco, {self.columns}x{self.rows} {sides} of {self.dictionary}"

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows} ChArUco"


Board: TypeAlias = Chessboard | Charuco


def _grid_m(corner_grid: tuple[int, int], square_m: float) -> NDArray[np.float64]:
    x, y = np.meshgrid(np.arange(corner_grid[0]), np.arange(corner_grid[1]))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float64) * square_m


def _check_count(name: str, value: int, least: int, what: str) -> None:
    if not least <= value <= 100:
        raise ValueError(f"{name} = {value}: a board has {least} to 100 {what} a side")


def _check_length(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name} = {value} m: must be positive")


def parse_board(text: str) -> tuple[int, int]:
    """Columns and rows from ``"9x6"``. Raises ValueError for anything else."""
    found = re.fullmatch(r"\s*(\d{1,3})\s*[x×]\s*(\d{1,3})\s*", text, re.IGNORECASE)
    if not found:
        raise ValueError(f"board = {text!r}: write inner corners as columns x rows, such as 9x6")
    return int(found[1]), int(found[2])


def parse_length(text: str) -> float:
    """Metres from ``"25mm"``, ``"2.5cm"``, ``"0.025m"`` or a bare number of metres.

    Raises ValueError for anything else.
    """
    found = re.fullmatch(r"\s*([0-9.]+(?:e-?\d+)?)\s*(mm|cm|m|)\s*", text, re.IGNORECASE)
    try:
        value = float(found[1]) * _METRES[found[2].lower()] if found else math.nan
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"length = {text!r}: write a number with its unit, such as 25mm, 2.5cm or 0.025m")
    return value
