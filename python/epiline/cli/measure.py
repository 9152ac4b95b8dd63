"""`epiline measure`: pairs of disparity and distance for the range curve, one after the other from a source."""

from __future__ import annotations

import argparse
import csv
import io
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from epiline._core import (
    RectifiedGeometry,
    Rectifier,
    Region,
    StereoCalibration,
    StereoMatcher,
    profile,
)
from epiline.cli.arguments import add_matcher_arguments, load_rig, matcher_from, whole
from epiline.cli.console import note, print_json, say

if TYPE_CHECKING:
    from epiline.sources import Frame

_HEADER = ("disparity_px", "distance_m", "spread_px", "pixels", "frame")
_MIN_PIXELS = 30


@dataclass(frozen=True)
class _Reading:
    """What a region shows: the disparity of its nearest surface, and how much the region scatters."""

    disparity_px: float
    spread_px: float
    pixels: int


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", nargs="+", metavar="SOURCE", help="pairs, as for epiline run")
    parser.add_argument("--rig", type=Path, help="align by this rig first; without it the pairs must be aligned")
    parser.add_argument(
        "--region",
        required=True,
        metavar="X,Y,WxH | NAME",
        help="the box of pixels on the target, or the name of a region of --regions",
    )
    parser.add_argument("--regions", type=Path, metavar="TOML", help="file with sets of regions")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CSV", help="table for epiline fit-range")
    parser.add_argument("--append", action="store_true", help="add to the table instead of writing it anew")
    parser.add_argument("--every", type=whole(1), default=1, metavar="N", help="ask at every Nth pair only")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_matcher_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from epiline._files import write_atomically
    from epiline.sources import open_source

    rows = _read_rows(args.output) if args.append and args.output.exists() else []
    before = len(rows)
    if not args.output.resolve().parent.is_dir():
        raise FileNotFoundError(2, "the folder of the table does not exist", str(args.output.parent))
    answers = _answers()
    with open_source(args.source) as source:
        reader = _Reader(args, source.size)
        note(f"type the distance to what region '{reader.region.name}' shows, in metres; nothing to skip, q to end")
        for count, frame in enumerate(source):
            if count % args.every:
                continue
            reading = reader.read(frame)
            if reading is None:
                note(f"{frame.name}: fewer than {_MIN_PIXELS} pixels with a disparity in the region, skipped")
                continue
            figures = f"{reading.disparity_px:.3f} px, spread {reading.spread_px:.3f} px, {reading.pixels} pixels"
            distance_m = _ask(f"{frame.name}: {figures}; distance in m: ", answers)
            if distance_m is None:
                break
            if not math.isnan(distance_m):
                rows.append(
                    (f"{reading.disparity_px:.4f}", f"{distance_m:g}", f"{reading.spread_px:.4f}",
                     str(reading.pixels), frame.name)
                )  # fmt: skip
    if len(rows) == before:
        raise ValueError("no distance was given: nothing to write")
    table = io.StringIO()
    csv.writer(table, lineterminator="\n").writerows([_HEADER, *rows])
    write_atomically(args.output, table.getvalue().encode())
    if args.json:
        print_json({"output": str(args.output), "pairs": len(rows), "new": len(rows) - before})
    else:
        say(f"wrote {args.output}: {len(rows)} pairs, {len(rows) - before} of them new")


class _Reader:
    """Matches nothing but the region, and reads it."""

    def __init__(self, args: argparse.Namespace, size: tuple[int, int]) -> None:
        rig = load_rig(args.rig) if args.rig else None
        self._rectifier = Rectifier(rig) if isinstance(rig, StereoCalibration) else None
        self._geometry: RectifiedGeometry | None
        self._geometry = self._rectifier.geometry if self._rectifier else rig  # type: ignore[assignment]
        if self._geometry is not None:
            size = (self._geometry.width, self._geometry.height)
        self.region = _region(args, size, self._geometry)
        self._matcher: StereoMatcher = matcher_from(args, size[0])

    def read(self, frame: Frame) -> _Reading | None:
        """The region of a pair; None where too little of it has an answer."""
        given: dict[str, Any] = {"regions": [self.region], "geometry": self._geometry}
        if self._rectifier is None:
            disparity = self._matcher(frame.left, frame.right, **given)
        else:
            pair = self._rectifier(frame.left, frame.right)
            disparity = self._matcher(
                pair.left, pair.right, left_valid=pair.left_valid, right_valid=pair.right_valid, **given
            )
        found = profile(disparity, [self.region], geometry=self._geometry)[0]
        box = self.region
        values = disparity.values[box.y : box.y + box.height, box.x : box.x + box.width]
        known = values[np.isfinite(values)]
        if known.size < _MIN_PIXELS or math.isnan(found.nearest_disparity_px):
            return None
        spread_px = 1.4826 * float(np.median(np.abs(known - np.median(known))))
        return _Reading(found.nearest_disparity_px, spread_px, int(found.support))


def _region(args: argparse.Namespace, size: tuple[int, int], geometry: RectifiedGeometry | None) -> Region:
    if args.regions is not None:
        from epiline._regions import read_region_sets

        placed = [
            region
            for regions in read_region_sets(args.regions).values()
            for region in regions.place(image_size=size, geometry=geometry)
        ]
        for region in placed:
            if region.name == args.region:
                return region
        raise ValueError(f"{args.regions}: no region '{args.region}'; there are {', '.join(r.name for r in placed)}")
    try:
        corner_x, corner_y, sides = args.region.split(",")
        width, height = sides.lower().split("x")
        return Region("target", x=int(corner_x), y=int(corner_y), width=int(width), height=int(height))
    except ValueError as error:
        raise ValueError(f"--region {args.region}: expected X,Y,WIDTHxHEIGHT in pixels, like 140,100,40x30") from error


def _answers() -> Iterator[str]:
    """Lines of standard input: typed, or piped."""
    for line in sys.stdin:
        yield line.strip()


def _ask(question: str, answers: Iterator[str]) -> float | None:
    """A distance, metres; NaN to skip, None at the end. Someone at a terminal is asked again after a slip."""
    while True:
        if sys.stdin.isatty():
            sys.stderr.write(question)
            sys.stderr.flush()
        answer = next(answers, "q")
        if answer.lower() in ("q", "quit"):
            return None
        if not answer:
            return math.nan
        try:
            distance_m = float(answer.removesuffix("m"))
        except ValueError:
            distance_m = math.nan
        if 0 < distance_m < math.inf:
            return distance_m
        complaint = f"'{answer}' is not a distance in metres"
        if not sys.stdin.isatty():
            raise ValueError(complaint)
        note(complaint)


def _read_rows(path: Path) -> list[tuple[str, ...]]:
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = [tuple(row) for row in csv.reader(file) if row]
    if not rows or rows[0] != _HEADER:
        raise ValueError(f"{path}: is no table of epiline measure; its first line must be {','.join(_HEADER)}")
    return rows[1:]
