"""Calibration boards: what they look like, and how a person writes them."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

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
            value = getattr(self, name)
            if not 3 <= value <= 100:
                raise ValueError(f"{name} = {value}: a board has 3 to 100 inner corners a side")
        if not (math.isfinite(self.square_m) and self.square_m > 0):
            raise ValueError(f"square_m = {self.square_m} m: must be positive")

    @property
    def points_m(self) -> NDArray[np.float64]:
        """(columns·rows, 3) corners in the board's frame, row by row, metres; z = 0."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float64) * self.square_m

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"


def parse_board(text: str) -> tuple[int, int]:
    """Inner corners from ``"9x6"``: columns, rows. Raises ValueError for anything else."""
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
