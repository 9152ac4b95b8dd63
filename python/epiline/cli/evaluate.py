"""`epiline evaluate`: our matcher on scenes with ground truth, or a disparity file against its truth."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from epiline._core import StereoMatcher
from epiline.cli import evaluate_obstacles, evaluate_scenes
from epiline.cli.arguments import METHODS, PRESETS, parameter, whole
from epiline.cli.console import print_json, print_table, progress, say
from epiline.cli.tables import table_as_csv

if TYPE_CHECKING:
    from epiline.evaluation import Scene
    from epiline.evaluation.measures import Measures
    from epiline.evaluation.settings import Method

# Of the common measures the table shows these; JSON and CSV have all.
_COMMON = ("density", "bad1_total", "bad2_total", "bad2_matched", "bad1_matched", "avg", "d1_total")
# The nine of ../shared/reference/matching.md: the Middlebury scenes of ordinary size from 2003 on.
_ROBUSTNESS_SCENES = (
    "middlebury2003/",
    "middlebury2005/",
    "middlebury2005-2006/",
    "middlebury2005_b/",
    "middlebury2006/",
    "middlebury2014",
)


@dataclass(frozen=True)
class Result:
    """The measures of one setting in one region of one scene."""

    setting: str
    scene: str
    region: str
    measures: Measures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "root",
        type=Path,
        nargs="?",
        metavar="FOLDER",
        help="scenes by a manifest.json or laid out as Middlebury, KITTI or ETH3D; or a disparity file with --truth",
    )
    parser.add_argument("--truth", type=Path, metavar="FILE", help="ground truth of the one disparity file given")
    parser.add_argument(
        "--truth-scale", type=float, default=1.0, metavar="S", help="stored truth = S * disparity (256 for KITTI)"
    )
    parser.add_argument("--scale", type=float, default=1.0, metavar="S", help="the same for the disparity file")
    parser.add_argument("--scenes", nargs="+", metavar="TEXT", help="only scenes whose name contains one of these")
    parser.add_argument("--per-scene", action="store_true", help="a row per scene, not only per family")
    parser.add_argument("--halves", action="store_true", help="also the means of every other scene, by name")
    parser.add_argument("--robustness", action="store_true", help="bad1 when exposure, noise, blur, rows go wrong")
    parser.add_argument("--sparsification", action="store_true", help="how well the confidence predicts the error")
    parser.add_argument("--opencv", action="store_true", help="also OpenCV's matchers, padded, and filled")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="write disparity, error and reasons as PNG here")
    parser.add_argument(
        "--disparities", type=whole(1), metavar="N", help="disparities to search (default: as the set says)"
    )
    parser.add_argument("--threads", type=whole(1), metavar="N", help="threads of the matcher (default: all cores)")
    setting = parser.add_argument_group("what to evaluate (default: the built-in list)")
    setting.add_argument("--preset", nargs="+", choices=PRESETS, help="presets, each a setting")
    setting.add_argument(
        "--method", nargs="+", metavar="NAME", help=f"methods with their defaults, each a setting: {', '.join(METHODS)}"
    )
    setting.add_argument(
        "--param", nargs="+", type=parameter, default=[], metavar="NAME=VALUE", help="parameters of each of these"
    )
    output = parser.add_mutually_exclusive_group()
    output.add_argument("--json", action="store_true", help="print one JSON object")
    output.add_argument("--csv", action="store_true", help="print a line per setting, scene and region")
    evaluate_obstacles.add_arguments(parser)
    parser.set_defaults(usage_error=parser.error)


def run(args: argparse.Namespace) -> None:
    if args.obstacles:
        (evaluate_obstacles if args.root is None else evaluate_scenes).run(args)
        return
    if args.root is None:
        args.usage_error("name a FOLDER of scenes, or ask for --obstacles")
    if args.truth:
        _score_file(args)
        return
    settings = _settings(args)
    scenes = _scenes(args)
    if args.robustness:
        _robustness(args, scenes, settings)
        return
    if args.sparsification:
        _sparsification(args, scenes, settings)
        return
    results = _score_scenes(args, scenes, settings)
    if args.json:
        print_json({"scenes": [_record(r) for r in results], "means": _means_as_records(results)})
    elif args.csv:
        say(_as_csv(results).rstrip())
    else:
        _print_means(args, results, [scene.name for scene in scenes])


def _score_file(args: argparse.Namespace) -> None:
    from epiline.evaluation import evaluate
    from epiline.evaluation.readers import read_disparity

    values, truth = read_disparity(args.root, scale=args.scale), read_disparity(args.truth, scale=args.truth_scale)
    if values.shape != truth.shape:
        sizes = [f"{path}: {v.shape[1]}x{v.shape[0]} px" for path, v in ((args.root, values), (args.truth, truth))]
        raise ValueError(", but ".join(sizes))
    scores = dataclasses.asdict(evaluate(values, truth))
    if args.json:
        print_json(scores)
    else:
        print_table(str(args.root), tuple(scores), [tuple(scores.values())])


def _settings(args: argparse.Namespace) -> list[Method]:
    from epiline.evaluation.peers import PEERS
    from epiline.evaluation.settings import BUILT_IN, Setting

    given = dict(args.param)
    chosen: list[dict[str, Any]] = [{"preset": preset, **given} for preset in args.preset or ()]
    chosen += [{"method": method, **given} for method in args.method or ()]
    if given and not chosen:
        chosen.append(given)
    for parameters in chosen:
        # A wrong name or value should be said before any image is read.
        try:
            StereoMatcher(**parameters)
        except TypeError as error:
            given_text = ", ".join(f"{name}={value}" for name, value in parameters.items())
            raise ValueError(f"{given_text}: {error}") from error
    own: list[Method] = [Setting(", ".join(f"{k} {v}" for k, v in p.items()), p) for p in chosen]
    return [*(own or BUILT_IN), *(PEERS if args.opencv else ())]


def _scenes(args: argparse.Namespace) -> list[Scene]:
    from epiline.evaluation import load_scenes

    scenes = list(load_scenes(args.root))
    wanted = args.scenes or [""]
    if args.robustness and not args.scenes and any(s.name.startswith(_ROBUSTNESS_SCENES) for s in scenes):
        scenes = [scene for scene in scenes if scene.name.startswith(_ROBUSTNESS_SCENES)]
    scenes = [scene for scene in scenes if any(text in scene.name for text in wanted)]
    if not scenes:
        raise ValueError(f"{args.root}: no scene's name contains {' or '.join(wanted)}")
    if args.disparities:
        scenes = [dataclasses.replace(scene, num_disparities=args.disparities) for scene in scenes]
    return scenes


def _score_scenes(args: argparse.Namespace, scenes: Sequence[Scene], settings: Sequence[Method]) -> list[Result]:
    from epiline.evaluation.measures import score

    if args.pictures:
        args.pictures.mkdir(parents=True, exist_ok=True)
    results = []
    with progress("matching", len(scenes) * len(settings)) as advance:
        for scene in scenes:
            for setting in settings:
                values = setting(scene.left, scene.right, scene.num_disparities, args.threads)
                for region, measures in score(values, scene).items():
                    results.append(Result(setting.name, scene.name, region, measures))
                if args.pictures:
                    from epiline.cli.pictures import write_evaluation_pictures

                    write_evaluation_pictures(args.pictures, setting, scene, values, args.threads)
                advance()
    return results


def _robustness(args: argparse.Namespace, scenes: Sequence[Scene], settings: Sequence[Method]) -> None:
    """Both sides answer every pixel, for a pixel left out cannot be wrong."""
    from epiline.evaluation.peers import SGBM_FILLED
    from epiline.evaluation.robustness import bad1_by_perturbation
    from epiline.evaluation.settings import Setting

    own = [Setting(f"{s.name}, filled", {**s.parameters, "fill": True}) for s in settings if isinstance(s, Setting)]
    if not (args.preset or args.method or args.param):
        own = [Setting("preset balanced, filled", {"preset": "balanced", "fill": True})]
    with progress("matching", None) as advance:
        table = bad1_by_perturbation(scenes, [*own, SGBM_FILLED], args.threads, advance)
    rows = []
    for name, figures in table.items():
        *mine, peer = figures
        rows.append((name, *mine, peer, *(value / peer if peer else float("nan") for value in mine)))
    columns = ("", *(s.name for s in own), SGBM_FILLED.name, *(f"ratio: {s.name}" for s in own))
    if args.json:
        print_json({"scenes": [s.name for s in scenes], "columns": columns[1:], "bad1": {r[0]: r[1:] for r in rows}})
    elif args.csv:
        say(table_as_csv(columns, rows).rstrip())
    else:
        print_table(f"bad1 %, non-occluded pixels, every one answered; mean over {len(scenes)} scenes", columns, rows)


def _sparsification(args: argparse.Namespace, scenes: Sequence[Scene], settings: Sequence[Method]) -> None:
    """Areas under the sparsification curve and the oracle's, non-occluded pixels, px."""
    from epiline.evaluation.settings import Setting
    from epiline.evaluation.sparsification import sparsification

    rows: list[tuple[str, str, float, float, float]] = []
    own = [setting for setting in settings if isinstance(setting, Setting)]
    with progress("matching", len(scenes) * len(own)) as advance:
        for setting in own:
            for scene in scenes:
                disparity = setting.map(scene.left, scene.right, scene.num_disparities, args.threads)
                curve = sparsification(disparity, None, scene.truth, scene.non_occluded)
                rows.append((setting.name, scene.name, curve.area, curve.oracle_area, curve.ratio))
                advance()
    for setting in own:
        mine = [row for row in rows if row[0] == setting.name]
        for group, holds in _groups(scene.name for scene in scenes).items():
            members = [row[2:] for row in mine if holds(row[1])]
            area, oracle, ratio = (float(np.nanmean(column)) for column in zip(*members, strict=True))
            rows.append((setting.name, group, area, oracle, ratio))
    columns = ("setting", "scene", "area", "oracle_area", "ratio")
    if args.json:
        print_json({"curves": [dict(zip(columns, row, strict=True)) for row in rows]})
    elif args.csv:
        say(table_as_csv(columns, rows).rstrip())
    else:
        means = set(_groups(scene.name for scene in scenes))
        shown = [row for row in rows if args.per_scene or row[1] in means]
        print_table("mean error against the share kept, most trusted first: areas, px", columns, shown)


def _record(result: Result) -> dict[str, Any]:
    figures = {name: measure.value for name, measure in result.measures.items()}
    return {"setting": result.setting, "scene": result.scene, "region": result.region, **figures}


def _groups(names: Iterable[str]) -> dict[str, Callable[[str], bool]]:
    """Which scenes are averaged together: all, then every other one by name."""
    ordered = sorted(set(names))
    even, odd = set(ordered[::2]), set(ordered[1::2])
    groups: dict[str, Callable[[str], bool]] = {f"all {len(ordered)} scenes": lambda _: True}
    if odd:
        groups |= {"even half": even.__contains__, "odd half": odd.__contains__}
    return groups


def _means_as_records(results: Sequence[Result]) -> list[dict[str, Any]]:
    from epiline.evaluation.measures import mean

    records = []
    for setting, region in dict.fromkeys((r.setting, r.region) for r in results):
        for group, holds in _groups(r.scene for r in results).items():
            members = [r.measures for r in results if (r.setting, r.region) == (setting, region) and holds(r.scene)]
            records.append({"setting": setting, "region": region, "group": group, **mean(members)})
    return records


def _as_csv(results: Sequence[Result]) -> str:
    names = list(dict.fromkeys(name for r in results for name in r.measures))
    rows = [
        (r.setting, r.scene, r.region, *(r.measures[n].value if n in r.measures else "" for n in names))
        for r in results
    ]
    return table_as_csv(("setting", "scene", "region", *names), rows)


def _print_means(args: argparse.Namespace, results: Sequence[Result], scenes: Sequence[str]) -> None:
    from epiline.evaluation.measures import mean

    say("total counts a pixel without an answer as wrong, matched leaves it out; means over scenes")
    halves = _groups(scenes)
    for setting in dict.fromkeys(r.setting for r in results):
        own = [r for r in results if r.setting == setting]
        rows: list[tuple[str, dict[str, float]]] = []
        for region in dict.fromkeys(r.region for r in own):
            inside = [r for r in own if r.region == region]
            names = list(dict.fromkeys(r.scene if args.per_scene else r.scene.split("/")[0] for r in inside))
            groups = [(n, [r for r in inside if r.scene == n or r.scene.startswith(f"{n}/")]) for n in names]
            for group, holds in halves.items() if args.halves else [next(iter(halves.items()))]:
                groups.append((group, [r for r in inside if holds(r.scene)]))
            rows += [(f"{group}, {region}", mean(r.measures for r in members)) for group, members in groups]
        present = dict.fromkeys(name for _, figures in rows for name in figures)
        columns = [name for name in _COMMON if name in present] or list(present)
        columns += [name for name in present if name not in columns and not _is_common(name)]
        table = [(label, *(figures.get(name, float("nan")) for name in columns)) for label, figures in rows]
        print_table(setting, ("", *(column.replace("_", " ") for column in columns)), table)


def _is_common(name: str) -> bool:
    from epiline.evaluation import Evaluation

    return name in {field.name for field in dataclasses.fields(Evaluation)}
