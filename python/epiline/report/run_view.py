"""The run as a whole, as the template shows it: the summary strip, the table of frames, the stage times."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from markupsafe import Markup

from epiline.report.calibration_view import baseline_sigma_m
from epiline.report.charts import WIDE, Axis, Bar, Line, bar_chart, limits_of, line_chart
from epiline.report.encode import data_uri
from epiline.report.model import FrameSection, FrameSummary, RunReport
from epiline.report.numbers import number, percent, plus_minus, quantity, relative_error, signed_percent
from epiline.report.protocols import Floats
from epiline.report.recorder import evenly_chosen

MAX_ROWS = 500
"""Rows of the table of frames; a longer run shows frames evenly spread."""

Standing: TypeAlias = Literal["", "good", "usable", "poor"]

_TONES = ("c0", "c1", "c2", "c4", "c5", "c3")
_GOOD_ALIGNMENT_PX, _USABLE_ALIGNMENT_PX = 0.5, 1.0


@dataclass(frozen=True, kw_only=True)
class Tile:
    """One figure of the summary strip."""

    label: str
    value: str
    note: str = ""
    standing: Standing = ""


@dataclass(frozen=True, kw_only=True)
class RangeCell:
    """A range in the table of frames, with its truth and error where known."""

    range: str
    truth: str = ""
    error: str = ""


@dataclass(frozen=True, kw_only=True)
class FrameRow:
    """A line of the table of frames; `anchor` is empty if the frame has no figures on the page."""

    index: int
    name: str
    anchor: str
    regions: Sequence[RangeCell]
    nearest: str
    obstacles: int
    alignment: str
    valid_share: str
    time: str


@dataclass(frozen=True, kw_only=True)
class RegionError:
    """How far a region's nearest range was from the truth over the run."""

    region: str
    frames: int
    span: str
    median: str
    worst: str


@dataclass(frozen=True, kw_only=True)
class ThumbnailView:
    """A small picture; `anchor` as in `FrameRow`."""

    index: int
    anchor: str
    uri: str
    width: int
    height: int
    nearest: str


@dataclass(frozen=True, kw_only=True)
class RunView:
    """Everything the template shows of a run."""

    tiles: Sequence[Tile]
    region_names: Sequence[str]
    rows: Sequence[FrameRow]
    rows_left_out: int
    region_errors: Sequence[RegionError]
    trend: Markup | None
    tracks: Markup | None
    tracks_left_out: int
    thumbnails: Sequence[ThumbnailView]
    stages: Markup | None
    stage_total: str
    stage_rate: str


def run_view(report: RunReport, figured: Sequence[FrameSection], summaries: Sequence[FrameSummary]) -> RunView:
    """Draws the run. `figured` are the frames with figures on the page, `summaries` those of every frame."""
    shown = {frame.index: f"frame-{frame.index}" for frame in figured}
    names = list(dict.fromkeys(name for summary in summaries for name in summary.region_range_m))
    chosen = [summaries[i] for i in evenly_chosen(len(summaries), MAX_ROWS)]
    by_index = {summary.index: summary for summary in summaries}
    total = _median([summary.total_ms for summary in summaries])
    return RunView(
        tiles=_tiles(report, len(figured), summaries, total),
        region_names=names,
        rows=[_row(summary, names, shown) for summary in chosen],
        rows_left_out=len(summaries) - len(chosen),
        region_errors=_region_errors(summaries, names),
        trend=_trend(summaries, names),
        tracks=_tracks(summaries),
        tracks_left_out=max(0, len(_lives(summaries)) - len(_TONES)),
        thumbnails=[
            ThumbnailView(
                index=item.index,
                anchor=shown.get(item.index, ""),
                uri=data_uri(item.jpeg, "image/jpeg"),
                width=item.width,
                height=item.height,
                nearest=quantity(by_index[item.index].nearest_m, "m") if item.index in by_index else "",
            )
            for item in report.thumbnails
        ],
        stages=_stages(summaries),
        stage_total=quantity(total, "ms", 2),
        stage_rate=quantity(_rate(total), "frames/s", 1),
    )


def _tiles(report: RunReport, figured: int, summaries: Sequence[FrameSummary], total: float) -> list[Tile]:
    tiles = []
    if summaries:
        tiles.append(_count_tile(figured, summaries))
        tiles.append(_nearest_tile(summaries))
        tiles.append(_alignment_tile(summaries))
        shares = [summary.valid_share for summary in summaries]
        note = f"lowest {percent(min(shares))}" if len(shares) > 1 else "of all pixels"
        tiles.append(Tile(label="valid pixels", value=percent(_median(shares)), note=note))
        if math.isfinite(total):
            note = f"{quantity(total, 'ms', 1)} a frame"
            tiles.append(Tile(label="rate", value=quantity(_rate(total), "/s", 1), note=note))
    if report.calibration is not None:
        calibration = report.calibration.calibration
        sigma_mm = 1000.0 * baseline_sigma_m(calibration)
        note = f"rms {quantity(calibration.rms_px, 'px', 3)}" if math.isfinite(calibration.rms_px) else "from a file"
        value = plus_minus(1000.0 * calibration.baseline_m, sigma_mm, "mm", 2)
        tiles.append(Tile(label="baseline", value=value, note=note))
    if report.range_curve is not None:
        curve = report.range_curve.curve
        tiles.append(Tile(label="range curve", value=quantity(curve.rmse_m, "m", 4), note="rmse of the fit"))
    return tiles


def _count_tile(figured: int, summaries: Sequence[FrameSummary]) -> Tile:
    one = len(summaries) == 1
    note = summaries[0].name if one else f"{figured} with figures"
    return Tile(label="frame" if one else "frames", value=number(len(summaries), 0), note=note)


def _nearest_tile(summaries: Sequence[FrameSummary]) -> Tile:
    seen = [summary for summary in summaries if math.isfinite(summary.nearest_m)]
    if not seen:
        return Tile(label="nearest obstacle", value="none", note="in any frame" if len(summaries) > 1 else "")
    nearest = min(seen, key=lambda summary: summary.nearest_m)
    where = f"region {nearest.nearest_region}" if nearest.nearest_region else ""
    when = f"frame {nearest.index}" if len(summaries) > 1 else ""
    note = ", ".join(part for part in (where, when) if part)
    return Tile(label="nearest obstacle", value=plus_minus(nearest.nearest_m, nearest.nearest_sigma_m, "m"), note=note)


def _alignment_tile(summaries: Sequence[FrameSummary]) -> Tile:
    measured = [summary.alignment_px for summary in summaries if math.isfinite(summary.alignment_px)]
    if not measured:
        return Tile(label="vertical residual", value="not measured")
    worst = max(measured)
    standing: Standing = "poor"
    if worst <= _GOOD_ALIGNMENT_PX:
        standing = "good"
    elif worst <= _USABLE_ALIGNMENT_PX:
        standing = "usable"
    words = {"good": "aligned", "usable": "slightly out of line", "poor": "out of line"}[standing]
    note = f"worst {quantity(worst, 'px')}: {words}" if len(measured) > 1 else words
    return Tile(label="vertical residual", value=quantity(_median(measured), "px"), note=note, standing=standing)


def _row(summary: FrameSummary, names: Sequence[str], shown: dict[int, str]) -> FrameRow:
    cells = []
    for name in names:
        range_m, truth_m = summary.region_range_m.get(name), summary.region_truth_m.get(name)
        if truth_m is None:
            cells.append(RangeCell(range=number(range_m)))
        else:
            error = signed_percent(relative_error(range_m, truth_m), 1)
            cells.append(RangeCell(range=number(range_m), truth=number(truth_m), error=error))
    return FrameRow(
        index=summary.index,
        name=summary.name,
        anchor=shown.get(summary.index, ""),
        regions=cells,
        nearest=plus_minus(summary.nearest_m, summary.nearest_sigma_m, "m"),
        obstacles=summary.obstacles,
        alignment=number(summary.alignment_px),
        valid_share=number(100.0 * summary.valid_share, 1),
        time=number(summary.total_ms, 1),
    )


def _region_errors(summaries: Sequence[FrameSummary], names: Sequence[str]) -> list[RegionError]:
    rows = []
    for name in names:
        truths = [summary.region_truth_m[name] for summary in summaries if name in summary.region_truth_m]
        errors = [
            relative_error(summary.region_range_m.get(name), summary.region_truth_m.get(name)) for summary in summaries
        ]
        known = [error for error in errors if error is not None]
        finite = [truth for truth in truths if math.isfinite(truth)]
        if not finite:
            continue
        span = quantity(finite[0], "m", 3)
        if len(finite) > 1:
            span = f"{number(min(finite))} – {quantity(max(finite), 'm')}"
        rows.append(
            RegionError(
                region=name,
                frames=len(known),
                span=span,
                median=percent(_median([abs(error) for error in known]), 2),
                worst=signed_percent(max(known, key=abs, default=None)),
            )
        )
    return rows


def _trend(summaries: Sequence[FrameSummary], names: Sequence[str]) -> Markup | None:
    if len(summaries) < 3 or not names:
        return None
    x = np.array([summary.index for summary in summaries], np.float64)
    lines, shown = [], []
    for name, tone in zip(names, _TONES, strict=False):
        y = _column([summary.region_range_m.get(name) for summary in summaries])
        lines.append(Line(name=name, x=x, y=y, tone=tone, keep="min"))
        shown.append(y)
    truths = [_column([summary.region_truth_m.get(name) for summary in summaries]) for name in names[: len(_TONES)]]
    lines += [Line(name="truth", x=x, y=y, tone="truth", keep="min") for y in truths if np.isfinite(y).any()]
    return line_chart(
        title="Nearest range of each region over the run",
        x=Axis(label="frame", limits=(float(x.min()), float(x.max())), ticks=8),
        y=Axis(label="nearest range, m", limits=limits_of(*shown, include=(0.0,), upper_share=0.98)),
        lines=lines,
        empty="no region had support in any frame",
        width=WIDE,
    )


def _lives(summaries: Sequence[FrameSummary]) -> dict[int, int]:
    """In how many frames each track was seen, by id."""
    lives: dict[int, int] = {}
    for summary in summaries:
        for track in summary.track_range_m:
            lives[track] = lives.get(track, 0) + 1
    return lives


def _tracks(summaries: Sequence[FrameSummary]) -> Markup | None:
    lives = _lives(summaries)
    if len(summaries) < 3 or not lives:
        return None
    x = np.array([summary.index for summary in summaries], np.float64)
    longest = sorted(lives, key=lambda track: (-lives[track], track))[: len(_TONES)]
    ranges = {track: _column([summary.track_range_m.get(track) for summary in summaries]) for track in sorted(longest)}
    return line_chart(
        title="Range of the tracks seen longest",
        x=Axis(label="frame", limits=(float(x.min()), float(x.max())), ticks=8),
        y=Axis(label="range, m", limits=limits_of(*ranges.values(), include=(0.0,))),
        lines=[
            Line(name=f"track {track}", x=x, y=y, tone=tone, keep="min")
            for (track, y), tone in zip(ranges.items(), _TONES, strict=False)
        ],
        width=WIDE,
    )


def _stages(summaries: Sequence[FrameSummary]) -> Markup | None:
    names = list(dict.fromkeys(name for summary in summaries for name in summary.stage_ms))
    if not names:
        return None
    bars = [
        Bar(label=name.replace("_", " "), value=_median([s.stage_ms[name] for s in summaries if name in s.stage_ms]))
        for name in names
    ]
    return bar_chart(title="Median time of each stage", bars=bars, unit="ms")


def _column(values: Sequence[float | None]) -> Floats:
    return np.array([math.nan if value is None else value for value in values], np.float64)


def _median(values: Sequence[float]) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return float(np.median(finite)) if finite else math.nan


def _rate(total_ms: float) -> float:
    return 1000.0 / total_ms if total_ms > 0.0 else math.nan
