"""The measures each benchmark publishes, for all pixels and for those that both cameras see."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline.evaluation.interpolation import interpolate_background
from epiline.evaluation.scenes import Scene
from epiline.evaluation.scores import evaluate, wrong_as_d1

ALL, NON_OCCLUDED = "all", "non-occluded"


@dataclass(frozen=True)
class Measure:
    """A figure and how much it weighs in the mean over scenes: 1, or its pixels where the benchmark pools them."""

    value: float
    weight: float = 1.0


Measures: TypeAlias = dict[str, Measure]


def score(values: NDArray[np.float32], scene: Scene) -> dict[str, Measures]:
    """The scene's benchmark's measures by region.

    Parameters
    ----------
    values : (H, W) float32
        Disparity, px, NaN where there is no answer.
    scene : Scene

    Returns
    -------
    dict
        ``"all"`` and ``"non-occluded"``; for ``"common"`` scenes the latter only.
    """
    if scene.benchmark == "common":
        scores = dataclasses.asdict(evaluate(values, scene.truth, scene.non_occluded))
        return {NON_OCCLUDED: {name: Measure(value) for name, value in scores.items()}}
    regions = {ALL: np.isfinite(scene.truth), NON_OCCLUDED: scene.non_occluded}
    if scene.benchmark == "middlebury":
        return {name: _middlebury(values, scene.truth, mask) for name, mask in regions.items()}
    # KITTI's servers answer for the submitter: what is missing is interpolated before it is counted.
    dense = interpolate_background(values)
    by_region = {}
    for name, mask in regions.items():
        density = Measure(_percent(np.isfinite(values)[mask]), float(mask.sum()))
        errors = (
            _kitti2012(dense, scene.truth, mask)
            if scene.benchmark == "kitti2012"
            else _kitti2015(dense, scene.truth, mask, scene.foreground)
        )
        by_region[name] = {"density": density, **errors}
    return by_region


def mean(members: Iterable[Mapping[str, Measure]]) -> dict[str, float]:
    """The weighted mean of each figure over scenes; scenes where it is undefined are left out."""
    scenes = list(members)
    names = dict.fromkeys(name for measures in scenes for name in measures)
    means = {}
    for name in names:
        known = [m for s in scenes if (m := s.get(name)) and np.isfinite(m.value) and m.weight > 0]
        weight = sum(m.weight for m in known)
        means[name] = sum(m.value * m.weight for m in known) / weight if weight else float("nan")
    return means


def _middlebury(values: NDArray[np.float32], truth: NDArray[np.float32], mask: NDArray[np.bool_]) -> Measures:
    """Middlebury's third evaluation and ETH3D: a missing answer is bad; averages and quantiles are of the answers."""
    error = np.abs(values - truth)[mask]
    answered = np.isfinite(error)
    known = error[answered]
    figures = {"invalid": _percent(~answered)}
    for limit in (0.5, 1.0, 2.0, 4.0):
        figures[f"bad{limit:g}"] = _percent(~(error <= limit))
    figures["avgerr"] = float(known.mean(dtype=np.float64)) if known.size else float("nan")
    figures["rms"] = float(np.sqrt(np.square(known, dtype=np.float64).mean())) if known.size else float("nan")
    for share in (50, 90, 95, 99):
        figures[f"A{share}"] = float(np.percentile(known, share)) if known.size else float("nan")
    return {name: Measure(value) for name, value in figures.items()}


def _kitti2012(dense: NDArray[np.float32], truth: NDArray[np.float32], mask: NDArray[np.bool_]) -> Measures:
    """Out-Noc, Out-All (at 2 to 5 px) and the mean error of the interpolated map, pooled over pixels."""
    error = np.abs(dense - truth)[mask]
    figures = {f"out{limit}": _percent(~(error <= limit)) for limit in (2, 3, 4, 5)}
    figures["avg"] = float(error.mean(dtype=np.float64)) if error.size else float("nan")
    return {name: Measure(value, float(error.size)) for name, value in figures.items()}


def _kitti2015(
    dense: NDArray[np.float32],
    truth: NDArray[np.float32],
    mask: NDArray[np.bool_],
    foreground: NDArray[np.bool_] | None,
) -> Measures:
    """D1: off by more than 3 px and 5 % of the truth, on the background, on moving objects, and on both."""
    with np.errstate(invalid="ignore"):
        wrong = wrong_as_d1(np.abs(dense - truth), truth) | ~np.isfinite(dense)
    parts = {"D1-all": mask}
    if foreground is not None:
        parts = {"D1-bg": mask & ~foreground, "D1-fg": mask & foreground, **parts}
    return {name: Measure(_percent(wrong[part]), float(part.sum())) for name, part in parts.items()}


def _percent(flags: NDArray[np.bool_]) -> float:
    return 100.0 * float(flags.mean()) if flags.size else float("nan")
