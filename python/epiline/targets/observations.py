"""What was found in a set of photographs, and why the rest was not used."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Board

Points = NDArray[np.float64]
Side: TypeAlias = Literal["left", "right"]
SIDES: tuple[Side, Side] = ("left", "right")

# A pose needs four corners; below this a view says little and its homography is noise.
MIN_CORNERS = 6


@dataclass(frozen=True)
class Corners:
    """Corners of a board in one photograph: all of them, or those in sight.

    Attributes
    ----------
    px : (N, 2) float64
        Where the camera saw them, pixels.
    ids : (N,) int64
        Which rows of the board's ``points_m`` they are; ascending.
    edge_width_px : float
        Width of the edges between its squares, from a tenth to nine tenths of their step, median; NaN if unknown.
        Sharp photographs have 1.6 to 6 px, blurred ones more than others of their camera.
    remark : str
        What went wrong on the way, if anything did.
    found_again : bool
        Whether the first grid found in this photograph was irregular, and this is another one.
    """

    px: Points
    ids: NDArray[np.int64]
    edge_width_px: float = float("nan")
    remark: str = ""
    found_again: bool = False


@dataclass(frozen=True)
class View:
    """One pair of photographs, or one photograph whose partner is missing.

    Attributes
    ----------
    name_left, name_right : str
        File names, or "left 3" for arrays; empty if there is no such photograph.
    left, right : Corners or None
        What was found; None where the board was not. The two need not hold the same corners.
    accepted : bool
        Whether the pair takes part in the calibration as a pair.
    reason : str
        Why not; empty if accepted.
    usable_alone : bool
        Whether the corners of a pair that is not accepted are sound by themselves, so that a view seen by one camera
        still informs that camera.
    """

    name_left: str
    name_right: str
    left: Corners | None
    right: Corners | None
    accepted: bool
    reason: str
    usable_alone: bool = False

    @property
    def name(self) -> str:
        """Both names."""
        return " / ".join(filter(None, (self.name_left, self.name_right)))

    @property
    def remark(self) -> str:
        """What went wrong on the way, such as a grid that had to be looked for again."""
        sides = (("left", self.left), ("right", self.right))
        return "; ".join(f"{side}: {seen.remark}" for side, seen in sides if seen is not None and seen.remark)

    @property
    def left_px(self) -> Points | None:
        """Of a pair: the left image of the corners both cameras saw; of others: all that the left one saw."""
        return self._px("left")

    @property
    def right_px(self) -> Points | None:
        """Of a pair: the right image of the corners both cameras saw; of others: all that the right one saw."""
        return self._px("right")

    @property
    def common_ids(self) -> NDArray[np.int64]:
        """(N,) rows of the board's ``points_m`` that both cameras saw, ascending."""
        if self.left is None or self.right is None:
            return np.empty(0, np.int64)
        return np.intersect1d(self.left.ids, self.right.ids, assume_unique=True)

    @property
    def sides_alone(self) -> tuple[Side, ...]:
        """Cameras that a view which is no pair still informs, each by what it saw itself."""
        if self.accepted or not self.usable_alone:
            return ()
        seen = ((side, self.seen(side)) for side in SIDES)
        return tuple(side for side, corners in seen if corners is not None and len(corners.ids) >= MIN_CORNERS)

    def seen(self, side: Side) -> Corners | None:
        """What that camera saw."""
        return self.left if side == "left" else self.right

    def _px(self, side: Side) -> Points | None:
        seen = self.seen(side)
        if seen is None:
            return None
        if self.left is None or self.right is None:
            return seen.px
        return seen.px[np.isin(seen.ids, self.common_ids)]


@dataclass(frozen=True)
class SingleView:
    """A board that only one camera saw, or the corners that only it saw.

    Attributes
    ----------
    name : str
    px : (N, 2) float64
    board_m : (N, 3) float64
    """

    name: str
    px: Points
    board_m: Points


@dataclass(frozen=True)
class CalibrationView:
    """One board as a calibration takes it.

    Attributes
    ----------
    name : str
        Of the photograph; of a pair's left one.
    ids : (N,) int64
        Rows of the board's ``points_m``: corners that at least one camera saw.
    left_px, right_px : (N, 2) float64
        NaN where that camera did not see the corner.
    """

    name: str
    ids: NDArray[np.int64]
    left_px: Points
    right_px: Points

    @staticmethod
    def of(name: str, left: Corners | None, right: Corners | None) -> CalibrationView:
        sides = [seen for seen in (left, right) if seen is not None]
        ids = np.unique(np.concatenate([seen.ids for seen in sides]))
        px = [np.full((len(ids), 2), np.nan) for _ in range(2)]
        for pixels, seen in zip(px, (left, right), strict=True):
            if seen is not None:
                pixels[np.searchsorted(ids, seen.ids)] = seen.px
        return CalibrationView(name, ids, *px)


@dataclass(frozen=True)
class Observations:
    """Corners of one board in many pairs of photographs.

    Attributes
    ----------
    board : Chessboard or Charuco
    image_size : (width, height)
        Of every photograph, pixels.
    views : tuple of View
        Every pair, in the order given.
    remarks : tuple of str
        What is odd about the set as a whole, such as a board that seems to have another row.
    """

    board: Board
    image_size: tuple[int, int]
    views: tuple[View, ...]
    remarks: tuple[str, ...] = field(default=())

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
        """(N, 2) corners in the left photograph of each accepted pair: those that both cameras saw."""
        return [view.left_px for view in self.accepted if view.left_px is not None]

    @property
    def right_px(self) -> list[Points]:
        """(N, 2) the same corners in the right photograph of each accepted pair."""
        return [view.right_px for view in self.accepted if view.right_px is not None]

    @property
    def board_m(self) -> list[Points]:
        """(N, 3) the same corners on the board, metres, for each accepted pair."""
        points_m = self.board.points_m
        return [points_m[view.common_ids] for view in self.accepted]

    def single_views(self, side: Side) -> list[SingleView]:
        """What one camera saw and the other did not, in views that are sound.

        Boards out of the other camera's sight, photographs without a partner, and the corners of a partial view
        that only this camera saw. They carry no constraint between the cameras.
        """
        points_m = self.board.points_m
        singles = []
        for view in self.views:
            seen = view.seen(side)
            if seen is None or not (view.accepted or view.usable_alone):
                continue
            alone = ~np.isin(seen.ids, view.common_ids) if view.accepted else np.ones(len(seen.ids), bool)
            if alone.sum() >= MIN_CORNERS:
                name = view.name_left if side == "left" else view.name_right
                singles.append(SingleView(name, seen.px[alone], points_m[seen.ids[alone]]))
        return singles

    @property
    def calibration_views(self) -> list[CalibrationView]:
        """Everything a calibration can use: the accepted pairs in their order, then views of one camera alone.

        A pair has the corners that either camera saw. The two photographs of a pair that is not of one moment are two
        views.
        """
        views = [CalibrationView.of(view.name_left, view.left, view.right) for view in self.accepted]
        for view in self.rejected:
            if "left" in view.sides_alone:
                views.append(CalibrationView.of(view.name_left, view.left, None))
            if "right" in view.sides_alone:
                views.append(CalibrationView.of(view.name_right, None, view.right))
        return views

    def __len__(self) -> int:
        return len(self.accepted)
