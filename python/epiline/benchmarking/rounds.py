"""Times several contestants in turns, so that whatever else the machine does meets them all alike."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline.benchmarking.contestants import Contestant

Seconds: TypeAlias = NDArray[np.float64]

# Fewer repetitions have no quartiles worth printing.
_FEWEST = 3
# But nobody waits for the plain reference to match the largest image three times.
_LONG_S = 5.0


@dataclass(frozen=True)
class Ratio:
    """How many times as long one took as the other: median and quartiles over repetitions."""

    median: float
    low: float
    high: float


def time_in_turns(contestants: Sequence[Contestant], repeats: int, budget_s: float, *, one_thread: bool) -> Seconds:
    """Seconds (repetitions, contestants); a first turn warms caches and buffers and is not counted.

    One thread is timed by its own clock, which stands still while the machine does something else; several only have
    the wall's. Stops early, after three repetitions at least, when `budget_s` is used up. A first turn that alone takes
    that long counts as one of the three: what it warms is little of it, and the median passes over it. It is the only
    one if it is itself a mean over seconds of whatever the machine does.
    """
    clock = time.thread_time if one_thread else time.perf_counter

    def turn() -> list[float]:
        taken = []
        for contestant in contestants:
            start = clock()
            contestant.work()
            taken.append(clock() - start)
        return taken

    begun = time.perf_counter()
    first = turn()
    warm = time.perf_counter()
    if warm - begun >= _LONG_S:
        return np.array([first])
    turns = [first] if warm - begun >= budget_s else []
    while len(turns) < repeats and (len(turns) < _FEWEST or time.perf_counter() - warm < budget_s):
        turns.append(turn())
    return np.array(turns)


def ratio(slower: Seconds, faster: Seconds) -> Ratio:
    """Of two columns of `time_in_turns`: each repetition has its ratio, for both met the same moment."""
    low, median, high = np.percentile(slower / faster, (25, 50, 75))
    return Ratio(float(median), float(low), float(high))
