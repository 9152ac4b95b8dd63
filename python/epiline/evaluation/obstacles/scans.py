"""The scan of a frame against the truth: nearest obstacles per direction, and free stretches that are not free.

What matters most is the last: a robot drives where it is told that it is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline._core import Scan
from epiline.evaluation.obstacles.scoring import Rules
from epiline.evaluation.obstacles.truth import BESIDE_PX, NOTHING, SUPPORT_PX, Floats, FrameTruth

# What is lower or higher over the floor is driven over or passed under; the scan is asked the same, metres.
STEP_M, HEADROOM_M = 0.05, 2.0
# A free stretch may end this much behind what stands there: pixels of its edge are half of it and half of the floor.
_SLACK_M = 0.05
# Fewer pixels of a direction are its edge.
_EDGE_PX = 3


@dataclass(frozen=True)
class ScanScore:
    """Counts of directions.

    Attributes
    ----------
    directions : int
        All of them.
    free_claimed, free_wrong : int
        With a free stretch; with one that goes on behind something that stands there.
    unknown : int
        Neither an obstacle nor nothing as far as was looked.
    asked, missed : int
        With something within reach that both cameras see; with nothing reported there, or too far.
    misled : int
        Of the missed those that are not unknown: an obstacle farther on was reported, or nothing at all, or a free
        stretch that reaches what is there.
    false_near, ghosts : int
        With something reported where nothing is; with nothing as near in the directions beside it either. The others
        are things that are reported wider than they are.
    """

    directions: int
    free_claimed: int
    free_wrong: int
    unknown: int
    asked: int
    missed: int
    misled: int
    false_near: int
    ghosts: int


def score_scan(scan: Scan, truth: FrameTruth, angle_rad: Floats, over_floor_m: Floats, rules: Rules) -> ScanScore:
    """Scores one scan.

    Parameters
    ----------
    scan : Scan
    truth : FrameTruth
    angle_rad, over_floor_m : (H, W) float64
        Direction and distance over the floor of each pixel's point, from the camera's foot in the robot's frame.
    rules : Rules
    """
    stands = (truth.standing != NOTHING) & (truth.height_m > STEP_M) & (truth.height_m < HEADROOM_M)
    nearest, any_nearest = (
        _nearest(scan.angle_rad, angle_rad[stands], over_floor_m[stands], pixels) for pixels in (_EDGE_PX, 1)
    )
    both = stands & truth.seen
    seen = _nearest(scan.angle_rad, angle_rad[both], over_floor_m[both], SUPPORT_PX)
    said, free_to = scan.nearest_m.astype(float), scan.free_to_m.astype(float)
    tolerance = np.clip(rules.sigmas * scan.sigma_m, rules.share * said, rules.most * said)
    with np.errstate(invalid="ignore"):
        free = free_to > scan.free_from_m
        behind = free & (free_to > nearest * (1 + rules.share) + _SLACK_M)
        reaches = free & (free_to > seen * (1 + rules.share) + _SLACK_M)
        asked = seen <= rules.reach_m
        missed = asked & ~(said <= seen + np.fmax(tolerance, rules.share * seen))
        misled = missed & ((scan.seen != 0) | reaches)
        near = (said <= rules.reach_m) & ~(said >= nearest - tolerance)
        ghosts = near & ~(_least_beside(any_nearest) <= said + tolerance)
    return ScanScore(
        directions=scan.angle_rad.size,
        free_claimed=int(free.sum()),
        free_wrong=int(behind.sum()),
        unknown=int((scan.seen == 0).sum()),
        asked=int(asked.sum()),
        missed=int(missed.sum()),
        misled=int(misled.sum()),
        false_near=int(near.sum()),
        ghosts=int(ghosts.sum()),
    )


def scan_figures(scores: Sequence[ScanScore]) -> dict[str, float]:
    """Shares in percent over many frames."""

    def total(name: str) -> int:
        return sum(getattr(score, name) for score in scores)

    return {
        "directions": total("directions"),
        "scan_missed": _percent(total("missed"), total("asked")),
        "scan_misled": _percent(total("misled"), total("asked")),
        "scan_false_near": _percent(total("false_near"), total("directions")),
        "scan_ghosts": _percent(total("ghosts"), total("directions")),
        "scan_free": _percent(total("free_claimed"), total("directions")),
        "scan_free_wrong": _percent(total("free_wrong"), total("free_claimed")),
        "scan_unknown": _percent(total("unknown"), total("directions")),
    }


def _nearest(directions: NDArray[np.float32], angle: Floats, distance: Floats, support: int) -> Floats:
    """The distance that `support` points of each direction do not exceed; infinite where there are fewer."""
    nearest = np.full(directions.size, np.inf)
    if directions.size < 2 or angle.size == 0:
        return nearest
    edges = np.concatenate(
        [
            [1.5 * directions[0] - 0.5 * directions[1]],
            0.5 * (directions[1:] + directions[:-1]),
            [1.5 * directions[-1] - 0.5 * directions[-2]],
        ]
    )
    place = np.searchsorted(edges, angle) - 1
    inside = (place >= 0) & (place < directions.size)
    place, distance = place[inside], distance[inside]
    order = np.lexsort((distance, place))
    place, distance = place[order], distance[order]
    first = np.searchsorted(place, np.arange(directions.size))
    enough = np.bincount(place, minlength=directions.size) >= support
    nearest[enough] = distance[first[enough] + support - 1]
    return nearest


def _least_beside(distance: Floats) -> Floats:
    """The least of each direction's and those of `BESIDE_PX` directions on both sides."""
    padded = np.pad(distance, BESIDE_PX, constant_values=np.inf)
    least: Floats = np.lib.stride_tricks.sliding_window_view(padded, 2 * BESIDE_PX + 1).min(axis=-1)
    return least


def _percent(part: int, whole: int) -> float:
    return 100 * part / whole if whole else float("nan")
