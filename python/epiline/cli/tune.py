"""`epiline tune`: parameters for somebody's own scenes, and why."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from epiline._files import write_atomically
from epiline.cli.arguments import positive, whole
from epiline.cli.console import note, print_json, print_table, progress, say

if TYPE_CHECKING:
    from epiline.evaluation import Scene
    from epiline.tuning import DisparityRange, Objective, Search, Trial
    from epiline.tuning.search import Pair

_DEFAULT_OBJECTIVE, _DEFAULT_FILLED = "bad2@80", "bad2"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("images", nargs="*", type=Path, metavar="LEFT RIGHT", help="one aligned pair, or several")
    parser.add_argument("--truth", nargs="+", type=Path, metavar="FILE", help="ground truth of each pair, if there is")
    parser.add_argument("--truth-scale", type=positive, default=1.0, metavar="S", help="stored truth = S * disparity")
    parser.add_argument(
        "--objective", metavar="WHAT", help="bad1, bad2, bad3 or d1, @DENSITY that must be answered (default bad2@80)"
    )
    parser.add_argument("--fill", action="store_true", help="answer every pixel; the objective is then bad2")
    parser.add_argument("--max-ms", type=positive, metavar="MS", help="slowest pair's time on this machine")
    parser.add_argument("--threads", type=whole(1), metavar="N", help="threads (default: all cores)")
    parser.add_argument("-o", "--output", type=Path, metavar="TOML", help="write what `epiline run --config` reads")
    parser.add_argument(
        "--check",
        type=Path,
        metavar="FOLDER",
        help="instead of tuning: on scenes with truth, how far the choice without it is from the choice with it",
    )
    parser.add_argument("--scenes", nargs="+", metavar="TEXT", help="with --check: only scenes with this in their name")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from epiline.tuning import parse_objective

    objective = parse_objective(args.objective or (_DEFAULT_FILLED if args.fill else _DEFAULT_OBJECTIVE))
    if args.check:
        if args.images or args.truth or args.output:
            raise ValueError("--check takes a folder of scenes, no images, truth or output")
        _check(args, objective)
        return
    _tune(args, objective)


def _tune(args: argparse.Namespace, objective: Objective) -> None:
    from epiline._images import read_image
    from epiline.tuning import Tuner, find_range

    if not args.images or len(args.images) % 2:
        raise ValueError(f"{len(args.images)} images: expected LEFT RIGHT, once or several times")
    names = list(zip(args.images[::2], args.images[1::2], strict=True))
    if args.truth and len(args.truth) != len(names):
        raise ValueError(f"{len(args.truth)} ground truths for {len(names)} pairs")
    images = []
    for left_path, right_path in names:
        left, right = read_image(left_path), read_image(right_path)
        _require_same_size(left_path, left, right_path, right)
        images.append((left, right))
    searched = find_range(images, args.threads)
    pairs = _pairs(args, names, images, searched)
    # With several pairs every other one is kept aside: the figure to believe is theirs.
    chosen_on, held_out = pairs[::2], pairs[1::2]
    options = {"max_ms": args.max_ms, "fill": args.fill, "threads": args.threads}
    with progress("trying settings", None) as advance:
        found = Tuner(chosen_on, searched, objective, **options, advance=advance).search()
        aside = Tuner(held_out, searched, objective, **options).trial(found.best.parameters) if held_out else None
    if args.output:
        write_atomically(args.output, _toml(args, objective, found).encode())
    if args.json:
        print_json(_report(args, objective, searched, found, aside))
    else:
        _print(args, objective, searched, found, aside)
    if args.output:
        note(f"wrote {args.output}")


def _pairs(
    args: argparse.Namespace,
    names: Sequence[tuple[Path, Path]],
    images: Sequence[tuple[Any, Any]],
    searched: DisparityRange,
) -> list[Pair]:
    from epiline.evaluation.readers import read_disparity
    from epiline.tuning import consensus_judge, truth_judge
    from epiline.tuning.search import Pair

    pairs = []
    for i, (left, right) in enumerate(images):
        if args.truth:
            truth = read_disparity(args.truth[i], scale=args.truth_scale)
            _require_same_size(names[i][0], left, args.truth[i], truth)
            judge = truth_judge(truth)
        else:
            judge = consensus_judge(left, right, searched, args.threads)
        pairs.append(Pair(left, right, judge))
    return pairs


def _require_same_size(first_path: Path, first: Any, second_path: Path, second: Any) -> None:
    if first.shape[:2] != second.shape[:2]:
        sizes = [
            f"{path}: {values.shape[1]}x{values.shape[0]} px"
            for path, values in ((first_path, first), (second_path, second))
        ]
        raise ValueError(", but ".join(sizes))


def _toml(args: argparse.Namespace, objective: Objective, found: Search) -> str:
    lines = [
        f"# epiline tune, {len(args.images) // 2} pair(s), {'ground truth' if args.truth else 'no ground truth'}:",
        f"# {objective} = {found.best.cost:.2f} % at a density of {found.best.quality.density:.1f} %",
        "[matcher]",
    ]
    for name, value in found.best.parameters.items():
        # What is None is off, as it is by default; TOML has no word for it.
        if value is not None:
            text = str(value).lower() if isinstance(value, bool) else repr(value) if isinstance(value, int) else None
            lines.append(f"{name} = {text if text is not None else chr(34) + str(value) + chr(34)}")
    return "\n".join(lines) + "\n"


def _report(
    args: argparse.Namespace, objective: Objective, searched: DisparityRange, found: Search, aside: Trial | None
) -> dict[str, Any]:
    return {
        "objective": str(objective),
        "judge": "truth" if args.truth else "consensus",
        "range": dataclasses.asdict(searched),
        "parameters": found.best.parameters,
        "cost": found.best.cost,
        "density": found.best.quality.density,
        "milliseconds": found.best.milliseconds,
        "held_out": None if aside is None else {"cost": aside.cost, "density": aside.quality.density},
        "steps": [
            {
                "parameter": step.parameter,
                "taken": step.taken,
                "reason": step.reason,
                "tried": [
                    {"value": v, "cost": t.cost, "density": t.quality.density, "milliseconds": t.milliseconds}
                    for v, t in step.tried
                ],
            }
            for step in found.steps
        ],
    }


def _print(
    args: argparse.Namespace, objective: Objective, searched: DisparityRange, found: Search, aside: Trial | None
) -> None:
    measure = f"{objective} %"
    by = "ground truth" if args.truth else "what accurate and block matching agree on"
    say(f"judged by {by}; {measure} is the smaller the better; above 100 means too few answers")
    print_table(
        "",
        ("preset", measure, "density %", "ms"),
        [(name, t.cost, t.quality.density, t.milliseconds) for name, t in found.steps[0].tried],
    )
    span = f"{searched.lowest_seen:g} to {searched.highest_seen:g} px"
    rows = [
        ("min_disparity", str(searched.first), f"the pairs' disparities are {span}; far things may lie below"),
        ("num_disparities", str(searched.count), "up to a tenth above the nearest seen"),
        *((step.parameter, str(step.taken), step.reason) for step in found.steps),
    ]
    wide = [max(len(row[i]) for row in rows) for i in (0, 1)]
    for name, value, reason in rows:
        say(f"{name:<{wide[0]}}  {value:>{wide[1]}}  {reason}")
    best = found.best
    say(f"chosen: {objective} {best.cost:.2f} % at density {best.quality.density:.1f} %, {best.milliseconds:.1f} ms")
    if aside is not None:
        say(f"on the pairs held out: {objective} {aside.cost:.2f} % at density {aside.quality.density:.1f} %")


def _check(args: argparse.Namespace, objective: Objective) -> None:
    from epiline.evaluation import load_scenes

    wanted = args.scenes or [""]
    scenes = [s for s in load_scenes(args.check) if any(text in s.name for text in wanted)]
    if not scenes:
        raise ValueError(f"{args.check}: no scene's name contains {' or '.join(wanted)}")
    rows = []
    with progress("tuning", len(scenes)) as advance:
        for scene in scenes:
            rows.append(_check_scene(args, objective, scene))
            advance()
    names = ("default", "without_truth", "with_truth")
    means = {
        group: [float(np.mean([row[name] for row in part])) for name in names]
        for group, part in (("all", rows), ("even half", rows[::2]), ("odd half", rows[1::2]))
        if part
    }
    if args.json:
        print_json({"objective": str(objective), "scenes": rows, "means": means})
        return
    columns = ("", "preset fast", "chosen without truth", "chosen with truth", "choices")
    table: list[tuple[object, ...]] = [
        (row["scene"], *(row[name] for name in names), f"{row['chosen_without']} / {row['chosen_with']}")
        for row in rows
    ]
    table += [(group, *values, "") for group, values in means.items()]
    print_table(f"{objective} % by the ground truth", columns, table)


def _check_scene(args: argparse.Namespace, objective: Objective, scene: Scene) -> dict[str, Any]:
    """The scene tuned twice, and both choices scored with its truth."""
    from epiline.tuning import Tuner, consensus_judge, find_range, truth_judge
    from epiline.tuning.search import Pair

    searched = find_range([(scene.left, scene.right)], args.threads)
    options = {"max_ms": args.max_ms, "fill": args.fill, "threads": args.threads}
    truth = Pair(scene.left, scene.right, truth_judge(scene.truth, scene.non_occluded))
    by_truth = Tuner([truth], searched, objective, **options)
    consensus = Pair(scene.left, scene.right, consensus_judge(scene.left, scene.right, searched, args.threads))
    without = Tuner([consensus], searched, objective, **options).search()
    best = by_truth.search()
    return {
        "scene": scene.name,
        "range": dataclasses.asdict(searched),
        "highest_truth": float(np.nanmax(scene.truth)),
        "default": by_truth.trial({"preset": "fast"}).cost,
        "without_truth": by_truth.trial(without.best.parameters).cost,
        "with_truth": best.best.cost,
        "chosen_without": without.steps[0].taken,
        "chosen_with": best.steps[0].taken,
    }
