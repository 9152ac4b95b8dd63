"""Figures over many frames: precision, recall, bias, and how honest sigma is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from epiline.evaluation.obstacles.ground import GroundSample, ground_figures
from epiline.evaluation.obstacles.scans import ScanScore, scan_figures
from epiline.evaluation.obstacles.scoring import FrameScore, RangeSample

# Beyond this share of the range a report is about something else: counted apart, not averaged into the bias.
GROSS_SHARE = 0.05


@dataclass
class Tally:
    """Scores of some frames: obstacles, confirmed tracks, nearest ranges of regions, the ground, scans."""

    frames: list[FrameScore] = field(default_factory=list)
    followed: list[FrameScore] = field(default_factory=list)
    switches: int = 0
    regions: list[RangeSample] = field(default_factory=list)
    regions_asked: int = 0
    grounds: list[GroundSample] = field(default_factory=list)
    scans: list[ScanScore] = field(default_factory=list)

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.frames + other.frames,
            self.followed + other.followed,
            self.switches + other.switches,
            self.regions + other.regions,
            self.regions_asked + other.regions_asked,
            self.grounds + other.grounds,
            self.scans + other.scans,
        )

    def figures(self) -> dict[str, float]:
        """Every figure by name; shares in percent."""
        return {
            **report_figures(self.frames),
            **{f"track_{name}": value for name, value in report_figures(self.followed).items()},
            "track_switches": self.switches,
            "regions": self.regions_asked,
            **{f"region_{name}": value for name, value in range_figures(self.regions).items()},
            **ground_figures(self.grounds),
            **scan_figures(self.scans),
        }

    def missed_names(self) -> Counter[str]:
        """How often each obstacle was missed."""
        return Counter(missed.name for frame in self.frames for missed in frame.missed)


def report_figures(frames: Sequence[FrameScore]) -> dict[str, float]:
    """What was found, what of it was there, and how well its ranges are known."""
    verdicts = Counter(verdict for frame in frames for verdict in frame.verdicts)
    reports = sum(verdicts.values())
    found = sum(len(frame.found) for frame in frames)
    asked = found + sum(len(frame.missed) for frame in frames)
    return {
        "frames": len(frames),
        "asked": asked,
        "found": found,
        "recall": _percent(found, asked),
        "reports": reports,
        "ghosts": verdicts["ghost"],
        "doubles": verdicts["double"],
        "precision": _percent(verdicts["real"], reports),
        "free_frames": sum(frame.corridor_free for frame in frames),
        "blocked_frames": sum(frame.intrusions > 0 for frame in frames),
        **range_figures([sample for frame in frames for sample in frame.ranges]),
    }


def range_figures(samples: Sequence[RangeSample]) -> dict[str, float]:
    """Bias of those within `GROSS_SHARE`, and the shares within one and two sigma of all."""
    if not samples:
        nothing = float("nan")
        return {
            "ranges": 0,
            "bias": nothing,
            "median_error": nothing,
            "gross": nothing,
            "within_1": nothing,
            "within_2": nothing,
        }
    error = np.array([sample.error for sample in samples])
    z = np.abs([sample.z for sample in samples])
    kept = np.abs(error) <= GROSS_SHARE
    return {
        "ranges": len(samples),
        "bias": 100 * float(error[kept].mean()) if kept.any() else float("nan"),
        "median_error": 100 * float(np.median(np.abs(error))),
        "gross": 100 * float((~kept).mean()),
        "within_1": 100 * float((z <= 1).mean()),
        "within_2": 100 * float((z <= 2).mean()),
    }


def _percent(part: int, whole: int) -> float:
    return 100 * part / whole if whole else float("nan")
