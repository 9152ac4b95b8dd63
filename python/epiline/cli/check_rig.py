"""`epiline check-rig`: does a rig still hold, told from ordinary pairs?"""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

import numpy as np

from epiline._core import AlignmentError, Drift, Rectifier, StereoCalibration, alignment_error, measure_drift
from epiline.cli.arguments import load_rig
from epiline.cli.console import print_json, print_table, progress, say

# Fewer matches than this over all pairs say nothing about slopes.
_MIN_MATCHES = 40
# Rows this far apart cost a block matcher pixels (what makers of stereo cameras reject units by).
_USABLE_PX = 0.6


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("rig", type=Path, metavar="RIG", help="rig file, or calib.txt of an aligned sequence")
    parser.add_argument(
        "source", nargs="+", metavar="SOURCE", help="LEFT RIGHT, a folder of pairs, two folders or videos"
    )
    parser.add_argument("--save", type=Path, metavar="RIG", help="write the rig corrected by the drift")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    from epiline.sources import open_source

    rig = load_rig(args.rig)
    calibration = rig if isinstance(rig, StereoCalibration) else None
    rectifier = Rectifier(rig) if isinstance(rig, StereoCalibration) else None
    residuals: list[AlignmentError] = []
    with open_source(args.source) as source, progress("checking", source.length) as advance:
        for frame in source:
            if rectifier is None:
                residuals.append(alignment_error(frame.left, frame.right))
            else:
                pair = rectifier(frame.left, frame.right)
                left_valid, right_valid = pair.left_valid, pair.right_valid
                residual = alignment_error(pair.left, pair.right, left_valid=left_valid, right_valid=right_valid)
                residuals.append(residual)
            advance()
    geometry = rig if rectifier is None else rectifier.geometry
    assert not isinstance(geometry, StereoCalibration)
    drift = measure_drift(geometry, residuals, calibration=calibration)
    verdict = judge(residuals, drift)
    if args.save:
        _save(args.save, calibration, drift)
    if args.json:
        print_json(verdict)
        return
    rows = [
        (name, _value(name, verdict["drift"][name]), _value(name, verdict["sigma"][name]), _mark(drift, name))
        for name in drift.values
    ]
    print_table("right camera against left, since calibration", ("", "moved", "sigma", ""), rows)
    say(f"{verdict['status']}: {verdict['reason']}")
    if args.save:
        say(f"wrote {args.save}")


def judge(residuals: list[AlignmentError], drift: Drift) -> dict[str, Any]:
    """The status ("holds", "drifted" or "cannot tell"), why, and the figures behind it."""
    # Each pair counts alike, however many matches it has.
    medians = [r.median_px for r in residuals if not math.isnan(r.median_px)]
    median_px = float(np.median(medians)) if medians else math.nan
    if drift.matches < _MIN_MATCHES:
        status = "cannot tell"
        reason = f"{drift.matches} matches in {len(residuals)} pairs (at least {_MIN_MATCHES} needed)"
    elif drift.axis is not None:
        status = "drifted"
        moved = _value(drift.axis, drift.values[drift.axis])
        sigma = _value(drift.axis, drift.sigma[drift.axis])
        reason = f"{drift.axis} moved by {moved} ± {sigma}; rows are {median_px:.2f} px off"
    elif median_px > _USABLE_PX:
        status = "drifted"
        reason = f"rows are {median_px:.2f} px off, and no turn of a camera explains it: calibrate anew"
    else:
        status = "holds"
        reason = f"rows are {median_px:.2f} px off in the median of {len(medians)} pairs"
    return {
        "status": status,
        "reason": reason,
        "median_px": median_px,
        "axis": drift.axis,
        "drift": drift.values,
        "sigma": drift.sigma,
        "pairs": drift.frames,
        "matches": drift.matches,
    }


def _value(name: str, value: float) -> str:
    return f"{100 * value:+.3f} %" if name == "zoom" else f"{math.degrees(value):+.4f} deg"


def _mark(drift: Drift, name: str) -> str:
    return "drifted" if drift.axis == name else ""


def _save(path: Path, calibration: StereoCalibration | None, drift: Drift) -> None:
    from epiline._core import realign

    if calibration is None:
        raise ValueError("--save: the pairs come aligned; there is no calibration to correct")
    realign(calibration, drift).save(path)
