"""`epiline regions`: what regions of one pair show, as a table and as the graphs of the 2011 paper."""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from epiline._core import (
    RectifiedGeometry,
    Rectifier,
    Region,
    RegionProfile,
    StereoCalibration,
    paper_regions,
    profile,
)
from epiline.cli.arguments import add_matcher_arguments, load_rig, matcher_from, whole
from epiline.cli.console import print_json, print_table, say


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("left", type=Path, metavar="LEFT", help="left image")
    parser.add_argument("right", type=Path, metavar="RIGHT", help="right image")
    parser.add_argument("--rig", type=Path, help="align by this rig first; without it the pair must be aligned")
    parser.add_argument(
        "--regions",
        metavar="TOML[:SET]",
        help="file with sets of regions, and which of them (default: the 2011 paper's four bands)",
    )
    parser.add_argument("--min-support", type=whole(1), default=3, metavar="N", help="pixels a column's nearest needs")
    parser.add_argument("--profiles", type=Path, metavar="DIR", help="write value against column of each region there")
    parser.add_argument("--format", choices=("svg", "png"), default="svg", help="of these pictures (default svg)")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    add_matcher_arguments(parser)


def run(args: argparse.Namespace) -> None:
    from epiline._images import read_image

    left, right = read_image(args.left), read_image(args.right)
    rig = load_rig(args.rig) if args.rig else None
    geometry: RectifiedGeometry | None
    valid: dict[str, Any] = {}
    if isinstance(rig, StereoCalibration):
        pair = Rectifier(rig)(left, right)
        left, right, geometry = pair.left, pair.right, pair.geometry
        valid = {"left_valid": pair.left_valid, "right_valid": pair.right_valid}
    else:
        geometry = rig
    regions = _regions(args.regions, (left.shape[1], left.shape[0]), geometry)
    # Nothing else of the image is matched.
    disparity = matcher_from(args, left.shape[1])(left, right, regions=regions, geometry=geometry, **valid)
    profiles = profile(disparity, regions, geometry=geometry, min_support=args.min_support)
    written = _write_pictures(args.profiles, args.format, profiles) if args.profiles else []
    if args.json:
        print_json({"regions": [_figures(p) for p in profiles], "pictures": [str(path) for path in written]})
        return
    titles = ("region", "box", "nearest", "maximum px", "minimum px", "total px", "valid %")
    print_table("", titles, [_row(p) for p in profiles])
    if written:
        say(f"wrote {len(written)} pictures to {args.profiles}")


def _regions(given: str | None, size: tuple[int, int], geometry: RectifiedGeometry | None) -> list[Region]:
    if given is None:
        return paper_regions(*size)
    from epiline._regions import read_regions

    path, colon, name = given.rpartition(":")
    if not colon or Path(given).exists():
        path, name = given, ""
    return read_regions(path, name or None, image_size=size, geometry=geometry)


def _row(p: RegionProfile) -> tuple[object, ...]:
    box = f"{p.region.width}x{p.region.height} at {p.region.x},{p.region.y}"
    if p.support == 0:
        nearest = "-"
    elif p.range_m == p.range_m:
        nearest = f"{p.range_m:.3f} ± {p.sigma_m:.3f} m"
    else:
        nearest = f"{p.nearest_disparity_px:.2f} px"
    return (p.region.name, box, nearest, p.maximum, p.minimum, f"{p.total:.0f}", f"{100 * p.valid_share:.1f}")


def _figures(p: RegionProfile) -> dict[str, object]:
    box = p.region
    return {
        "name": box.name,
        "box": [box.x, box.y, box.width, box.height],
        "range_m": p.range_m,
        "sigma_m": p.sigma_m,
        "nearest_disparity_px": p.nearest_disparity_px,
        "nearest_at": p.nearest_at,
        "support": p.support,
        "maximum_px": p.maximum,
        "minimum_px": p.minimum,
        "total_px": p.total,
        "valid_share": p.valid_share,
        "histogram": p.histogram.tolist(),
        "columns": {
            "nearest_px": p.nearest_px.tolist(),
            "median_px": p.median_px.tolist(),
            "spread_px": p.spread_px.tolist(),
            "unknown_share": p.unknown_share.tolist(),
            "nearest_range_m": None if p.nearest_range_m is None else p.nearest_range_m.tolist(),
        },
    }


def _write_pictures(folder: Path, suffix: str, profiles: list[RegionProfile]) -> list[Path]:
    """`NAME.svg` of disparities and, with a rig, `NAME-range.svg`."""
    from epiline.report import write_profile

    if not folder.is_dir():
        raise FileNotFoundError(2, "the folder of the pictures does not exist", str(folder))
    written = []
    for number, p in enumerate(profiles, start=1):
        stem = re.sub(r"[^\w.-]+", "-", p.region.name) or f"region-{number}"
        write_profile(p, folder / f"{stem}.{suffix}")
        written.append(folder / f"{stem}.{suffix}")
        if p.nearest_range_m is not None:
            write_profile(p, folder / f"{stem}-range.{suffix}", quantity="range")
            written.append(folder / f"{stem}-range.{suffix}")
    return written
