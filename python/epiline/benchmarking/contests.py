"""What is measured: which of ours against which of OpenCV's, at which sizes, and how the answers are checked."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from epiline._core import paper_regions
from epiline.benchmarking import contestants as run
from epiline.benchmarking.contestants import Answer, Contestant
from epiline.benchmarking.pairs import Pair
from epiline.benchmarking.rounds import Seconds, ratio, time_in_turns

Size: TypeAlias = tuple[int, int, int]
"""Width, height, disparities, px."""

SIZES: tuple[Size, ...] = (
    (320, 240, 48),
    (640, 480, 64),
    (640, 480, 128),
    (1280, 720, 128),
    (1920, 1080, 256),
)
QUICK_SIZES: tuple[Size, ...] = ((320, 240, 48), (640, 480, 64))
WINDOWS = (9, 15, 21)
PRESETS = ("fast", "balanced", "accurate")
# Of window sums, besides sad.
METHODS = ("sad5", "census", "bt")
# The paper's image; its four bands are 20 to 50 rows tall.
_BANDED: Size = (320, 240, 48)
_BAND_WINDOW = 15
# Answers of different methods agree when they are within this, px.
_AGREE_PX = 1.0


@dataclass(frozen=True)
class Plan:
    """What to measure; every row and curve point comes from one plan.

    Attributes
    ----------
    repeats, budget_s
        A contest ends after so many repetitions, or so many seconds if that is sooner. With the defaults, every size,
        both thread counts and three levels are meant to take about ten minutes of an idle machine.
    """

    sizes: tuple[Size, ...] = SIZES
    threads: tuple[int, ...] = (1, 2)
    windows: tuple[int, ...] = WINDOWS
    repeats: int = 21
    budget_s: float = 0.8
    tables: bool = True
    curves: bool = False
    pipeline: bool = False


@dataclass(frozen=True)
class Row:
    """One line of a ratio table.

    Attributes
    ----------
    ours, theirs : str
        The contestants; `theirs` is our own single thread in the rows about scaling.
    ratio, ratio_low, ratio_high : float
        How many times faster ours is: median and quartiles.
    check : str
        What `checked` is the share of: ``"equal"`` numbers, or answers that ``"agree"`` within 1 px.
    """

    level: str
    width: int
    height: int
    disparities: int
    threads: int
    tests: bool
    ours: str
    theirs: str
    ratio: float
    ratio_low: float
    ratio_high: float
    ours_ms: float
    theirs_ms: float
    check: str
    checked: float
    ours_density: float
    theirs_density: float

    @property
    def differs(self) -> bool:
        """Whether answers that must be the same numbers are not."""
        return self.check == "equal" and self.checked != 1.0


@dataclass(frozen=True)
class Curve:
    """One point of a scaling curve.

    Attributes
    ----------
    along : str
        What varies: ``"width"``, ``"disparities"`` or ``"window"``.
    per_pixel_disparity : float
        Time per pixel and disparity, relative to the curve's first point.
    ratio : float
        How many times faster than `theirs`.
    """

    level: str
    ours: str
    theirs: str
    along: str
    at: int
    per_pixel_disparity: float
    ratio: float


Check: TypeAlias = Callable[[Answer, Answer], float]


def rows(level: str, pair: Pair, plan: Plan) -> Iterator[Row]:
    """Every row of the plan, measured in this process."""
    import cv2

    for threads in plan.threads:
        cv2.setNumThreads(threads)
        yield from _bands_against_whole(pair.resized(*_BANDED[:2]), plan, {"level": level, "threads": threads})
        for size in plan.sizes:
            scene = pair.resized(*size[:2])
            context = {"level": level, "threads": threads} | dict(
                zip(("width", "height", "disparities"), size, strict=True)
            )
            for tests in (False, True):
                yield from _against_stereo_bm(scene, plan, context | {"tests": tests})
                yield from _methods_against_stereo_bm(scene, plan, context | {"tests": tests})
            for tests in (False, True):
                yield from _against_sgbm(scene, plan, context | {"tests": tests})
            if threads > 1:
                yield from _against_one_thread(scene, plan, context | {"tests": True})


def _against_stereo_bm(pair: Pair, plan: Plan, context: dict[str, Any]) -> Iterator[Row]:
    disparities, tests, threads = context["disparities"], context["tests"], context["threads"]
    for window in plan.windows:
        pairing = (
            run.sad(pair, disparities, window, threads, tests=tests),
            run.stereo_bm(pair, disparities, window, tests=tests),
        )
        times = time_in_turns(pairing, plan.repeats, plan.budget_s, one_thread=threads == 1)
        check = _equal_inside(window // 2, disparities, both_answer=tests)
        yield row(pairing[0], pairing[1], times[:, 0], times[:, 1], "equal", check, context)


def _methods_against_stereo_bm(pair: Pair, plan: Plan, context: dict[str, Any]) -> Iterator[Row]:
    """The other window sums: OpenCV has none of them."""
    disparities, tests, threads = context["disparities"], context["tests"], context["threads"]
    own = [run.method(name, pair, disparities, threads, tests=tests) for name in METHODS]
    peer = run.stereo_bm(pair, disparities, plan.windows[0], tests=tests)
    times = time_in_turns([*own, peer], plan.repeats, plan.budget_s, one_thread=threads == 1)
    for i, mine in enumerate(own):
        yield row(mine, peer, times[:, i], times[:, -1], "agree", agreement, context)


def _against_sgbm(pair: Pair, plan: Plan, context: dict[str, Any]) -> Iterator[Row]:
    disparities, tests, threads = context["disparities"], context["tests"], context["threads"]
    own = [run.preset(name, pair, disparities, threads, tests=tests) for name in PRESETS]
    peers = [run.stereo_sgbm(mode, pair, disparities, tests=tests, padded=False) for mode in run.SGBM_MODES]
    peers.append(run.stereo_sgbm("3WAY", pair, disparities, tests=tests, padded=True))
    times = time_in_turns([*own, *peers], plan.repeats, plan.budget_s, one_thread=threads == 1)
    for i, mine in enumerate(own):
        for j, theirs in enumerate(peers, start=len(own)):
            yield row(mine, theirs, times[:, i], times[:, j], "agree", agreement, context)


def _against_one_thread(pair: Pair, plan: Plan, context: dict[str, Any]) -> Iterator[Row]:
    disparities, threads = context["disparities"], context["threads"]
    for name in PRESETS:
        several, one = (run.preset(name, pair, disparities, count, tests=True) for count in (threads, 1))
        times = time_in_turns((several, one), plan.repeats, plan.budget_s, one_thread=False)
        alone = Contestant(f"{one.name}, one thread", one.work, one.answer)
        yield row(several, alone, times[:, 0], times[:, 1], "equal", _same_everywhere, context)


def _bands_against_whole(pair: Pair, plan: Plan, context: dict[str, Any]) -> Iterator[Row]:
    """The paper's regions alone against the whole image; the name has the share of the rows that their windows need."""
    width, height, disparities = _BANDED
    bands = paper_regions(width, height)
    inside = np.zeros(height, bool)
    for band in bands:
        inside[band.y : band.y + band.height] = True
    for tests in (False, True):
        mine, whole = (
            run.sad(pair, disparities, _BAND_WINDOW, context["threads"], tests=tests, regions=regions)
            for regions in (bands, None)
        )
        times = time_in_turns((mine, whole), plan.repeats, plan.budget_s, one_thread=context["threads"] == 1)
        needed = np.convolve(inside, np.ones(_BAND_WINDOW), "same") > 0
        named = Contestant(f"{len(bands)} bands ({100 * needed.mean():.0f} % of rows)", mine.work, mine.answer)
        against = Contestant("sad, whole image", whole.work, whole.answer)
        size = {"width": width, "height": height, "disparities": disparities, "tests": tests}

        def check(answer: Answer, reference: Answer) -> float:
            return _same_everywhere(answer[inside], reference[inside])

        yield row(named, against, times[:, 0], times[:, 1], "equal", check, context | size)


def row(
    mine: Contestant, theirs: Contestant, own: Seconds, peer: Seconds, kind: str, check: Check, context: dict[str, Any]
) -> Row:
    faster = ratio(peer, own)
    answer, reference = mine.answer(), theirs.answer()
    return Row(
        **context,
        ours=mine.name,
        theirs=theirs.name,
        ratio=round(faster.median, 3),
        ratio_low=round(faster.low, 3),
        ratio_high=round(faster.high, 3),
        ours_ms=round(1e3 * float(np.median(own)), 4),
        theirs_ms=round(1e3 * float(np.median(peer)), 4),
        check=kind,
        checked=round(check(answer, reference), 6),
        ours_density=round(float(np.isfinite(answer).mean()), 4),
        theirs_density=round(float(np.isfinite(reference).mean()), 4),
    )


def _equal_inside(radius: int, disparities: int, *, both_answer: bool) -> Check:
    """The share of equal numbers where both see the same pixels.

    With tests only pixels that both answer count: OpenCV's left-right check compares winners only, so the two reject
    different pixels.
    """

    def check(answer: Answer, reference: Answer) -> float:
        height, width = answer.shape
        inside = np.s_[radius : height - radius, disparities - 1 + radius : width - radius]
        mine, theirs = answer[inside], reference[inside]
        counted = np.isfinite(mine) & np.isfinite(theirs) if both_answer else np.ones(mine.shape, bool)
        return _share(mine == theirs, counted)

    return check


def agreement(answer: Answer, reference: Answer) -> float:
    with np.errstate(invalid="ignore"):
        return _share(np.abs(answer - reference) <= _AGREE_PX, np.isfinite(answer) & np.isfinite(reference))


def _same_everywhere(answer: Answer, reference: Answer) -> float:
    return float(np.mean((answer == reference) | (np.isnan(answer) & np.isnan(reference))))


def _share(flags: np.ndarray[Any, np.dtype[np.bool_]], counted: np.ndarray[Any, np.dtype[np.bool_]]) -> float:
    return float(flags[counted].mean()) if counted.any() else float("nan")
