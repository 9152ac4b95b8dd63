"""`epiline evaluate --obstacles`: the whole pipeline on rendered courses, or on photographs with ground truth."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from epiline.cli.console import print_json, print_table, progress, say
from epiline.cli.tables import table_as_csv

if TYPE_CHECKING:
    from epiline.evaluation.obstacles import Entry, Tally
    from epiline.sources.rendered.courses import Course

# Of the figures the tables show these; JSON and CSV have all.
_FOUND = {
    "frames": "frames",
    "asked": "asked",
    "recall": "recall %",
    "reports": "reports",
    "precision": "precision %",
    "ghosts": "ghosts",
    "doubles": "doubles",
    "free_frames": "free frames",
    "blocked_frames": "blocked",
}
_RANGES = {
    "ranges": "ranges",
    "bias": "bias %",
    "gross": "gross %",
    "within_1": "1 sigma %",
    "within_2": "2 sigma %",
}
_TRACKS = {f"track_{name}": title for name, title in (_FOUND | _RANGES).items()} | {"track_switches": "id switches"}
_FLOOR = {
    "ground_found": "ground found %",
    "height_bias": "height bias %",
    "height_p95": "95th",
    "pitch_bias": "pitch bias deg",
    "pitch_p95": "95th",
    "roll_bias": "roll bias deg",
    "roll_p95": "95th",
}
_FLOOR_SIGMAS = {
    f"{name}_within_{count}": f"{name} {count} sigma %" for name in ("height", "pitch", "roll") for count in (1, 2)
}
_SCAN = {
    "scan_missed": "missed %",
    "scan_misled": "misled %",
    "scan_false_near": "false near %",
    "scan_ghosts": "ghosts %",
    "scan_free": "free %",
    "scan_free_wrong": "wrongly free %",
    "scan_unknown": "unknown %",
}
_RANGES |= {f"region_{name}": "regions" if name == "ranges" else title for name, title in _RANGES.items()}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of obstacles, among those of `evaluate`."""
    group = parser.add_argument_group("obstacles")
    group.add_argument(
        "--obstacles",
        action="store_true",
        help="the whole pipeline: rendered courses with exact truth, or the scenes of FOLDER where one is given",
    )
    group.add_argument("--frames", type=int, metavar="N", help="at most N frames of each rendered course")
    group.add_argument("--cache", type=Path, metavar="DIR", help="keep the rendered photographs here for the next run")


def run(args: argparse.Namespace) -> None:
    """Scores every entry on every course."""
    if args.frames is not None and args.frames < 1:
        raise ValueError(f"--frames {args.frames}: at least 1")
    for entry in _entries(args):
        _score_courses(args, entry)


def _entries(args: argparse.Namespace) -> list[Entry]:
    from epiline.evaluation.obstacles import Entry

    given: dict[str, Any] = dict(args.param)
    if args.threads:
        given["threads"] = args.threads
    chosen = [{"preset": preset, **given} for preset in args.preset or ()]
    chosen += [{"method": method, **given} for method in args.method or ()]
    if not chosen:
        return [Entry("the pipeline's own settings", given or None)]
    return [Entry(", ".join(f"{name} {value}" for name, value in matcher.items()), matcher) for matcher in chosen]


def _score_courses(args: argparse.Namespace, entry: Entry) -> None:
    from epiline.evaluation.obstacles import evaluate_courses
    from epiline.sources.rendered.courses import courses

    wanted = args.scenes or [""]
    chosen = [course for course in courses(frames=args.frames) if any(text in course.name for text in wanted)]
    if not chosen:
        raise ValueError(f"no course's name contains {' or '.join(wanted)}")
    with progress("driving", sum(course.frames for course in chosen)) as advance:
        scored = list(evaluate_courses(chosen, entry, cache=args.cache, advance=advance))
    if args.json:
        print_json(
            {
                "entry": entry.name,
                "courses": [
                    {"course": course.name, **tally.figures(), "missed": dict(tally.missed_names())}
                    for course, tally in scored
                ],
                "totals": [{"group": group, **tally.figures()} for group, tally in _totals(scored)],
            }
        )
        return
    if args.csv:
        lines = [(entry.name, course.name, *tally.figures().values()) for course, tally in scored]
        names = scored[0][1].figures()
        say(table_as_csv(("setting", "course", *names), lines).rstrip())
        return
    rows = [(course.name, tally) for course, tally in scored] if args.per_scene else _kinds(scored)
    rows += _totals(scored)
    for title, columns in (
        (f"{entry.name}: obstacles up to 6 m on rendered courses", _FOUND),
        ("their ranges; the nearest ranges of regions", _RANGES),
        ("confirmed tracks, scored as obstacles are", _TRACKS),
        ("the ground", _FLOOR),
        ("how often it is within its sigmas", _FLOOR_SIGMAS),
        ("the scan over it", _SCAN),
    ):
        print_table(title, ("", *columns.values()), [(name, *_figures(tally, columns)) for name, tally in rows])


def _figures(tally: Tally, names: Iterable[str]) -> list[float]:
    figures = tally.figures()
    return [figures[name] for name in names]


def _kinds(scored: Sequence[tuple[Course, Tally]]) -> list[tuple[str, Tally]]:
    names = dict.fromkeys(f"{course.half}/{course.kind}" for course, _ in scored)
    return [(name, _sum(t for c, t in scored if f"{c.half}/{c.kind}" == name)) for name in names]


def _totals(scored: Sequence[tuple[Course, Tally]]) -> list[tuple[str, Tally]]:
    """Both halves, each size, and all."""
    groups = [(f"{half} half", _sum(t for c, t in scored if c.half == half)) for half in {c.half: 0 for c, _ in scored}]
    for size in {c.size: 0 for c, _ in scored}:
        groups.append((f"{size[0]}x{size[1]}", _sum(t for c, t in scored if c.size == size)))
    return [*groups, ("all", _sum(t for _, t in scored))]


def _sum(tallies: Iterable[Tally]) -> Tally:
    from epiline.evaluation.obstacles import Tally

    total = Tally()
    for tally in tallies:
        total = total + tally
    return total
