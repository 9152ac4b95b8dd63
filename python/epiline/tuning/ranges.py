"""The disparities a pair has, from its own histogram."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline._core import Error, StereoMatcher, grey

# Searched first: this share of the width, in an image that is halved until it is no wider than this, px.
_SHARE, _WIDEST = 0.45, 800
# A whole disparity is there if this share of the answers has it; wrong matches are spread thinner.
_SUPPORT = 3e-4
_STEP = 16
# Room for what this pair does not show: nearer things, and farther ones.
_NEARER, _FARTHER = 1.10, 0.80


@dataclass(frozen=True)
class DisparityRange:
    """What to search, px, and what was seen."""

    first: int
    count: int
    lowest_seen: float
    highest_seen: float


def find_range(pairs: Sequence[tuple[NDArray[np.uint8], NDArray[np.uint8]]], threads: int | None) -> DisparityRange:
    """The range that holds every disparity of these pairs, with a margin, in steps of 16 px.

    Raises
    ------
    epiline.Error
        No pair has a reliable match.
    """
    seen = [span for pair in pairs if (span := _seen(*pair, threads)) is not None]
    if not seen:
        raise Error("no reliable match in any pair: are left and right swapped, or not aligned?")
    lowest, highest = min(low for low, _ in seen), max(high for _, high in seen)
    width = min(left.shape[1] for left, _ in pairs)
    first = int(_FARTHER * lowest) // _STEP * _STEP
    count = -(-int(_NEARER * highest + 2 - first) // _STEP) * _STEP
    return DisparityRange(first, max(1, min(count, width - first, 1024)), lowest, highest)


def _seen(left: NDArray[np.uint8], right: NDArray[np.uint8], threads: int | None) -> tuple[float, float] | None:
    import cv2

    left, right = grey(left), grey(right)
    scale = 1
    while left.shape[1] > _WIDEST:
        half = left.shape[1] // 2, left.shape[0] // 2
        left, right = (np.asarray(cv2.resize(i, half, interpolation=cv2.INTER_AREA), np.uint8) for i in (left, right))
        scale *= 2
    count = max(1, int(_SHARE * left.shape[1]))
    # Block matching rejects what has no texture, so that a blank wall does not claim a disparity.
    values = StereoMatcher(preset="fast", num_disparities=count, threads=threads)(left, right).values
    highest = _supported(values)
    if highest is None:
        return None
    # Left of the largest disparity not all candidates exist, and what is left over is too small.
    lowest = _supported(values[:, highest[1] :]) or highest
    return float(scale * lowest[0]), float(scale * highest[1])


def _supported(values: NDArray[np.float32]) -> tuple[int, int] | None:
    """The whole disparities, px, between which all lie that enough pixels have; the second is exclusive."""
    answers = values[np.isfinite(values)]
    if answers.size == 0:
        return None
    histogram = np.bincount(answers.astype(int))
    supported = np.flatnonzero(histogram >= max(1.0, _SUPPORT * answers.size))
    return (int(supported[0]), int(supported[-1]) + 1) if supported.size else None
