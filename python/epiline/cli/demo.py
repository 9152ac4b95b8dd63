"""`epiline demo`: the whole system on a rendered rig, every answer beside the truth."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from epiline._core import (
    FrameResult,
    Pipeline,
    Region,
    StereoCalibration,
    alignment_error,
    fit_range_curve,
    paper_regions,
)
from epiline._operations import calibrate
from epiline.cli.arguments import add_matcher_arguments, matcher_from, whole
from epiline.cli.console import print_json, print_table, progress, say
from epiline.cli.reporting import calibration_section
from epiline.targets.boards import Chessboard
from epiline.verdict import Verdict, judge

if TYPE_CHECKING:
    from epiline.report import CalibrationSection, FrameTruth, RangeCurveSection, TruthRow
    from epiline.sources.rendered import RenderedFrame, RenderedRig, ViewTruth
    from epiline.targets import Observations

_BOARD = Chessboard(columns=9, rows=6, square_m=0.04)
# What the demo promises of each region's nearest range: (up to metres, share of the truth).
_PROMISES = ((4.0, 0.02), (8.0, 0.05))
# A surface counts from this many pixels on, in the measured regions and in the truth beside them.
_SUPPORT_PX = 30
# The camera drives half a metre above the floor with a tenth of a metre between its eyes: the floor puts about four
# rows into each pixel of disparity, smeared by the window to a dozen. What stands upright has more.
_MIN_SUPPORT_PX = 20
# An object shows in a box with at least this many pixels.
_OBJECT_PX = 8
# Four constants and one to spare.
_CURVE_POINTS = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("epiline-demo"),
        metavar="FOLDER",
        help="for report.html and rig.yaml (default %(default)s)",
    )
    parser.add_argument(
        "--frames", type=whole(1), default=6, metavar="N", help="frames of the drive (default %(default)s)"
    )
    parser.add_argument(
        "--boards", type=whole(3), default=16, metavar="N", help="photographs of the board (default %(default)s)"
    )
    parser.add_argument(
        "--seed", type=whole(0), default=0, metavar="N", help="another world, other noise (default %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_matcher_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from epiline.sources.rendered import RenderedRig

    args.output.mkdir(parents=True, exist_ok=True)
    rig = RenderedRig(seed=args.seed)
    observations = _photograph_boards(rig, args.boards)
    calibration = calibrate(observations)
    calibration.save(args.output / "rig.yaml")
    width, height = rig.truth.image_size
    pipeline = Pipeline(
        calibration,
        matcher=matcher_from(args, width),
        regions=_regions(width, height),
        min_support=_MIN_SUPPORT_PX,
    )
    drive = _drive(rig, pipeline, args.frames)
    rows = _recovered(calibration, rig)
    verdict = judge(calibration, observations)
    section = calibration_section(calibration, observations, verdict, tuple(rows))
    _write_report(args.output / "report.html", section, drive)
    if args.json:
        print_json(_as_json(rows, calibration, drive))
        return
    _print_calibration(calibration, observations, verdict, rows)
    _print_drive(drive)
    say(f"wrote {args.output / 'report.html'} and {args.output / 'rig.yaml'}")


def _regions(width: int, height: int) -> list[Region]:
    """The paper's four bands, and two narrow boxes that look past what is near."""
    ahead = Region("ahead", x=width * 39 // 100, y=height * 40 // 100, width=width * 14 // 100, height=height // 8)
    beyond = Region("beyond", x=width * 52 // 100, y=height * 46 // 100, width=width * 3 // 100, height=height // 16)
    return [*paper_regions(width, height), ahead, beyond]


@dataclass(frozen=True)
class _Seen:
    """One frame's answer and the truth of it."""

    frame: RenderedFrame
    result: FrameResult
    truth: FrameTruth
    obstacle_names: dict[int, str]


@dataclass
class _Drive:
    """The frames, and (disparity px, true range m) of every region's nearest surface: what eq. 6 is fitted to."""

    seen: list[_Seen] = field(default_factory=list)
    disparity_px: list[float] = field(default_factory=list)
    distance_m: list[float] = field(default_factory=list)


def _photograph_boards(rig: RenderedRig, count: int) -> Observations:
    from epiline.targets import find_boards

    views = []
    with progress("photographing the board", count) as advance:
        for view in rig.board_views(_BOARD.columns, _BOARD.rows, _BOARD.square_m, count):
            views.append((view.left, view.right))
            advance()
    left, right = zip(*views, strict=True)
    return find_boards(left, right, _BOARD)


def _drive(rig: RenderedRig, pipeline: Pipeline, count: int) -> _Drive:
    drive = _Drive()
    with progress("driving", count) as advance:
        for frame in rig.frames(count):
            result = pipeline.process(frame.left, frame.right)
            truth, names = _truth_of(rig, frame, result)
            drive.seen.append(_Seen(frame, result, truth, names))
            for profile in result.profiles:
                true_m = truth.region_range_m[profile.region.name]
                if math.isfinite(profile.range_m) and math.isfinite(true_m):
                    # The measured disparity that the range stands for, read back through eq. 2 on the axis.
                    drive.disparity_px.append(result.pair.geometry.disparity_px(profile.range_m))
                    drive.distance_m.append(true_m)
            advance()
    return drive


def _truth_of(rig: RenderedRig, frame: RenderedFrame, result: FrameResult) -> tuple[FrameTruth, dict[int, str]]:
    from epiline.report import FrameTruth
    from epiline.sources.rendered import column_nearest, nearest_supported, seen_by_right, true_aligned

    geometry = result.pair.geometry
    view = true_aligned(rig.tracer, frame.world_from_left, geometry)
    # No stereo system can measure what only one of its cameras sees.
    range_m = np.where(
        seen_by_right(view, rig.truth, frame.world_from_left) & result.pair.left_valid, view.range_m, np.nan
    )
    depth_m = np.where(np.isnan(range_m), np.nan, view.depth_m)
    regions, column_range, column_disparity = {}, {}, {}
    for profile in result.profiles:
        box = (profile.region.x, profile.region.y, profile.region.width, profile.region.height)
        window = np.s_[box[1] : box[1] + box[3], box[0] : box[0] + box[2]]
        regions[profile.region.name] = nearest_supported(range_m[window], _SUPPORT_PX)
        column_range[profile.region.name] = column_nearest(range_m, box)
        nearest_depth = column_nearest(depth_m, box)
        column_disparity[profile.region.name] = geometry.focal_px * geometry.baseline_m / nearest_depth
    ranges, names = _obstacle_truth(result, view)
    truth = FrameTruth(
        region_range_m=regions,
        column_disparity_px=column_disparity,
        column_range_m=column_range,
        obstacle_range_m=ranges,
    )
    return truth, names


def _obstacle_truth(result: FrameResult, view: ViewTruth) -> tuple[dict[int, float], dict[int, str]]:
    """For each obstacle found: what of the scene is nearest in its box at about that range."""
    from epiline.sources.rendered import nearest_supported

    ranges, names = {}, {}
    for obstacle in result.obstacles:
        x, y, width, height = obstacle.box
        window = np.s_[y : y + height, x : x + width]
        ids, range_m = view.object_id[window], view.range_m[window]
        candidates = [
            (nearest_supported(range_m[ids == number], _OBJECT_PX), view.scene.names[number])
            for number in np.unique(ids)
        ]
        known = [candidate for candidate in candidates if math.isfinite(candidate[0])]
        closest = min(known, key=lambda c: abs(c[0] - obstacle.range_m), default=(math.nan, ""))
        ranges[obstacle.id], names[obstacle.id] = closest
    return ranges, names


def _recovered(calibration: StereoCalibration, rig: RenderedRig) -> list[TruthRow]:
    from epiline.report import TruthRow

    rows = [
        TruthRow(name="baseline", recovered=1e3 * calibration.baseline_m, truth=1e3 * rig.truth.baseline_m, unit="mm")
    ]
    for side in ("left", "right"):
        found, true = getattr(calibration, side), getattr(rig.truth, side)
        for name, at in (("fx", (0, 0)), ("fy", (1, 1)), ("cx", (0, 2)), ("cy", (1, 2))):
            rows.append(
                TruthRow(
                    name=f"{side} {name}", recovered=found.camera_matrix[at], truth=true.camera_matrix[at], unit="px"
                )
            )
    turn = calibration.rotation @ np.asarray(rig.truth.rotation).T
    angle_deg = math.degrees(math.acos(min(1.0, (float(np.trace(turn)) - 1) / 2)))
    rows.append(TruthRow(name="rotation off by", recovered=angle_deg, truth=0.0, unit="°"))
    return rows


def _region_rows(drive: _Drive) -> list[tuple[int, str, float, float, float]]:
    """(frame, region, range m, sigma m, true range m) of every region of every frame."""
    return [
        (seen.frame.seq, p.region.name, p.range_m, p.sigma_m, seen.truth.region_range_m[p.region.name])
        for seen in drive.seen
        for p in seen.result.profiles
    ]


def _worst(drive: _Drive) -> list[tuple[float, float, float, int]]:
    """(up to m, promised share, worst share, how many) for each promise; a range not found counts as infinite."""
    worst = []
    low = 0.0
    for high, share in _PROMISES:
        errors = [
            abs(range_m - true_m) / true_m if math.isfinite(range_m) else math.inf
            for _, _, range_m, _, true_m in _region_rows(drive)
            if low < true_m <= high
        ]
        worst.append((high, share, max(errors, default=0.0), len(errors)))
        low = high
    return worst


def _print_calibration(
    calibration: StereoCalibration, observations: Observations, verdict: Verdict, rows: Sequence[TruthRow]
) -> None:
    cells = [
        (
            r.name,
            f"{r.recovered:.4f}",
            f"{r.truth:.4f}",
            f"{100 * (r.recovered / r.truth - 1):+.3f} %" if r.truth else "",
            r.unit,
        )
        for r in rows
    ]
    title = f"calibration from {len(observations)} of {len(observations.views)} board pairs"
    print_table(title, ("", "recovered", "truth", "error", "unit"), cells)
    say(f"stereo rms {calibration.rms_px:.4f} px, held-out epipolar error {calibration.epipolar_error_px:.4f} px")
    say(f"verdict: {verdict}")


def _print_drive(drive: _Drive) -> None:
    cells = [
        (seq, name, f"{range_m:.3f} ± {sigma_m:.3f}", f"{true_m:.3f}", f"{100 * (range_m / true_m - 1):+.2f} %")
        for seq, name, range_m, sigma_m, true_m in _region_rows(drive)
    ]
    print_table("nearest range of each region", ("frame", "region", "range m", "truth m", "error"), cells)
    for high, share, worst, count in _worst(drive):
        say(f"up to {high:g} m: worst error {100 * worst:.2f} % of {count} (promised {100 * share:g} %)")
    seen = drive.seen[-1]
    obstacles = [
        (
            seen.obstacle_names[o.id],
            o.region,
            f"{o.range_m:.3f} ± {o.sigma_m:.3f}",
            f"{seen.truth.obstacle_range_m[o.id]:.3f}",
            f"{math.degrees(o.bearing_rad):+.1f}°",
            f"{o.width_m:.2f}",
        )
        for o in seen.result.obstacles
    ]
    columns = ("obstacle", "region", "range m", "truth m", "bearing", "width m")
    print_table(f"obstacles of frame {seen.frame.seq}", columns, obstacles)
    stages = seen.result.stage_ms
    say("stages, ms: " + ", ".join(f"{name} {ms:.1f}" for name, ms in stages.items()))


def _as_json(rows: Sequence[TruthRow], calibration: StereoCalibration, drive: _Drive) -> dict[str, object]:
    names = ("frame", "region", "range_m", "sigma_m", "truth_m")
    return {
        "recovered": {row.name: {"value": row.recovered, "truth": row.truth, "unit": row.unit} for row in rows},
        "rms_px": calibration.rms_px,
        "epipolar_error_px": calibration.epipolar_error_px,
        "regions": [dict(zip(names, row, strict=True)) for row in _region_rows(drive)],
        "worst": [{"up_to_m": m, "promised": p, "worst": w, "count": n} for m, p, w, n in _worst(drive)],
        "obstacles": [
            {
                "frame": seen.frame.seq,
                "name": seen.obstacle_names[o.id],
                "region": o.region,
                "range_m": o.range_m,
                "sigma_m": o.sigma_m,
                "truth_m": seen.truth.obstacle_range_m[o.id],
            }
            for seen in drive.seen
            for o in seen.result.obstacles
        ],
    }


def _write_report(path: Path, section: CalibrationSection, drive: _Drive) -> None:
    from epiline.cli.reporting import provenance
    from epiline.report import FrameSection, RawPair, RunReport, write_report

    frames = [
        FrameSection.from_result(
            seen.result,
            index=seen.frame.seq,
            name=seen.frame.name,
            before=RawPair(
                left=seen.frame.left,
                right=seen.frame.right,
                alignment=alignment_error(seen.frame.left, seen.frame.right),
            ),
            truth=seen.truth,
        )
        for seen in drive.seen
    ]
    report = RunReport(
        title="Demo",
        subtitle="A rendered rig: every figure stands beside its truth.",
        provenance=provenance(),
        calibration=section,
        frames=frames,
        range_curve=_curve_section(drive),
    )
    write_report(report, path)


def _curve_section(drive: _Drive) -> RangeCurveSection | None:
    from epiline.report import RangeCurveSection

    disparity_px, distance_m = np.array(drive.disparity_px), np.array(drive.distance_m)
    if len(disparity_px) < _CURVE_POINTS:
        return None
    curve = fit_range_curve(disparity_px, distance_m)
    source = "nearest surface of every region"
    return RangeCurveSection(curve=curve, disparity_px=disparity_px, distance_m=distance_m, source=source)
