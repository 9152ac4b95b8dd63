"""`epiline bench`: how much faster than OpenCV, in one run, with the answers compared."""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from epiline._core import Error
from epiline._files import write_atomically
from epiline.cli.arguments import whole
from epiline.cli.console import note, print_json, print_table, progress, say

if TYPE_CHECKING:
    from epiline.benchmarking import Curve, Plan, Row, Stage

_QUICK_REPEATS, _QUICK_BUDGET_S = 5, 0.7


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--quick", action="store_true", help="two sizes at the best level, in less than a minute")
    only = parser.add_mutually_exclusive_group()
    only.add_argument("--curves", action="store_true", help="scaling curves instead of the tables")
    only.add_argument(
        "--pipeline", action="store_true", help="the whole pipeline against OpenCV's chain instead of the tables"
    )
    parser.add_argument("--levels", nargs="+", metavar="LEVEL", help="scalar, avx2, avx512, neon (default: all here)")
    parser.add_argument("--threads", nargs="+", type=whole(1), metavar="N", help="thread counts (default: 1 2)")
    parser.add_argument("--sizes", nargs="+", type=_size, metavar="WxHxD", help="sizes and disparities, px")
    parser.add_argument("--repeats", type=whole(3), metavar="N", help="most repetitions per row (default 21)")
    parser.add_argument(
        "--data", type=Path, metavar="FOLDER", help="scenes to match (default: EPILINE_DATA, else a rendered scene)"
    )
    parser.add_argument("--csv", type=Path, metavar="FILE", help="also write the rows here")
    parser.add_argument("--record", action="store_true", help="also write benchmarks/record/<cpu>/<date>.csv here")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _size(text: str) -> tuple[int, int, int]:
    parts = text.split("x")
    if len(parts) != 3 or not all(part.isdigit() and int(part) > 0 for part in parts):
        raise argparse.ArgumentTypeError(f"'{text}' is not WIDTHxHEIGHTxDISPARITIES")
    width, height, disparities = map(int, parts)
    if disparities % 16:
        raise argparse.ArgumentTypeError(f"'{text}': OpenCV needs disparities that are a multiple of 16")
    if disparities > width:
        raise argparse.ArgumentTypeError(f"'{text}': {disparities} disparities do not fit into {width} columns")
    return width, height, disparities


def run(args: argparse.Namespace) -> None:
    if importlib.util.find_spec("cv2") is None:
        raise Error("OpenCV, the peer, is not installed: pip install opencv-python-headless")
    from epiline.benchmarking import levels_here, machine_line, measure_level, record_path, rows_as_csv
    from epiline.benchmarking.pairs import pair_from

    plan, data = _plan(args), _data(args)
    # Before anything is measured: a folder that cannot be read should not be found out at the end.
    pair = pair_from(data)
    levels = _levels(args, levels_here())
    scene = "rendered workshop, before rectification" if args.pipeline else pair.name
    head = machine_line(scene, (1,) if args.curves else plan.threads)
    results: list[Row | Curve | Stage] = []
    with progress("measuring", None) as advance:
        for level in levels:
            for result in measure_level(level, plan, data):
                results.append(result)
                advance()
    if args.json:
        print_json({"machine": head, "results": [dataclasses.asdict(result) for result in results]})
    else:
        say(head)
        _print(results)
    targets = [args.csv] if args.csv else []
    if args.record:
        target = record_path(Path.cwd(), "-pipeline" if args.pipeline else "")
        target.parent.mkdir(parents=True, exist_ok=True)
        targets.append(target)
    for target in targets:
        write_atomically(target, rows_as_csv(head, results).encode())
        note(f"wrote {target}")
    _require_equal(results)


def _plan(args: argparse.Namespace) -> Plan:
    from epiline.benchmarking import Plan
    from epiline.benchmarking.contests import QUICK_SIZES
    from epiline.benchmarking.pipeline import SIZES as PIPELINE_SIZES

    plan = Plan(tables=not (args.curves or args.pipeline), curves=args.curves, pipeline=args.pipeline)
    if args.pipeline:
        plan = dataclasses.replace(plan, sizes=PIPELINE_SIZES, threads=(1,))
    if args.quick:
        plan = dataclasses.replace(plan, sizes=QUICK_SIZES, repeats=_QUICK_REPEATS, budget_s=_QUICK_BUDGET_S)
    given: dict[str, Any] = {"sizes": args.sizes, "threads": args.threads, "repeats": args.repeats}
    chosen: dict[str, Any] = {
        name: tuple(value) if isinstance(value, list) else value for name, value in given.items() if value
    }
    return dataclasses.replace(plan, **chosen)


def _data(args: argparse.Namespace) -> Path | None:
    if args.data:
        return Path(args.data)
    folder = os.environ.get("EPILINE_DATA")
    return Path(folder) if folder else None


def _levels(args: argparse.Namespace, here: Sequence[str]) -> list[str]:
    wanted = args.levels or (here[-1:] if args.quick else here)
    for level in wanted:
        if level not in here:
            raise ValueError(f"level {level}: this processor has {', '.join(here)}")
    return list(wanted)


def _print(results: Sequence[Row | Curve | Stage]) -> None:
    from epiline.benchmarking import Curve, Row, Stage

    rows = [result for result in results if isinstance(result, Row)]
    for level, threads in dict.fromkeys((row.level, row.threads) for row in rows):
        print_table(
            f"{level}, {threads} thread{'s' if threads > 1 else ''} each: times faster (quartiles)",
            ("ours", "against", "tests", "size", "times faster", "ours ms", "theirs ms", "answers", "density %"),
            [_line(row) for row in rows if (row.level, row.threads) == (level, threads)],
        )
    _print_stages([result for result in results if isinstance(result, Stage)])
    points = [result for result in results if isinstance(result, Curve)]
    for level, ours, along in dict.fromkeys((point.level, point.ours, point.along) for point in points):
        members = [p for p in points if (p.level, p.ours, p.along) == (level, ours, along)]
        print_table(
            f"{level}, {ours}, one thread: cost of a pixel and disparity against {along}",
            (along, "relative cost", f"times faster than {members[0].theirs}"),
            [(p.at, p.per_pixel_disparity, p.ratio) for p in members],
        )


def _print_stages(stages: Sequence[Stage]) -> None:
    for level in dict.fromkeys(stage.level for stage in stages):
        own = [stage for stage in stages if stage.level == level]
        names = tuple(dict.fromkeys(stage.stage for stage in own))
        sizes = dict.fromkeys((stage.width, stage.height, stage.disparities) for stage in own)
        print_table(
            f"{level}, one thread: our pipeline's stages, ms",
            ("size", *names),
            [
                ("x".join(map(str, size)), *(s.ms for s in own if (s.width, s.height, s.disparities) == size))
                for size in sizes
            ],
        )


def _line(row: Row) -> tuple[object, ...]:
    return (
        row.ours,
        row.theirs,
        "on" if row.tests else "off",
        f"{row.width}x{row.height}" + (f"x{row.disparities}" if row.disparities else ""),
        f"{row.ratio:.2f} ({row.ratio_low:.2f}-{row.ratio_high:.2f})",
        row.ours_ms,
        row.theirs_ms,
        f"{100 * row.checked:.2f} % {row.check}",
        f"{100 * row.ours_density:.1f} / {100 * row.theirs_density:.1f}",
    )


def _require_equal(results: Sequence[Row | Curve | Stage]) -> None:
    from epiline.benchmarking import Row

    broken = [row for row in results if isinstance(row, Row) and row.differs]
    if broken:
        worst = min(broken, key=lambda row: row.checked)
        raise Error(
            f"{len(broken)} rows differ from the answer they must equal; worst: {worst.ours} against {worst.theirs} "
            f"at level {worst.level}, {worst.width}x{worst.height}x{worst.disparities}: {100 * worst.checked:.3f} %"
        )
