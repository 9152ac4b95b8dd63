"""Options that several verbs share, and what they make of them."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

from epiline._core import RectifiedGeometry, StereoCalibration, StereoMatcher, read_kitti_projection

# Chosen on the even-numbered of the 27 scenes that `epiline evaluate` prints, checked on the odd-numbered.
TESTED = {
    "block_size": 11,
    "prefilter_cap": 15,
    "uniqueness_ratio": 3,
    "texture_threshold": 10,
    "left_right_max_diff": 1,
    "speckle_size": 200,
    "speckle_range": 1,
}


def whole(minimum: int, maximum: int | None = None) -> Callable[[str], int]:
    """An argparse type: a whole number of at least `minimum`."""

    def parse(text: str) -> int:
        value = int(text)
        if value < minimum or (maximum is not None and value > maximum):
            span = f"at least {minimum}" if maximum is None else f"{minimum} to {maximum}"
            raise argparse.ArgumentTypeError(f"{value} is not {span}")
        return value

    parse.__name__ = "whole number"
    return parse


def positive(text: str) -> float:
    """An argparse type: a positive finite number."""
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a positive number")
    return value


def add_matcher_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("matching")
    group.add_argument(
        "--disparities", type=whole(1), metavar="N", help="disparities to search, px (default: a sixth of the width)"
    )
    group.add_argument(
        "--min-disparity", type=whole(0), default=0, metavar="N", help="smallest disparity searched, px (default 0)"
    )
    group.add_argument(
        "--window",
        type=whole(1),
        default=TESTED["block_size"],
        metavar="N",
        help="side of the window, odd, px (default %(default)s)",
    )
    group.add_argument(
        "--prefilter", choices=("xsobel", "none"), default="xsobel", help="before comparing (default %(default)s)"
    )
    group.add_argument(
        "--no-tests", action="store_true", help="keep every pixel: no uniqueness, texture, left-right, speckle test"
    )
    group.add_argument("--threads", type=whole(1), metavar="N", help="threads (default: all cores)")


def matcher_from(args: argparse.Namespace, width: int) -> StereoMatcher:
    """The matcher that the options describe, for images of this width."""
    tests: dict[str, Any] = {} if args.no_tests else {k: v for k, v in TESTED.items() if k != "block_size"}
    return StereoMatcher(
        num_disparities=args.disparities or default_disparities(width),
        min_disparity=args.min_disparity,
        block_size=args.window,
        prefilter=args.prefilter,
        threads=args.threads,
        **tests,
    )


def default_disparities(width: int) -> int:
    """A sixth of the image's width, rounded up to a multiple of 16: 112 at 640 px."""
    return max(16, -(-width // 96) * 16)


def load_rig(path: Path) -> StereoCalibration | RectifiedGeometry:
    """A rig file of ours, or the `calib.txt` of a sequence that is already aligned (KITTI, Karlsruhe)."""
    if path.suffix == ".txt":
        return RectifiedGeometry(**read_kitti_projection(path))
    return StereoCalibration.load(path)
