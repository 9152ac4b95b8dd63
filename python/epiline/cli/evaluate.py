"""`epiline evaluate`: our matcher on scenes with ground truth, or a disparity file against its truth."""

from __future__ import annotations

import argparse
import csv
import dataclasses
import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from epiline._core import StereoMatcher
from epiline.cli.arguments import whole
from epiline.cli.console import print_json, print_table, progress, say

if TYPE_CHECKING:
    from epiline.evaluation import Evaluation, Scene

_COLUMNS = ("density", "bad1_total", "bad2_total", "bad2_matched", "bad1_matched", "avg", "d1_total")
# Without tests nothing removes a wrong match, and a larger window makes fewer of them.
_UNTESTED_WINDOW = 15
_SETTINGS: dict[str, dict[str, Any]] = {
    "sad, all tests (preset fast)": {"preset": "fast"},
    "sad, no tests": {"method": "sad", "block_size": _UNTESTED_WINDOW},
    "sad, all tests, filled": {"preset": "fast", "fill": True},
    "semi-global, all tests (preset balanced)": {"preset": "balanced"},
    "semi-global, all tests, filled (preset accurate)": {"preset": "accurate", "fill": True},
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "root",
        type=Path,
        metavar="FOLDER",
        help="a folder of scenes with manifest.json, or a disparity file with --truth",
    )
    parser.add_argument("--truth", type=Path, metavar="FILE", help="ground truth of the one disparity file given")
    parser.add_argument(
        "--truth-scale", type=float, default=1.0, metavar="S", help="stored truth = S * disparity (256 for KITTI)"
    )
    parser.add_argument("--scale", type=float, default=1.0, metavar="S", help="the same for the disparity file")
    parser.add_argument("--scenes", nargs="+", metavar="TEXT", help="only scenes whose name contains one of these")
    parser.add_argument("--per-scene", action="store_true", help="a row per scene, not only per family")
    parser.add_argument("--threads", type=whole(1), metavar="N", help="threads of the matcher (default: all cores)")
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print one JSON object")
    output.add_argument("--csv", action="store_true", help="print a line per setting and scene")


def run(args: argparse.Namespace) -> None:
    if args.truth:
        _score_file(args)
        return
    from epiline.evaluation import load_scenes

    wanted = args.scenes or [""]
    scenes = [scene for scene in load_scenes(args.root) if any(text in scene.name for text in wanted)]
    if not scenes:
        raise ValueError(f"{args.root}: no scene's name contains {' or '.join(wanted)}")
    rows = _score_scenes(scenes, args.threads)
    if args.json:
        print_json({"scenes": [{"setting": s, "scene": n, **dataclasses.asdict(e)} for s, n, e in rows]})
    elif args.csv:
        say(_as_csv(rows).rstrip())
    else:
        _print_means(rows, len(scenes), per_scene=args.per_scene)


def _score_file(args: argparse.Namespace) -> None:
    from epiline.evaluation import evaluate
    from epiline.evaluation.readers import read_disparity

    scores = dataclasses.asdict(
        evaluate(read_disparity(args.root, scale=args.scale), read_disparity(args.truth, scale=args.truth_scale))
    )
    if args.json:
        print_json(scores)
    else:
        print_table(str(args.root), tuple(scores), [tuple(scores.values())])


def _score_scenes(scenes: Sequence[Scene], threads: int | None) -> list[tuple[str, str, Evaluation]]:
    from epiline.evaluation import evaluate

    rows = []
    with progress("matching", len(scenes) * len(_SETTINGS)) as advance:
        for scene in scenes:
            for setting, parameters in _SETTINGS.items():
                matcher = StereoMatcher(num_disparities=scene.num_disparities, threads=threads, **parameters)
                disparity = matcher(scene.left, scene.right)
                rows.append((setting, scene.name, evaluate(disparity, scene.truth, scene.non_occluded)))
                advance()
    return rows


def _as_csv(rows: Sequence[tuple[str, str, Evaluation]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["setting", "scene", *(field.name for field in dataclasses.fields(rows[0][2]))])
    for setting, name, scores in rows:
        writer.writerow([setting, name, *dataclasses.astuple(scores)])
    return text.getvalue()


def _print_means(rows: Sequence[tuple[str, str, Evaluation]], scenes: int, *, per_scene: bool) -> None:
    groups = list(dict.fromkeys(name if per_scene else name.split("/")[0] for _, name, _ in rows))
    say(
        "non-occluded pixels; total counts a pixel without an answer as wrong, matched leaves it out; means over scenes"
    )
    for setting in _SETTINGS:
        own = [(name, scores) for s, name, scores in rows if s == setting]
        table = []
        for group in (*groups, f"all {scenes} scenes"):
            members = [
                e for name, e in own if group.startswith("all ") or name == group or name.startswith(f"{group}/")
            ]
            means = [float(np.mean([getattr(e, column) for e in members])) for column in _COLUMNS]
            table.append((group, *(f"{value:.2f}" if math.isfinite(value) else "-" for value in means)))
        print_table(setting, ("", *(c.replace("_", " ") for c in _COLUMNS)), table)
