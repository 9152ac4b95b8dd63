"""What was found in a set of photographs, and why the rest was not used."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Chessboard

Points = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """One pair of photographs.

    Attributes
    ----------
    name_left, name_right : str
        File names, or "left 3" for arrays.
    left_px, right_px : (N, 2) float64 or None
        Corners in the board's order; None where the board was not found.
    accepted : bool
        Whether the pair takes part in the calibration.
    reason : str
        Why not; empty if accepted.
    remark : str
        What went wrong on the way to an accepted pair, such as a grid that had to be looked for again.
    """

    name_left: str
    name_right: str
    left_px: Points | None
    right_px: Points | None
    accepted: bool
    reason: str
    remark: str = ""


@dataclass(frozen=True)
class Observations:
    """Corners of one board in many pairs of photographs.

    Attributes
    ----------
    board : Chessboard
    image_size : (width, height)
        Of every photograph, pixels.
    views : tuple of View
        Every pair, in the order given.
    """

    board: Chessboard
    image_size: tuple[int, int]
    views: tuple[View, ...]

    @property
    def accepted(self) -> list[View]:
        """The pairs that are used."""
        return [view for view in self.views if view.accepted]

    @property
    def rejected(self) -> list[View]:
        """The pairs that are not, each with its reason."""
        return [view for view in self.views if not view.accepted]

    @property
    def left_px(self) -> list[Points]:
        """(N, 2) corners in the left photograph of each accepted pair."""
        return [view.left_px for view in self.accepted if view.left_px is not None]

    @property
    def right_px(self) -> list[Points]:
        """(N, 2) corners in the right photograph of each accepted pair."""
        return [view.right_px for view in self.accepted if view.right_px is not None]

    @property
    def board_m(self) -> list[Points]:
        """(N, 3) the same corners on the board, metres, for each accepted pair."""
        return [self.board.points_m for _ in self.accepted]

    def __len__(self) -> int:
        return len(self.accepted)
