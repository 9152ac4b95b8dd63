"""Reports against truth: which are real, which obstacles they miss, how far off their ranges are.

A report claims: "between these columns something stands at this depth". It is

* **real** where at least `SUPPORT_PX` pixels of walls or solids in its columns lie within the tolerance of its depth;
  what it is about is the object with the most such pixels;
* a **double** where it is about a solid that an earlier (nearer) report is about at the same columns and depth;
* a **ghost** otherwise.

An obstacle is found by a report of whose columns and tolerance it has `SUPPORT_PX` pixels, and whose depth is within
the tolerance of its smallest, or whose range is within that of its smallest: of a face seen square on every point has
the smallest depth, of one seen at an angle another point may have the smallest range. Nothing here knows how a finder
works.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from epiline._core import Obstacle, Track
from epiline.evaluation.obstacles.truth import NOTHING, SUPPORT_PX, Asked, Floats, FrameTruth
from epiline.sources.rendered import nearest_supported

Verdict: TypeAlias = Literal["real", "double", "ghost"]


@dataclass(frozen=True)
class Rules:
    """What counts.

    Attributes
    ----------
    reach_m : float
        Obstacles are asked for, and reports judged, up to this range.
    min_pixels, min_side_px : int, float
        An obstacle of which both cameras see less is not asked for.
    sigmas, share, most : float
        The tolerance of a depth: `sigmas` standard deviations, at least `share` of it and at most `most`.
    corridor_half_width_m : float
        Of the driving corridor, straight ahead.
    corridor_margin_m : float
        A corridor is free where nothing stands within this of it.
    overlap : float
        Two reports about one solid are at the same columns if they share this much of the narrower one.
    """

    reach_m: float = 6.0
    min_pixels: int = 24
    min_side_px: float = 2.0
    sigmas: float = 3.0
    share: float = 0.05
    most: float = 0.15
    corridor_half_width_m: float = 0.35
    corridor_margin_m: float = 0.15
    overlap: float = 0.5

    def tolerance_m(self, report: Report) -> float:
        """How far in depth a report may be from what it is about."""
        wanted = self.sigmas * report.sigma_m * report.depth_m / report.range_m
        # A sigma that is no number widens nothing.
        most = self.most * report.depth_m
        return max(min(wanted, most) if np.isfinite(wanted) else 0.0, self.share * report.depth_m)


@dataclass(frozen=True)
class Report:
    """What a finder claims.

    Attributes
    ----------
    range_m, sigma_m, depth_m : float
        Euclidean, its standard deviation, and Z.
    bearing_rad : float
        Of the point it has that range at; positive to the right.
    columns : (first, last)
        Of the left aligned image.
    track : int, optional
        Id of the track it is.
    """

    range_m: float
    sigma_m: float
    depth_m: float
    bearing_rad: float
    columns: tuple[int, int]
    track: int | None = None

    @classmethod
    def of(cls, obstacle: Obstacle) -> Report:
        """What we report."""
        x, _, width, _ = obstacle.box
        return cls(
            obstacle.range_m,
            obstacle.sigma_m,
            obstacle.depth_m,
            obstacle.bearing_rad,
            (x, x + width - 1),
        )

    @classmethod
    def of_track(cls, track: Track) -> Report:
        """What a track says: where it is now, in the columns it was last seen in."""
        x, _, width, _ = track.box
        return cls(
            track.range_m,
            track.sigma_m,
            track.position_m[1],
            track.bearing_rad,
            (x, x + width - 1),
            track.id,
        )


@dataclass(frozen=True)
class RangeSample:
    """A reported range beside the true one, metres."""

    name: str
    reported_m: float
    true_m: float
    sigma_m: float

    @property
    def error(self) -> float:
        """Share of the true range."""
        return self.reported_m / self.true_m - 1

    @property
    def z(self) -> float:
        """Error in standard deviations."""
        return (self.reported_m - self.true_m) / self.sigma_m if self.sigma_m > 0 else float("inf")


@dataclass(frozen=True)
class FrameScore:
    """One frame.

    Attributes
    ----------
    verdicts : list
        Of each report within reach.
    found, missed : list of Asked
    finders : list of list of Report
        Of each found: the reports that find it, the one closest to its nearest point first.
    ranges : list of RangeSample
        Of each solid found: the report's range beside that of the solid where the report points.
    corridor_free : bool
        Whether the truth has nothing in the corridor.
    intrusions : int
        Reports in a free corridor.
    """

    verdicts: list[Verdict] = field(default_factory=list)
    found: list[Asked] = field(default_factory=list)
    missed: list[Asked] = field(default_factory=list)
    finders: list[list[Report]] = field(default_factory=list)
    ranges: list[RangeSample] = field(default_factory=list)
    corridor_free: bool = False
    intrusions: int = 0


def score_frame(reports: Iterable[Report], truth: FrameTruth, rules: Rules) -> FrameScore:
    """Scores one frame."""
    ordered = sorted(reports, key=lambda report: report.range_m)
    about = [_about(report, truth, rules) for report in ordered]
    within_reach = [report for report in ordered if report.range_m <= rules.reach_m]
    verdicts = [_verdict(i, ordered, about, truth, rules) for i in range(len(within_reach))]
    found, missed, finders, ranges = [], [], [], []
    asked = truth.asked(reach_m=rules.reach_m, min_pixels=rules.min_pixels, min_side_px=rules.min_side_px)
    for obstacle in asked:
        finding = _finders(obstacle, ordered, truth, rules)
        if not finding:
            missed.append(obstacle)
            continue
        found.append(obstacle)
        finders.append(finding)
        if about[ordered.index(finding[0])] == obstacle.object_id:
            ranges.append(_range_sample(obstacle, finding[0], truth))
    wide = rules.corridor_half_width_m + rules.corridor_margin_m
    free = truth.is_clear(wide, rules.reach_m * (1 + rules.share))
    intruding = [r for r, v in zip(within_reach, verdicts, strict=True) if _intrudes(r, v, truth, rules)]
    return FrameScore(verdicts, found, missed, finders, ranges, free, len(intruding) if free else 0)


def _within(
    report: Report, truth: FrameTruth, rules: Rules
) -> tuple[slice, np.ndarray[tuple[int, int], np.dtype[np.bool_]]]:
    """The report's columns, and which of their pixels lie within the tolerance of its depth."""
    first, last = report.columns
    columns = slice(max(first, 0), last + 1)
    near = np.abs(truth.depth_m[:, columns] - report.depth_m) <= rules.tolerance_m(report)
    return columns, near


def _about(report: Report, truth: FrameTruth, rules: Rules) -> int:
    """The object with the most pixels where the report claims something, or `NOTHING`."""
    columns, near = _within(report, truth, rules)
    ids = truth.standing[:, columns][near]
    ids = ids[ids != NOTHING]
    if ids.size < SUPPORT_PX:
        return NOTHING
    return int(np.bincount(ids).argmax())


def _verdict(i: int, ordered: Sequence[Report], about: Sequence[int], truth: FrameTruth, rules: Rules) -> Verdict:
    report = ordered[i]
    if about[i] == NOTHING:
        return "ghost"
    if about[i] in truth.solids:
        for earlier, object_id in zip(ordered[:i], about, strict=False):
            close = abs(earlier.depth_m - report.depth_m) <= rules.tolerance_m(report)
            if object_id == about[i] and close and _shared(earlier, report) >= rules.overlap:
                return "double"
    return "real"


def _intrudes(report: Report, verdict: Verdict, truth: FrameTruth, rules: Rules) -> bool:
    """Whether a report stands in the corridor straight ahead: its point, or, if it is a ghost, any of its columns.

    The columns of a wall along the corridor go on to where it is far away, and then are not at the reported depth.
    """
    tangents = [np.tan(report.bearing_rad)]
    if verdict == "ghost":
        x = truth.lateral_m[0] / truth.depth_m[0]
        tangents += [x[max(report.columns[0], 0)], x[min(report.columns[1], x.size - 1)]]
    left_m, right_m = report.depth_m * min(tangents), report.depth_m * max(tangents)
    return bool(left_m < rules.corridor_half_width_m and right_m > -rules.corridor_half_width_m)


def _shared(one: Report, other: Report) -> float:
    """Common columns, as a share of the narrower report's."""
    common = min(one.columns[1], other.columns[1]) - max(one.columns[0], other.columns[0]) + 1
    narrower = min(report.columns[1] - report.columns[0] + 1 for report in (one, other))
    return max(common, 0) / max(narrower, 1)


def _finders(obstacle: Asked, reports: Sequence[Report], truth: FrameTruth, rules: Rules) -> list[Report]:
    """The reports that find an obstacle, the one closest to its nearest point first."""
    candidates = []
    for report in reports:
        by_depth = abs(report.depth_m - obstacle.depth_m) / report.depth_m
        by_range = abs(report.range_m - obstacle.range_m) / report.range_m
        off = min(by_depth, by_range)
        if off > rules.tolerance_m(report) / report.depth_m:
            continue
        columns, near = _within(report, truth, rules)
        if int((truth.standing[:, columns][near] == obstacle.object_id).sum()) >= SUPPORT_PX:
            candidates.append((off, report))
    return [report for _, report in sorted(candidates, key=lambda candidate: candidate[0])]


def _range_sample(obstacle: Asked, report: Report, truth: FrameTruth) -> RangeSample:
    """Truth is where the reported ray meets the solid: the nearest supported depth in the columns around it."""
    here = truth.visible == obstacle.object_id
    tangent = truth.lateral_m / truth.depth_m
    pixel = float(tangent[0, 1] - tangent[0, 0])
    aside = np.abs(tangent - np.tan(report.bearing_rad))
    # Where the ray passes it by, through a gap, its nearest columns are meant.
    values: Floats = truth.depth_m[here & (aside <= float(aside[here].min()) + pixel)]
    true_m = nearest_supported(values, min(SUPPORT_PX, values.size))
    return RangeSample(obstacle.name, report.range_m, report.range_m * true_m / report.depth_m, report.sigma_m)
