"""`epiline rectify`: pairs in, aligned pairs out, with the epipolar error before and after."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from epiline._core import Rectifier, StereoCalibration, alignment_error
from epiline.cli.arguments import load_rig
from epiline.cli.console import print_json, print_table, progress, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source", nargs="+", metavar="SOURCE", help="LEFT RIGHT, a folder of pairs, two folders or videos"
    )
    parser.add_argument("--rig", type=Path, required=True, help="rig file of `epiline calibrate`")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FOLDER", help="write NAME_left.png, NAME_right.png and their masks"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from epiline.sinks.pictures import write_picture
    from epiline.sources import open_source

    rig = load_rig(args.rig)
    if not isinstance(rig, StereoCalibration):
        raise ValueError(f"{args.rig}: describes pairs that are already aligned; there is nothing to rectify")
    rectifier = Rectifier(rig)
    rows: list[tuple[str, float, float, float, int]] = []
    with open_source(args.source) as source, progress("aligning", source.length) as advance:
        for frame in source:
            before = alignment_error(frame.left, frame.right)
            pair = rectifier(frame.left, frame.right)
            after = alignment_error(pair.left, pair.right, left_valid=pair.left_valid, right_valid=pair.right_valid)
            rows.append((frame.name, before.median_px, after.median_px, after.spread_px, after.matches))
            if args.output:
                args.output.mkdir(parents=True, exist_ok=True)
                for side, image, valid in (
                    ("left", pair.left, pair.left_valid),
                    ("right", pair.right, pair.right_valid),
                ):
                    write_picture(args.output / f"{frame.name}_{side}.png", image)
                    write_picture(args.output / f"{frame.name}_{side}_valid.png", valid.astype(np.uint8) * 255)
            advance()
    if args.json:
        names = ("name", "before_px", "after_px", "spread_px", "matches")
        print_json({"pairs": [dict(zip(names, row, strict=True)) for row in rows]})
        return
    title = "median vertical residual, px"
    cells = [(n, f"{b:.3f}", f"{a:.3f}", f"{s:.3f}", m) for n, b, a, s, m in rows]
    print_table(title, ("pair", "before", "after", "spread after", "matches"), cells)
    if args.output:
        say(f"wrote {len(rows)} pairs and their masks to {args.output}")
