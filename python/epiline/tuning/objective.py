"""What is minimised: wrong answers, with a say on how many pixels must have one."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

MEASURES = ("bad1", "bad2", "bad3", "d1")
_TEXT = re.compile(rf"({'|'.join(MEASURES)})(?:@(\d{{1,3}}))?")


@dataclass(frozen=True)
class Quality:
    """How good a map is, known or estimated.

    Attributes
    ----------
    density : float
        Percent of the pixels that both cameras see that have an answer.
    wrong : dict
        By measure, percent of these answers that are wrong.
    """

    density: float
    wrong: dict[str, float]


@dataclass(frozen=True)
class Objective:
    """`bad2@80`: fewest wrong answers among maps that answer 80 % at least; `bad2`: a missing answer is a wrong one."""

    measure: str
    least_density: int | None

    def __str__(self) -> str:
        return self.measure if self.least_density is None else f"{self.measure}@{self.least_density}"

    def cost(self, quality: Quality) -> float:
        """Percent; above 100 for a map that answers too little, the more so the less it answers."""
        wrong = quality.wrong[self.measure]
        if self.least_density is None:
            return 100.0 - quality.density + wrong * quality.density / 100.0
        if quality.density < self.least_density:
            return 100.0 + self.least_density - quality.density
        return wrong


def parse_objective(text: str) -> Objective:
    """Reads ``bad1``, ``bad2``, ``bad3`` or ``d1``, alone or with ``@DENSITY`` in percent. Raises ValueError."""
    found = _TEXT.fullmatch(text)
    density = int(found[2]) if found and found[2] else None
    if found is None or (density is not None and density > 100):
        raise ValueError(f"objective '{text}': expected {', '.join(MEASURES)}, or e.g. bad2@80 (percent answered)")
    return Objective(found[1], density)


def mean_quality(qualities: Sequence[Quality]) -> Quality:
    """The mean over pairs."""
    return Quality(
        density=float(np.mean([q.density for q in qualities])),
        wrong={name: float(np.mean([q.wrong[name] for q in qualities])) for name in MEASURES},
    )
