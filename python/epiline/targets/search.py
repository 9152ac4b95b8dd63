"""Pairs of photographs to observations: every pair is used or says why not."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline.targets.boards import Chessboard
from epiline.targets.observations import Observations, Points, View

Photograph: TypeAlias = "str | os.PathLike[str] | NDArray[np.uint8]"


def find_boards(
    left_images: Sequence[Photograph],
    right_images: Sequence[Photograph],
    board: Chessboard,
    *,
    corner_half_window: int | None = None,
    threads: int | None = None,
    progress: Callable[[], object] | None = None,
) -> Observations:
    """Finds a chessboard in pairs of photographs.

    Parameters
    ----------
    left_images, right_images : sequences of paths or (H, W) or (H, W, 3) uint8 arrays
        As many of each; entry by entry they belong together.
    board : Chessboard
    corner_half_window : int, optional
        Half the side of the window in which a corner is refined, px. By default it follows the board in each view.
    threads : int, optional
        All cores by default; the environment's EPILINE_THREADS caps them.
    progress : callable, optional
        Called after each pair.

    Returns
    -------
    Observations
        With a reason for every pair that is not used.

    Raises
    ------
    ValueError
        The lists are empty or differ in length, the board is found in no pair, or an argument is out of range.
    """
    if len(left_images) != len(right_images):
        raise ValueError(f"{len(left_images)} left and {len(right_images)} right photographs: each needs its partner")
    if not len(left_images):
        raise ValueError("no photographs given")
    if corner_half_window is not None and corner_half_window < 1:
        raise ValueError(f"corner_half_window = {corner_half_window} px: must be at least 1")
    if threads is not None and threads < 1:
        raise ValueError(f"threads = {threads}: must be at least 1")

    def one(job: tuple[int, Photograph, Photograph]) -> tuple[View, tuple[int, int] | None]:
        number, left, right = job
        result = _look_at(left, right, _names(number, left, right), board, corner_half_window)
        if progress is not None:
            progress()
        return result

    jobs = [(i, left, right) for i, (left, right) in enumerate(zip(left_images, right_images, strict=True))]
    with ThreadPoolExecutor(_workers(threads)) as pool:
        looked = list(pool.map(one, jobs))
    sizes = [size for view, size in looked if view.accepted and size is not None]
    if not sizes:
        reasons = {view.reason: None for view, _ in looked}
        raise ValueError(f"no {board} board found in any of {len(jobs)} pairs: {'; '.join(list(reasons)[:3])}")
    # The size that most pairs have; a stray photograph must not decide for the others.
    size = max(dict.fromkeys(sizes), key=sizes.count)
    views = tuple(_of_size(view, own, size) for view, own in looked)
    return Observations(board, size, views)


def _names(number: int, left: Photograph, right: Photograph) -> tuple[str, str]:
    def name(side: str, image: Photograph) -> str:
        return f"{side} {number}" if isinstance(image, np.ndarray) else Path(image).name

    return name("left", left), name("right", right)


def _look_at(
    left: Photograph, right: Photograph, names: tuple[str, str], board: Chessboard, half_window: int | None
) -> tuple[View, tuple[int, int] | None]:
    from epiline.targets.chessboard import NotFoundError, Sighting, find_corners
    from epiline.targets.grid import closest_reading, readings

    def rejected(reason: str, left_px: Points | None = None, right_px: Points | None = None) -> tuple[View, None]:
        return View(*names, left_px, right_px, accepted=False, reason=reason), None

    try:
        images = {"left": _grey(left), "right": _grey(right)}
    except (OSError, ValueError) as error:
        return rejected(str(error))
    if images["left"].shape != images["right"].shape:
        shapes = [f"{image.shape[1]}x{image.shape[0]}" for image in images.values()]
        return rejected(f"left is {shapes[0]} px, right is {shapes[1]} px")
    seen: dict[str, Sighting] = {}
    failures: dict[str, str] = {}
    for side, image in images.items():
        try:
            seen[side] = find_corners(image, board, half_window=half_window)
        except NotFoundError as failure:
            failures[side] = str(failure)
    ways = {side: readings(images[side], sighting.corners_px, board) for side, sighting in seen.items()}
    if failures:
        same = len(failures) == 2 and len(set(failures.values())) == 1
        sides = {"left and right": failures["left"]} if same else failures
        reason = "; ".join(f"{side}: {text}" for side, text in sides.items())
        return rejected(reason, *(ways[side][0] if side in ways else None for side in images))
    left_px = ways["left"][0]
    right_px = closest_reading(left_px, ways["right"])
    remark = "; ".join(f"{side}: {sighting.remark}" for side, sighting in seen.items() if sighting.remark)
    height, width = images["left"].shape
    return View(*names, left_px, right_px, accepted=True, reason="", remark=remark), (width, height)


def _grey(image: Photograph) -> NDArray[np.uint8]:
    from epiline._core import grey
    from epiline._images import read_image

    return grey(image if isinstance(image, np.ndarray) else read_image(image))


def _workers(threads: int | None) -> int:
    """As many as asked for or as there are cores, at most EPILINE_THREADS."""
    wanted = threads or os.cpu_count() or 1
    cap = os.environ.get("EPILINE_THREADS", "")
    return min(wanted, int(cap)) if cap.isdecimal() and int(cap) > 0 else wanted


def _of_size(view: View, own: tuple[int, int] | None, size: tuple[int, int]) -> View:
    if own is None or own == size:
        return view
    reason = f"is {own[0]}x{own[1]} px, most photographs are {size[0]}x{size[1]} px"
    return replace(view, accepted=False, reason=reason)
