"""`epiline evaluate --obstacles FOLDER`: nearest returns, ranges of regions and the ground on real photographs."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from epiline.cli.console import print_json, print_table, progress, say
from epiline.cli.tables import table_as_csv

if TYPE_CHECKING:
    from epiline.evaluation import Scene
    from epiline.evaluation.settings import Setting

_PRESETS = ("fast", "balanced", "accurate")
Row = tuple[str, str, dict[str, float]]


def run(args: argparse.Namespace) -> None:
    """Scores whatever of the folder has the truth for it."""
    wanted = args.scenes or [""]
    drives = [folder for folder in _drives(args.root) if any(text in folder.name for text in wanted)]
    scenes = [scene for scene in _scenes(args.root, bool(drives)) if any(text in scene.name for text in wanted)]
    if not scenes and not drives:
        raise ValueError(f"{args.root}: no scene's name contains {' or '.join(wanted)}")
    laser = [scene for scene in scenes if scene.family.startswith("kitti")]
    # A laser's truth, ETH3D's too, is too sparse for columns.
    dense = [scene for scene in scenes if not scene.family.startswith(("kitti", "eth3d"))]
    if not laser and not dense and not drives:
        raise ValueError(f"{args.root}: no scene of Middlebury's or KITTI's kind among {len(scenes)}")
    presets = tuple(args.preset or _PRESETS)
    tables: dict[str, list[Row]] = {}
    with progress("matching", None) as advance:
        if dense:
            tables["columns"] = _columns(dense, presets, args.threads, advance)
        if laser:
            settings = _settings(args.preset)
            tables["road"], tables["regions"] = _laser(laser, settings, args.threads, advance)
        if drives:
            tables["ground"] = _grounds(drives, presets, args.threads, advance)
    _print(args, tables, len(dense), len(laser))


def _scenes(root: Path, may_lack: bool) -> list[Scene]:
    from epiline.evaluation import load_scenes

    try:
        return list(load_scenes(root))
    except ValueError:
        # A folder that is a drive has no scenes and need have none.
        if may_lack and not (root / "manifest.json").exists():
            return []
        raise


def _drives(root: Path) -> list[Path]:
    """The folder itself or those in it that hold a car's drive."""
    from epiline.evaluation.obstacles.ground import is_car_sequence

    return [folder for folder in (root, *sorted(root.glob("*/"))) if is_car_sequence(folder)]


def _grounds(
    drives: Sequence[Path], presets: tuple[str, ...], threads: int | None, advance: Callable[[], object]
) -> list[Row]:
    from epiline.evaluation.obstacles.ground import car_run

    return [
        (preset, drive.name, car_run(drive, preset, threads, advance).steadiness())
        for drive in drives
        for preset in presets
    ]


def _columns(
    scenes: Sequence[Scene], presets: tuple[str, ...], threads: int | None, advance: Callable[[], object]
) -> list[Row]:
    import dataclasses

    from epiline.evaluation.obstacles.columns import column_methods, score_columns

    rows: list[Row] = []
    for method in column_methods(presets, threads):
        scored = []
        for scene in scenes:
            scored.append(dataclasses.asdict(score_columns(method.returns(scene), scene.truth)))
            advance()
        for group, members in _halves(scored):
            rows.append((method.name, group, _mean(members)))
    return rows


def _settings(presets: Sequence[str] | None) -> list[Setting]:
    """The presets asked for; by default the pipeline's own matcher and all presets."""
    from epiline._core import Pipeline, RectifiedGeometry
    from epiline.evaluation.settings import Setting

    chosen = [Setting(preset, {"preset": preset}) for preset in presets or _PRESETS]
    if presets:
        return chosen
    any_rig = RectifiedGeometry(width=640, height=480, focal_px=500, cx_px=320, cy_px=240, baseline_m=0.1)
    own = dict(Pipeline(any_rig, ground=False).matcher_parameters)
    # These are the scene's and the caller's.
    del own["num_disparities"], own["threads"]
    return [Setting("the pipeline's own", own), *chosen]


def _laser(
    scenes: Sequence[Scene], settings: Sequence[Setting], threads: int | None, advance: Callable[[], object]
) -> tuple[list[Row], list[Row]]:
    """The obstacles and the regions of each map, which is matched once."""
    from epiline.evaluation.obstacles.regions import compare, kitti_geometry
    from epiline.evaluation.obstacles.road import compare_road

    road: list[Row] = []
    regions: list[Row] = []
    for setting in settings:
        scores, frames = [], []
        for scene in scenes:
            disparity = setting.map(scene.left, scene.right, scene.num_disparities, threads)
            truth, geometry = np.asarray(scene.truth, float), kitti_geometry(scene)
            scores.append(compare_road(disparity, truth, geometry))
            frames.append(compare(disparity, truth, geometry))
            advance()
        road += [(setting.name, group, sum(of[1:], of[0]).figures()) for group, of in _halves(scores)]
        for group, members in _halves(frames):
            counts = {
                "silent": float(sum(frame.silent for frame in members)),
                "left_out": float(sum(frame.left_out for frame in members)),
                "offset_px": float(np.mean([frame.offset_px for frame in members])),
            }
            seen = [flag for frame in members for flag in frame.seen]
            for name, samples in (
                ("as it is", [sample for frame in members for sample in frame.samples]),
                ("less the offset", [sample for frame in members for sample in frame.without_offset]),
            ):
                errors = [sample.error for sample in samples]
                on_seen = [error for error, flag in zip(errors, seen, strict=True) if flag]
                regions.append((setting.name, f"{group}, {name}", {**_errors(errors), **counts}))
                regions.append((setting.name, f"{group}, {name}, seen", {**_errors(on_seen), **counts}))
    return road, regions


def _errors(errors: Sequence[float]) -> dict[str, float]:
    percent = 100 * np.abs(errors) if len(errors) else np.array([np.nan])
    signed = 100 * np.asarray(errors) if len(errors) else np.array([np.nan])
    return {
        "regions": float(len(errors)),
        "median_error": float(np.median(percent)),
        "p95_error": float(np.percentile(percent, 95)),
        "bias": float(np.median(signed)),
    }


def _halves(members: Sequence[Any]) -> Iterator[tuple[str, Sequence[Any]]]:
    """All, then every other one by name."""
    yield f"all {len(members)}", members
    if len(members) > 1:
        yield "even half", members[::2]
        yield "odd half", members[1::2]


def _mean(members: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: float(np.nanmean([member[name] for member in members])) for name in members[0]}


def _print(args: argparse.Namespace, tables: dict[str, list[Row]], dense: int, laser: int) -> None:
    if args.json:
        print_json(
            {name: [{"method": m, "scenes": group, **f} for m, group, f in rows] for name, rows in tables.items()}
        )
        return
    if args.csv:
        lines = [
            (name, *row[:2], key, value)
            for name, rows in tables.items()
            for row in rows
            for key, value in row[2].items()
        ]
        say(table_as_csv(("table", "method", "scenes", "figure", "value"), lines).rstrip())
        return
    titles = {
        "columns": f"nearest return of each column, {dense} scenes: off by more than 2 px, % of columns",
        "road": f"obstacles up to 25 m on streets, {laser} frames",
        "regions": f"nearest range of regions, {laser} frames: error %",
    }
    for name, rows in tables.items():
        if name == "ground":
            _print_grounds(rows)
            continue
        columns = tuple(rows[0][2])
        print_table(
            titles[name],
            ("", "scenes", *(column.removesuffix("_m").replace("_off", "").replace("_", " ") for column in columns)),
            [(method, group, *figures.values()) for method, group, figures in rows],
        )


def _print_grounds(rows: Sequence[Row]) -> None:
    """A line for each quantity: side by side they are wider than any terminal."""
    quantities = {"height": "height %", "pitch": "pitch deg", "pitch_less_nod": "less nodding", "roll": "roll deg"}
    lines: list[tuple[object, ...]] = []
    for method, drive, figures in rows:
        first: tuple[object, ...] = (method, drive, figures["found"], figures.get("camera_height_m", float("nan")))
        for quantity, title in quantities.items():
            off = [figures.get(f"{quantity}_off_{of}", float("nan")) for of in ("median", "p90", "worst")]
            lines.append((*first, title, *off))
            first = ("",) * 4
    print_table(
        "the ground over a drive: how far frames are from its median",
        ("", "drive", "found %", "camera m", "", "median", "90th", "worst"),
        lines,
    )
