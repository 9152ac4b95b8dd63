"""`epiline align`: pairs in, aligned pairs out, without a calibration, and whether each can be trusted."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

from epiline._align import align
from epiline._core import PairAlignment, StereoCalibration
from epiline.cli.arguments import load_rig
from epiline.cli.console import print_json, print_table, progress, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source", nargs="+", metavar="SOURCE", help="LEFT RIGHT, a folder of pairs, two folders or videos"
    )
    parser.add_argument("--lens", type=Path, metavar="RIG", help="rig file whose lenses (not whose pose) are used")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FOLDER", help="write NAME_left.png, NAME_right.png and their masks"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from epiline.sources import open_source

    lens = None
    if args.lens:
        rig = load_rig(args.lens)
        if not isinstance(rig, StereoCalibration):
            raise ValueError(f"{args.lens}: describes pairs that are already aligned; it has no lenses")
        lens = (rig.left, rig.right)
    found: list[dict[str, Any]] = []
    with open_source(args.source) as source, progress("aligning", source.length) as advance:
        for frame in source:
            aligned = align(frame.left, frame.right, lens)
            found.append(_summary(frame.name, aligned))
            if args.output:
                _write(args.output, frame.name, aligned)
            advance()
    if args.json:
        print_json({"pairs": found})
        return
    rows = [
        (p["name"], f"{p['epipolar_error_px']:.3f}", f"{p['sigma_px']:.3f}", p["matches"], p["reason"] or "trusted")
        for p in found
    ]
    print_table("held-out vertical error, px", ("pair", "error", "sigma", "matches", "verdict"), rows)
    if args.output:
        say(f"wrote {len(found)} pairs and their masks to {args.output}")


def _summary(name: str, aligned: PairAlignment) -> dict[str, Any]:
    return {
        "name": name,
        "trusted": aligned.trusted,
        "reason": aligned.reason,
        "epipolar_error_px": aligned.epipolar_error_px,
        "sigma_px": aligned.sigma_px,
        "matches": aligned.matches,
        "homographies": [h.tolist() for h in aligned.homographies],
        "lenses": None
        if aligned.lens is None
        else [{"camera_matrix": c.camera_matrix.tolist(), "distortion": c.distortion.tolist()} for c in aligned.lens],
    }


def _write(folder: Path, name: str, aligned: PairAlignment) -> None:
    from epiline.sinks.pictures import write_picture

    folder.mkdir(parents=True, exist_ok=True)
    for side, image, valid in (
        ("left", aligned.left, aligned.left_valid),
        ("right", aligned.right, aligned.right_valid),
    ):
        write_picture(folder / f"{name}_{side}.png", image)
        write_picture(folder / f"{name}_{side}_valid.png", valid.astype(np.uint8) * 255)
