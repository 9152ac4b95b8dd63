"""Pairs of photographs to observations: every pair is used or says why not."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from epiline.targets.boards import Board, Chessboard
from epiline.targets.observations import MIN_CORNERS, SIDES, Corners, Observations, View
from epiline.targets.photograph import Look, Photograph, look_at, read_grey

if TYPE_CHECKING:
    from epiline.targets.screening import LensModel

# Photographs that are looked at again when a count may be wrong.
_SAMPLE = 4


def find_boards(
    left_images: Sequence[Photograph | None],
    right_images: Sequence[Photograph | None],
    board: Board,
    *,
    corner_half_window: int | None = None,
    threads: int | None = None,
    cache: str | os.PathLike[str] | None = None,
    progress: Callable[[], object] | None = None,
    model: LensModel = "brown4",
) -> Observations:
    """Finds a board in pairs of photographs, and says of every pair that is not used why.

    Beside pairs without a board, it leaves out repeated views, blurred ones, boards whose grid was mis-found at
    first (if there are enough others), and pairs that are not of one moment.

    Parameters
    ----------
    left_images, right_images : sequences of paths or (H, W) or (H, W, 3) uint8 arrays
        As many of each; entry by entry they belong together. None where a photograph has no partner.
    board : Chessboard or Charuco
        A ChArUco board may be in sight in part, and in a different part for each camera.
    corner_half_window : int, optional
        Half the side of the window in which a chessboard's corner is refined, px. By default it follows the board in
        each view. ChArUco corners have windows of their own, limited by the markers.
    threads : int, optional
        All cores by default; the environment's EPILINE_THREADS caps them.
    cache : path, optional
        File that keeps what was found in each photograph; a photograph that has not changed is not looked at again,
        so that a run that was broken off goes on where it was.
    progress : callable, optional
        Called after each pair.
    model : str
        Lens of :func:`epiline.calibrate` under which views are compared with each other.

    Returns
    -------
    Observations

    Raises
    ------
    ValueError
        The lists are empty or differ in length, the board is found in no pair (with what it looks like instead), or
        an argument is out of range.
    OSError
        The cache cannot be written, or is a file of another kind.
    """
    if len(left_images) != len(right_images):
        raise ValueError(f"{len(left_images)} left and {len(right_images)} right photographs: each needs its partner")
    if not len(left_images):
        raise ValueError("no photographs given")
    if corner_half_window is not None and corner_half_window < 1:
        raise ValueError(f"corner_half_window = {corner_half_window} px: must be at least 1")
    if threads is not None and threads < 1:
        raise ValueError(f"threads = {threads}: must be at least 1")
    if not isinstance(board, Chessboard):
        from epiline.targets.charuco import check_dictionary

        check_dictionary(board)
    pairs = list(zip(left_images, right_images, strict=True))
    looks = _looks(pairs, board, corner_half_window, threads, cache, progress)
    views = [_view(i, *pair, *look) for i, (pair, look) in enumerate(zip(pairs, looks, strict=True))]
    sizes = [look[0].size for view, look in zip(views, looks, strict=True) if view.accepted and look[0] is not None]
    if not sizes:
        raise ValueError(_nowhere(pairs, looks, views, board))
    # The size that most pairs have; a stray photograph must not decide for the others.
    size = max(dict.fromkeys(sizes), key=sizes.count)
    assert size is not None, "accepted views were read"
    from epiline.targets.screening import screened

    of_one_size = tuple(_of_size(view, look, size) for view, look in zip(views, looks, strict=True))
    remarks = _larger_than_asked(pairs, of_one_size, board)
    return Observations(board, size, screened(of_one_size, board, size, model), remarks)


_Pair = tuple["Photograph | None", "Photograph | None"]
_PairLook = tuple["Look | None", "Look | None"]


def _looks(
    pairs: list[_Pair],
    board: Board,
    half_window: int | None,
    threads: int | None,
    cache: str | os.PathLike[str] | None,
    progress: Callable[[], object] | None,
) -> list[_PairLook]:
    """A look at every photograph, in parallel, from the cache where that has it."""
    from epiline.targets.cache import CornerCache

    kept = None if cache is None else CornerCache(cache, board, half_window)

    def one(photograph: Photograph | None) -> Look | None:
        if photograph is None:
            return None
        known = None if kept is None else kept.get(photograph)
        if known is not None:
            return known
        look = look_at(photograph, board, half_window)
        if kept is not None:
            kept.put(photograph, look)
        return look

    def both(pair: _Pair) -> _PairLook:
        result = one(pair[0]), one(pair[1])
        if progress is not None:
            progress()
        return result

    pool = ThreadPoolExecutor(_workers(threads))
    try:
        return list(pool.map(both, pairs))
    finally:
        # Also after Ctrl-C: what was found until then is not lost, and what was not begun is not.
        pool.shutdown(cancel_futures=True)
        if kept is not None:
            kept.flush()


def _view(
    number: int, left: Photograph | None, right: Photograph | None, left_look: Look | None, right_look: Look | None
) -> View:
    names = _name(number, "left", left), _name(number, "right", right)
    looks = (left_look, right_look)
    if left_look is not None and right_look is not None and left_look.size and right_look.size:
        if left_look.size != right_look.size:
            shapes = [f"{width}x{height}" for width, height in (left_look.size, right_look.size)]
            return View(*names, None, None, False, f"left is {shapes[0]} px, right is {shapes[1]} px")
        if left_look.readings and right_look.readings:
            return _pair(names, left_look, right_look)
    seen = [look.readings[0] if look is not None and look.readings else None for look in looks]
    failures = [_failure(look) for look in looks]
    if failures[0] == failures[1] and left_look is not None and left_look.size:
        reason = f"left and right: {failures[0]}"
    else:
        # An unreadable file's message names it; other failures get their side.
        reason = "; ".join(
            failure if look is not None and look.size is None else f"{side}: {failure}"
            for side, failure, look in zip(SIDES, failures, looks, strict=True)
            if failure
        )
    return View(*names, seen[0], seen[1], accepted=False, reason=reason, usable_alone=True)


def _failure(look: Look | None) -> str:
    return "there is no such photograph" if look is None else look.failure


def _pair(names: tuple[str, str], left_look: Look, right_look: Look) -> View:
    """Both saw the board: the right one numbers its corners as the left one does."""
    from epiline.targets.grid import closest_reading

    left, right = left_look.readings[0], right_look.readings[0]
    if len(right_look.readings) > 1:
        ways = [reading.px for reading in right_look.readings]
        closest = closest_reading(left.px, ways)
        right = next(reading for reading in right_look.readings if reading.px is closest)
    view = View(*names, left, right, accepted=True, reason="")
    common = len(view.common_ids)
    if common < MIN_CORNERS:
        reason = f"the cameras see different parts of the board: {common} corners in common, {MIN_CORNERS} are needed"
        return replace(view, accepted=False, reason=reason, usable_alone=True)
    return view


def _name(number: int, side: str, image: Photograph | None) -> str:
    if image is None:
        return ""
    return f"{side} {number}" if isinstance(image, np.ndarray) else Path(image).name


def _workers(threads: int | None) -> int:
    """As many as asked for or as there are cores, at most EPILINE_THREADS."""
    wanted = threads or os.cpu_count() or 1
    cap = os.environ.get("EPILINE_THREADS", "")
    return min(wanted, int(cap)) if cap.isdecimal() and int(cap) > 0 else wanted


def _of_size(view: View, looks: _PairLook, size: tuple[int, int]) -> View:
    own = next((look.size for look in looks if look is not None and look.readings and look.size != size), None)
    if own is None or not (view.accepted or view.usable_alone):
        return view
    reason = f"is {own[0]}x{own[1]} px, most photographs are {size[0]}x{size[1]} px"
    return replace(view, accepted=False, reason=reason, usable_alone=False)


def _nowhere(pairs: list[_Pair], looks: list[_PairLook], views: list[View], board: Board) -> str:
    """Why no pair has the board, and what it looks like instead."""
    reasons = "; ".join(list(dict.fromkeys(view.reason for view in views))[:3])
    text = f"no {board} board found in any of {len(pairs)} pairs: {reasons}"
    if isinstance(board, Chessboard):
        seen = _other_counts(pairs, looks, board)
        if seen:
            text += f". It looks like a board of {seen} inner corners{_squares_counted(board, seen)}"
    return text


def _other_counts(pairs: list[_Pair], looks: list[_PairLook], board: Chessboard) -> Chessboard | None:
    """The board that most of a few photographs show instead."""
    from epiline.targets.counts import other_count

    photographs = [
        photograph
        for pair, look in zip(pairs, looks, strict=True)
        for photograph, one in zip(pair, look, strict=True)
        if photograph is not None and one is not None and one.size is not None
    ]
    step = max(1, len(photographs) // _SAMPLE)
    found = [other_count(read_grey(photograph), board) for photograph in photographs[::step][:_SAMPLE]]
    boards = [one for one in found if one is not None]
    return max(boards, key=boards.count) if boards else None


def _squares_counted(asked: Chessboard, seen: Chessboard) -> str:
    if (asked.columns - 1, asked.rows - 1) == (seen.columns, seen.rows):
        return f" ({asked} are its squares; count the corners between them)"
    return ""


def _larger_than_asked(pairs: list[_Pair], views: tuple[View, ...], board: Board) -> tuple[str, ...]:
    """Says so where the board found goes on beyond the corners asked for."""
    if not isinstance(board, Chessboard):
        return ()
    from epiline.targets.counts import count_beyond

    def whole(corners: Corners | None) -> bool:
        return corners is not None and len(corners.ids) == board.columns * board.rows

    found = [
        (photograph, corners.px)
        for pair, view in zip(pairs, views, strict=True)
        for photograph, corners in zip(pair, (view.left, view.right), strict=True)
        if photograph is not None and corners is not None and whole(corners)
    ]
    step = max(1, len(found) // (2 * _SAMPLE))
    sample = found[::step][: 2 * _SAMPLE]
    larger = [count_beyond(read_grey(photograph), px, board) for photograph, px in sample]
    counts = [count for count in larger if count is not None]
    if 2 * len(counts) <= len(sample):
        return ()
    columns, rows = max(counts, key=counts.count)
    asked, seen = f"{board.columns}x{board.rows}", f"{columns}x{rows}"
    return (
        f"the board looks like {seen} inner corners, not {asked}: squares go on beyond the corners found, "
        "so each view may show another part of the board",
    )
