"""The search: the best preset first, then one parameter after the other, each kept only if it pays."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epiline._core import StereoMatcher
from epiline.tuning.judges import Judge
from epiline.tuning.objective import Objective, Quality, mean_quality
from epiline.tuning.ranges import DisparityRange

PRESETS = ("fast", "balanced", "accurate")
_SAD: dict[str, tuple[Any, ...]] = {
    "block_size": (7, 9, 11, 15, 21),
    "prefilter_cap": (15, 31, 63),
    "uniqueness_ratio": (0, 5, 10, 15, 20),
    "texture_threshold": (0, 10, 200, 500),
    "speckle_size": (0, 100, 200, 400),
    "subpixel": (True, "parabola"),
}
_SGM: dict[str, tuple[Any, ...]] = {
    "block_size": (1, 3, 5),
    "prefilter_cap": (15, 31, 63),
    "uniqueness_ratio": (0, 5, 10, 15),
    "texture_threshold": (0, 10, 50),
    "speckle_size": (0, 100, 200, 400),
    "subpixel": (True, "parabola"),
}
# Percentage points: less is noise of the scenes, and the preset's value is the better guess for others.
_WORTH_A_CHANGE = 0.05


@dataclass(frozen=True)
class Pair:
    """What a setting is tried on."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    judge: Judge


@dataclass(frozen=True)
class Trial:
    """A setting, how good it is, and how long its slowest pair took."""

    parameters: dict[str, Any]
    quality: Quality
    cost: float
    milliseconds: float


@dataclass(frozen=True)
class Step:
    """One choice: what was tried for a parameter, what was taken, and why."""

    parameter: str
    taken: Any
    reason: str
    tried: list[tuple[Any, Trial]]


@dataclass
class Search:
    """The way to the best setting."""

    best: Trial
    steps: list[Step] = field(default_factory=list)


class Tuner:
    """Tries settings on pairs; each only once.

    Parameters
    ----------
    pairs : sequence of Pair
    searched : DisparityRange
    objective : Objective
    max_ms : float, optional
        Settings whose slowest pair takes longer are out.
    fill : bool
        Answer every pixel.
    threads : int, optional
    advance : callable
        Told after each setting.
    """

    def __init__(
        self,
        pairs: Sequence[Pair],
        searched: DisparityRange,
        objective: Objective,
        *,
        max_ms: float | None = None,
        fill: bool = False,
        threads: int | None = None,
        advance: Callable[[], None] = lambda: None,
    ) -> None:
        self._pairs, self._objective, self._max_ms, self._advance = pairs, objective, max_ms, advance
        self._fixed = {"num_disparities": searched.count, "min_disparity": searched.first, "fill": fill}
        self._threads = threads
        self._trials: dict[str, Trial] = {}

    def search(self) -> Search:
        """From the best preset downhill."""
        presets = [(name, self.trial({"preset": name})) for name in PRESETS]
        name, best = min(presets, key=lambda entry: self._rank(entry[1]))
        found = Search(best, [Step("preset", name, self._why_preset(presets, name), presets)])
        for parameter, values in (_SGM if best.parameters["method"] == "sgm" else _SAD).items():
            found.steps.append(self._step(found, parameter, values))
        return found

    def trial(self, parameters: dict[str, Any]) -> Trial:
        """A setting on every pair."""
        matcher = StereoMatcher(**{**parameters, **self._fixed, "threads": self._threads})
        full = {name: value for name, value in matcher.parameters.items() if name != "threads"}
        key = repr(sorted(full.items()))
        if key not in self._trials:
            qualities, slowest = [], 0.0
            for pair in self._pairs:
                values, milliseconds = self._match(matcher, pair)
                qualities.append(pair.judge(values))
                slowest = max(slowest, milliseconds)
            quality = mean_quality(qualities)
            self._trials[key] = Trial(full, quality, self._objective.cost(quality), slowest)
            self._advance()
        return self._trials[key]

    def _match(self, matcher: StereoMatcher, pair: Pair) -> tuple[NDArray[np.float32], float]:
        # The first call makes the buffers: with a budget, what counts is a call in a stream.
        calls = 1 if self._max_ms is None else 3
        taken = []
        out = None
        for _ in range(calls):
            start = time.perf_counter()
            out = matcher(pair.left, pair.right, out=out)
            taken.append(time.perf_counter() - start)
        assert out is not None
        return out.values, 1e3 * min(taken)

    def _in_time(self, trial: Trial) -> bool:
        return self._max_ms is None or trial.milliseconds <= self._max_ms

    def _rank(self, trial: Trial) -> tuple[bool, float]:
        """Too slow comes last; among the too slow, the fastest is best."""
        in_time = self._in_time(trial)
        return (not in_time, trial.cost if in_time else trial.milliseconds)

    def _step(self, found: Search, parameter: str, values: tuple[Any, ...]) -> Step:
        now = found.best
        current = now.parameters[parameter]
        # Words come after numbers, with which they do not compare.
        ordered = sorted({*values, current}, key=lambda value: (isinstance(value, str), value))
        tried = [(v, self.trial({**now.parameters, parameter: v})) for v in ordered]
        value, best = min(tried, key=lambda entry: self._rank(entry[1]))
        gain = now.cost - best.cost
        rescued = self._in_time(best) and not self._in_time(now)
        if value == current or (gain < _WORTH_A_CHANGE and not rescued):
            others = [entry for entry in tried if entry[0] != current]
            runner, second = min(others, key=lambda entry: self._rank(entry[1]))
            verdict = "too little a gain" if second.cost < now.cost else "worse"
            if not self._in_time(second):
                verdict = "too slow"
            reason = f"kept: {now.cost:.2f}; {runner} would have {second.cost:.2f}, {verdict}"
            return Step(parameter, current, reason, tried)
        found.best = best
        reason = f"{current} -> {value}: {now.cost:.2f} -> {best.cost:.2f}"
        return Step(parameter, value, reason, tried)

    def _why_preset(self, presets: Sequence[tuple[str, Trial]], taken: str) -> str:
        figures = ", ".join(f"{name} {trial.cost:.2f}" for name, trial in presets)
        if self._max_ms is None:
            return f"smallest {self._objective} of {figures}"
        late = [name for name, trial in presets if not self._in_time(trial)]
        if len(late) == len(presets):
            return f"none is within {self._max_ms:g} ms; {taken} is the fastest"
        out = f"; {' and '.join(late)} above {self._max_ms:g} ms" if late else ""
        return f"smallest {self._objective} of {figures}{out}"
