"""Options that several verbs share, and what they make of them."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from epiline._core import (
    RectifiedGeometry,
    StereoCalibration,
    StereoMatcher,
    default_disparities,
)

PRESETS = ("fast", "balanced", "accurate")
METHODS = ("sad", "sad5", "census", "bt", "sgm")


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


def parameter(text: str) -> tuple[str, Any]:
    """An argparse type: ``name=value`` of a matcher's parameter; the value a number, true, false, none or a word."""
    name, equals, value = text.partition("=")
    if not equals or not name or not value:
        raise argparse.ArgumentTypeError(f"'{text}' is not NAME=VALUE")
    words = {"true": True, "false": False, "none": None}
    # The prefilter that is none is a word of its own.
    if value.lower() in words and name != "prefilter":
        return name, words[value.lower()]
    try:
        return name, int(value)
    except ValueError:
        return name, value


def add_matcher_arguments(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("matching")
    how = group.add_mutually_exclusive_group()
    how.add_argument(
        "--preset",
        choices=PRESETS,
        help="block matching, or semi-global over three or four paths, each with all tests (default fast; of run: "
        "fast with a larger window and fewer costs from half the resolution)",
    )
    how.add_argument("--method", choices=METHODS, help="instead of a preset: a method with its defaults, without tests")
    group.add_argument(
        "--disparities",
        type=whole(1),
        metavar="N",
        help="disparities to search, px (default: a sixth of the width)",
    )
    group.add_argument(
        "--min-disparity", type=whole(0), default=0, metavar="N", help="smallest disparity searched, px (default 0)"
    )
    group.add_argument("--window", type=whole(1), metavar="N", help="side of the window, odd, px")
    group.add_argument("--prefilter", choices=("xsobel", "none"), help="before comparing")
    group.add_argument(
        "--subpixel", choices=("v", "parabola", "off"), help="the fit that refines beyond whole pixels (default v)"
    )
    group.add_argument("--fill", action="store_true", help="answer every pixel: rejected ones take the background's")
    group.add_argument(
        "--no-tests", action="store_true", help="keep every pixel: no uniqueness, texture, left-right, speckle test"
    )
    group.add_argument("--threads", type=whole(1), metavar="N", help="threads (default: all cores)")


_NO_TESTS: dict[str, Any] = {
    "uniqueness_ratio": 0,
    "texture_threshold": 0,
    "left_right_max_diff": None,
    "speckle_size": 0,
}


def matcher_from(
    args: argparse.Namespace, width: int, *, default: Mapping[str, Any] = MappingProxyType({"preset": "fast"})
) -> StereoMatcher:
    """The matcher that the options describe, for images of this width; by default with the parameters of `default`."""
    subpixel = False if args.subpixel == "off" else args.subpixel
    given = {"block_size": args.window, "prefilter": args.prefilter, "subpixel": subpixel}
    asked = {"method": args.method, "preset": args.preset}
    options: dict[str, Any] = {
        **({name: value for name, value in asked.items() if value} or default),
        "num_disparities": args.disparities or default_disparities(width),
        "min_disparity": args.min_disparity,
        "threads": args.threads,
        "fill": args.fill,
        **{name: value for name, value in given.items() if value is not None},
        **(_NO_TESTS if args.no_tests else {}),
    }
    return StereoMatcher(**options)


def load_rig(path: Path) -> StereoCalibration | RectifiedGeometry:
    """A rig file of any format; of one that describes aligned pictures (KITTI's, Middlebury's) their geometry."""
    rig = StereoCalibration.load(path)
    if not StereoCalibration.describes_aligned_pictures(path):
        return rig
    left, right = rig.left.camera_matrix, rig.right.camera_matrix
    width, height = rig.image_size
    return RectifiedGeometry(
        width=width,
        height=height,
        focal_px=left[0, 0],
        cx_px=left[0, 2],
        cy_px=left[1, 2],
        baseline_m=rig.baseline_m,
        doffs_px=right[0, 2] - left[0, 2],
    )
