"""`epiline match`: one pair to disparity, as picture, array or point cloud."""

from __future__ import annotations

import argparse
from pathlib import Path

from epiline._core import RectifiedGeometry, Rectifier, StereoCalibration, to_range
from epiline.cli.arguments import add_matcher_arguments, load_rig, matcher_from
from epiline.cli.console import print_json, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("left", type=Path, metavar="LEFT", help="left image")
    parser.add_argument("right", type=Path, metavar="RIGHT", help="right image")
    parser.add_argument("--rig", type=Path, help="align by this rig first; without it the pair must be aligned")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="out.pfm, .png (16 bit), .npy; .ply needs --rig"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_matcher_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from epiline._images import read_image
    from epiline.sinks.disparity import DISPARITY_SUFFIXES, write_disparity
    from epiline.sinks.ply import write_ply

    suffix = args.output.suffix.lower()
    if suffix not in (*DISPARITY_SUFFIXES, ".ply"):
        raise ValueError(f"{args.output}: expected one of {' '.join((*DISPARITY_SUFFIXES, '.ply'))}")
    left, right = read_image(args.left), read_image(args.right)
    matcher = matcher_from(args, left.shape[1])
    rig = load_rig(args.rig) if args.rig else None
    geometry: RectifiedGeometry | None
    if isinstance(rig, StereoCalibration):
        pair = Rectifier(rig)(left, right)
        left, geometry = pair.left, pair.geometry
        disparity = matcher(pair.left, pair.right, left_valid=pair.left_valid, right_valid=pair.right_valid)
    else:
        disparity, geometry = matcher(left, right), rig
    if suffix == ".ply":
        if geometry is None:
            raise ValueError(f"{args.output}: a point cloud in metres needs --rig")
        write_ply(args.output, to_range(disparity, geometry).points(left))
    else:
        write_disparity(args.output, disparity.values)
    figures = {"output": str(args.output), "density": disparity.density, "parameters": matcher.parameters}
    if args.json:
        print_json(figures)
    else:
        say(f"wrote {args.output}: {100 * disparity.density:.1f} % of the pixels have a disparity")
