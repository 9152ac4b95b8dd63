"""One frame, as the template shows it: figures drawn, numbers written."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from epiline._pictures import Limits, grey_level_disparity
from epiline.report import figures
from epiline.report.charts import SecondAxis, histogram
from epiline.report.model import FrameSection, FrameTruth
from epiline.report.numbers import ABSENT, number, percent, plus_minus, quantity, relative_error, signed_percent
from epiline.report.profile_charts import range_chart, value_axis, value_chart
from epiline.report.protocols import AlignmentLike, Floats, ObstacleLike, ProfileLike, ScanLike, TrackLike
from epiline.report.reasons import REASONS, has_value
from epiline.report.recorder import total_ms
from epiline.report.top_view import top_view

Facts = Sequence[tuple[str, str]]

_WIDE_ASPECT = 2.2
"""Pictures wider than this times their height stand below each other, not side by side."""


@dataclass(frozen=True, kw_only=True)
class ReasonRow:
    """A line of the legend of unmeasured pixels."""

    label: str
    colour: str
    share: str


@dataclass(frozen=True, kw_only=True)
class RegionView:
    """One region's charts and figures."""

    name: str
    box: str
    value_chart: Markup
    range_chart: Markup | None
    facts: Facts
    supported: bool


@dataclass(frozen=True, kw_only=True)
class ObstacleRow:
    """A line of the obstacle table; `truth` and `error` are empty if there is no truth for the frame."""

    id: int
    region: str
    range: str
    bearing: str
    size: str
    support: str
    truth: str
    error: str


@dataclass(frozen=True, kw_only=True)
class TrackRow:
    """A line of the table of tracks."""

    id: int
    range: str
    bearing: str
    ahead: str
    right: str
    age: str
    hits: str
    seen: bool


@dataclass(frozen=True, kw_only=True)
class PairView:
    """A pair with scan-lines, and what was measured between its views."""

    figure: Markup
    residual: str
    spread: str
    matches: str
    has_rings: bool


@dataclass(frozen=True, kw_only=True)
class FrameView:
    """Everything the template shows of a frame."""

    anchor: str
    index: int
    name: str
    facts: Facts
    is_wide: bool
    definitions: Markup
    before: PairView | None
    after: PairView
    residuals: Markup | None
    grey: Markup
    grey_scale: Markup
    colour: Markup
    colour_scale: Markup
    in_metres: bool
    valid_share: str
    reasons: Markup
    reason_rows: Sequence[ReasonRow]
    regions_on_map: Markup | None
    regions_on_photograph: Markup | None
    regions: Sequence[RegionView]
    obstacles: Markup
    obstacle_rows: Sequence[ObstacleRow]
    missed: Sequence[str]
    scan: Markup | None
    scan_facts: Facts
    track_rows: Sequence[TrackRow]
    has_truth: bool


def frame_view(frame: FrameSection, *, limits_px: Limits, max_pixels: int) -> FrameView:
    """Draws a frame. `limits_px` are those of all frames on the page, so that their pictures compare."""
    anchor = f"frame-{frame.index}"
    left = figures.photograph(f"{anchor}-left", frame.left, max_pixels=max_pixels)
    right = figures.photograph(f"{anchor}-right", frame.right, max_pixels=max_pixels)
    grey = figures.grey_map(f"{anchor}-grey", frame.disparity, limits_px, max_pixels=max_pixels)
    colour = figures.colour_map(f"{anchor}-colour", frame.disparity, limits_px, max_pixels=max_pixels)
    reasons = figures.reason_map(f"{anchor}-reasons", frame.disparity, max_pixels=max_pixels)
    pictures = [left, right, grey, colour, reasons]
    before = None
    if frame.before is not None:
        raw_left = figures.photograph(f"{anchor}-raw-left", frame.before.left, max_pixels=max_pixels)
        raw_right = figures.photograph(f"{anchor}-raw-right", frame.before.right, max_pixels=max_pixels)
        pictures += [raw_left, raw_right]
        title = f"Frame {frame.index} before rectification, scan-lines across both views"
        before = _pair(raw_left, raw_right, frame.before.alignment, title=title, dashed=True)
    after_title = f"Frame {frame.index} aligned, scan-lines across both views"
    on_map = on_photograph = None
    if frame.profiles:
        regions = [profile.region for profile in frame.profiles]
        on_map = figures.region_figure(grey, regions, title="Regions on the disparity map")
        on_photograph = figures.region_figure(left, regions, title="Regions on the left view")
    answered = float(has_value(frame.disparity.validity).mean())
    return FrameView(
        anchor=anchor,
        index=frame.index,
        name=frame.name,
        facts=_facts(frame, answered),
        is_wide=left.width > _WIDE_ASPECT * left.height,
        definitions=figures.definitions(pictures),
        before=before,
        after=_pair(left, right, frame.alignment, title=after_title, dashed=False),
        residuals=_residuals(frame),
        grey=figures.plain_figure(grey, title="Disparity in grey, nearer is brighter, black has no answer"),
        grey_scale=figures.colour_bar(limits_px, frame.geometry, grey=True),
        colour=figures.plain_figure(colour, title="Disparity in colour, red is near, blue is far, dark has no answer"),
        colour_scale=figures.colour_bar(limits_px, frame.geometry, grey=False),
        in_metres=frame.geometry is not None,
        valid_share=percent(answered),
        reasons=figures.plain_figure(reasons, title="Pixels without a measured answer, by reason", under=left),
        reason_rows=_reason_rows(frame),
        regions_on_map=on_map,
        regions_on_photograph=on_photograph,
        regions=[_region(profile, limits_px, frame.truth) for profile in frame.profiles],
        obstacles=figures.obstacle_figure(left, frame.obstacles, title="Obstacles on the left view"),
        obstacle_rows=[_obstacle(o, frame.truth) for o in sorted(frame.obstacles, key=_by_range)],
        missed=[] if frame.truth is None else list(frame.truth.missed),
        scan=None if frame.scan is None else top_view(frame.scan, frame.tracks, title="The floor from above"),
        scan_facts=[] if frame.scan is None else _scan_facts(frame.scan),
        track_rows=[_track(track) for track in frame.tracks if track.confirmed],
        has_truth=frame.truth is not None and bool(frame.truth.obstacle_range_m),
    )


def _by_range(obstacle: ObstacleLike) -> float:
    return obstacle.range_m if math.isfinite(obstacle.range_m) else math.inf


def _facts(frame: FrameSection, answered: float) -> Facts:
    height, width = frame.left.shape[:2]
    facts = [("size", f"{width} × {height} px"), ("valid pixels", percent(answered))]
    if frame.alignment is not None:
        facts.append(("vertical residual", quantity(abs(frame.alignment.median_px), "px")))
    facts.append(("obstacles", str(len(frame.obstacles))))
    if frame.stage_ms:
        facts.append(("time", quantity(total_ms(frame), "ms", 1)))
    if frame.geometry is not None:
        facts.append(("focal length", quantity(frame.geometry.focal_px, "px", 1)))
        facts.append(("baseline", quantity(1000.0 * frame.geometry.baseline_m, "mm", 1)))
    return facts


def _pair(
    left: figures.Picture, right: figures.Picture, alignment: AlignmentLike | None, *, title: str, dashed: bool
) -> PairView:
    lines = figures.scan_lines(alignment, left.height)
    return PairView(
        figure=figures.pair_figure(left, right, lines, title=title, dashed=dashed),
        residual=ABSENT if alignment is None else quantity(abs(alignment.median_px), "px"),
        spread=ABSENT if alignment is None else quantity(alignment.spread_px, "px"),
        matches=ABSENT if alignment is None else number(alignment.matches, 0),
        has_rings=any(line.left is not None for line in lines),
    )


def _vertical_residual(alignment: AlignmentLike) -> Floats:
    left, right = np.asarray(alignment.left_px, np.float64), np.asarray(alignment.right_px, np.float64)
    return left.reshape(-1, 2)[:, 1] - right.reshape(-1, 2)[:, 1]


def _residuals(frame: FrameSection) -> Markup | None:
    groups = []
    if frame.before is not None and frame.before.alignment is not None:
        groups.append(("before", _vertical_residual(frame.before.alignment), "c1"))
    if frame.alignment is not None:
        groups.append(("aligned", _vertical_residual(frame.alignment), "c0"))
    sizes = [np.abs(values[np.isfinite(values)]) for _, values, _ in groups]
    if not any(size.size for size in sizes):
        return None
    reach = max(1.0, *(1.1 * float(np.quantile(size, 0.98)) for size in sizes if size.size))
    return histogram(
        title="Vertical residual between the two views",
        x_label="row in the left view − row in the right view, px",
        groups=groups,
        limits=(-reach, reach),
    )


def _reason_rows(frame: FrameSection) -> list[ReasonRow]:
    validity = frame.disparity.validity
    rows = []
    for reason in REASONS:
        share = float(((validity & np.uint8(reason.bit)) != 0).mean())
        if share > 0.0:
            rows.append(ReasonRow(label=reason.label, colour=reason.colour, share=percent(share)))
    return rows


def _region(profile: ProfileLike, limits_px: Limits, truth: FrameTruth | None) -> RegionView:
    region = profile.region
    known = truth or FrameTruth()
    range_truth_m = known.region_range_m.get(region.name)
    facts = [
        ("nearest range", plus_minus(profile.range_m, profile.sigma_m, "m")),
        ("minimum", quantity(profile.minimum, "px")),
        ("maximum", quantity(profile.maximum, "px")),
        ("total", quantity(profile.total, "px", 0)),
        ("valid pixels", percent(profile.valid_share)),
    ]
    if range_truth_m is not None:
        facts[1:1] = [
            ("true nearest range", quantity(range_truth_m, "m", 3)),
            ("error", signed_percent(relative_error(profile.range_m, range_truth_m))),
        ]
    return RegionView(
        name=region.name,
        box=f"columns {region.x}–{region.x + region.width - 1}, rows {region.y}–{region.y + region.height - 1}",
        value_chart=_value_chart(profile, limits_px, known.column_disparity_px.get(region.name)),
        range_chart=range_chart(profile, truth_m=known.column_range_m.get(region.name)),
        facts=facts,
        supported=bool(np.isfinite(profile.nearest_px).any()),
    )


def _value_chart(profile: ProfileLike, limits_px: Limits, truth_px: Floats | None) -> Markup:
    axis = value_axis(profile, include=limits_px)
    bottom, top = axis.limits
    levels = [level for level in (50, 100, 150, 200, 255) if bottom <= grey_level_disparity(level, limits_px) <= top]
    grey = SecondAxis(
        label="grey level", ticks=[(grey_level_disparity(level, limits_px), str(level)) for level in levels]
    )
    return value_chart(profile, axis=axis, second=grey, truth_px=truth_px)


def _obstacle(obstacle: ObstacleLike, truth: FrameTruth | None) -> ObstacleRow:
    true_range_m = None if truth is None else truth.obstacle_range_m.get(obstacle.id)
    return ObstacleRow(
        id=obstacle.id,
        region=obstacle.region,
        range=plus_minus(obstacle.range_m, obstacle.sigma_m, "m"),
        bearing=_bearing(obstacle.bearing_rad),
        size=f"{number(obstacle.width_m)} × {number(obstacle.height_m)}",
        support=number(obstacle.support, 0),
        truth=quantity(true_range_m, "m", 3),
        error=signed_percent(relative_error(obstacle.range_m, true_range_m)),
    )


def _bearing(bearing_rad: float) -> str:
    degrees = math.degrees(bearing_rad)
    side = "" if abs(degrees) < 0.05 or not math.isfinite(degrees) else (" right" if degrees > 0.0 else " left")
    return quantity(abs(degrees), "°", 1).replace("\u00a0", "") + side


def _track(track: TrackLike) -> TrackRow:
    right_mps, forward_mps = track.velocity_mps
    return TrackRow(
        id=track.id,
        range=plus_minus(track.range_m, track.sigma_m, "m"),
        bearing=_bearing(track.bearing_rad),
        ahead=number(forward_mps),
        right=number(right_mps),
        age=quantity(track.age_s, "s", 1),
        hits=number(track.hits, 0),
        seen=track.misses == 0,
    )


def _scan_facts(scan: ScanLike) -> Facts:
    seen = np.asarray(scan.seen)
    shares = [float((seen == code).mean()) if seen.size else math.nan for code in (2, 1, 0)]
    free_m = np.asarray(scan.free_to_m, np.float64)
    known = free_m[np.isfinite(free_m)]
    return [
        ("directions with an obstacle", percent(shares[0])),
        ("with nothing in range", percent(shares[1])),
        ("unknown", percent(shares[2])),
        ("median free distance", quantity(float(np.median(known)) if known.size else math.nan, "m")),
        ("looked as far as", quantity(scan.max_range_m, "m")),
    ]
