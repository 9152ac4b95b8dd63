"""Who says how good a map is: the ground truth, or what the best methods agree on.

Without truth, a pixel's reference is the answer of the preset `accurate` where it passes its tests and block matching,
which errs in other ways, does not contradict it. An answer further away than the measure allows counts as wrong. Where
there is no reference, an answer counts as wrong in part, by how often such answers were wrong on public scenes. What
a nearer surface of that map hides from the right camera is not scored, as it is not with truth.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline._core import StereoMatcher
from epiline.evaluation import evaluate
from epiline.evaluation.interpolation import interpolate_background
from epiline.evaluation.scores import wrong_as_d1
from epiline.tuning.objective import MEASURES, Quality
from epiline.tuning.ranges import DisparityRange

Image: TypeAlias = NDArray[np.uint8]
Map: TypeAlias = NDArray[np.float32]
Judge: TypeAlias = Callable[[Map], Quality]

_CONTRADICTED_PX = 1.0
# A pixel is hidden by one that is nearer by more than this.
_HIDDEN_PX = 1.0
# How often an answer without a reference was wrong: `fast` on every other public scene (benchmarks/tune_proxy.py).
_WRONG_WITHOUT_REFERENCE = {"bad1": 0.66, "bad2": 0.44, "bad3": 0.35, "d1": 0.34}


def truth_judge(truth: Map, mask: NDArray[np.bool_] | None = None) -> Judge:
    """Scores maps against ground truth, (H, W) px, NaN where unknown, inside `mask`."""

    def judge(values: Map) -> Quality:
        scores = evaluate(values, truth, mask)
        wrong = {name: float(getattr(scores, f"{name}_matched")) for name in MEASURES}
        return Quality(scores.density, {n: 100.0 if np.isnan(v) else v for n, v in wrong.items()})

    return judge


def reference_of(
    left: Image, right: Image, searched: DisparityRange, threads: int | None
) -> tuple[Map, NDArray[np.bool_]]:
    """What both methods agree on, (H, W) px, NaN where there is no reference; and which pixels are scored."""
    span: dict[str, Any] = {"num_disparities": searched.count, "min_disparity": searched.first, "threads": threads}
    best = StereoMatcher(preset="accurate", **span)(left, right)
    other = StereoMatcher(preset="fast", **span)(left, right).values
    reference = best.values.copy()
    with np.errstate(invalid="ignore"):
        reference[np.abs(reference - other) > _CONTRADICTED_PX] = np.nan
    return reference, _seen_by_both(np.nan_to_num(interpolate_background(best.values)))


def _seen_by_both(values: Map) -> NDArray[np.bool_]:
    """(H, W): pixels of a dense map that lie inside the right image, with nothing nearer in front of them there."""
    rows, columns = np.indices(values.shape)
    at = np.rint(columns - values).astype(int)
    inside = at >= 0
    at = at.clip(0)
    nearest = np.zeros_like(values)
    np.maximum.at(nearest, (rows, at), np.where(inside, values, 0))
    return np.asarray(inside & (values >= nearest[rows, at] - _HIDDEN_PX), bool)


def consensus_judge(left: Image, right: Image, searched: DisparityRange, threads: int | None) -> Judge:
    """Scores maps of this pair without ground truth."""
    reference, seen = reference_of(left, right, searched, threads)

    def judge(values: Map) -> Quality:
        answered = np.isfinite(values) & seen
        count = int(answered.sum())
        density = 100.0 * count / max(1, int(seen.sum()))
        if count == 0:
            return Quality(density, dict.fromkeys(MEASURES, 100.0))
        known = answered & np.isfinite(reference)
        error = np.abs(values - reference)[known]
        flags = {"bad1": error > 1, "bad2": error > 2, "bad3": error > 3, "d1": wrong_as_d1(error, reference[known])}
        guessed = count - int(known.sum())
        wrong = {n: float(flags[n].sum()) + guessed * _WRONG_WITHOUT_REFERENCE[n] for n in MEASURES}
        return Quality(density, {name: 100.0 * number / count for name, number in wrong.items()})

    return judge
