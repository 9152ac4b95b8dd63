"""How the answers worsen when the pair does."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from epiline._core import grey
from epiline.evaluation.perturbations import perturbations
from epiline.evaluation.scenes import Scene
from epiline.evaluation.scores import evaluate
from epiline.evaluation.settings import Method


def bad1_by_perturbation(
    scenes: Sequence[Scene], methods: Sequence[Method], threads: int | None, advance: Callable[[], None]
) -> dict[str, list[float]]:
    """Percent of non-occluded pixels off by more than 1 px or unanswered, mean over scenes; one figure per method."""
    figures: dict[str, list[float]] = {}
    for name, perturb in perturbations().items():
        rows = []
        for scene in scenes:
            pair = perturb(grey(scene.left), grey(scene.right))
            maps = [method(*pair, scene.num_disparities, threads) for method in methods]
            rows.append([evaluate(values, scene.truth, scene.non_occluded).bad1_total for values in maps])
            advance()
        figures[name] = [float(value) for value in np.mean(rows, axis=0)]
    return figures
