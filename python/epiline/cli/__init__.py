"""The command line: a file per verb, this one finds and runs them."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

from epiline._core import Error, __version__

# Verb, module, one line of help. Modules load only when their verb is used: `epiline info` needs no OpenCV.
_VERBS = (
    ("demo", "demo", "the whole system on a rendered rig: no camera, no download"),
    ("calibrate", "calibrate", "a rig from photographs of a board"),
    ("rectify", "rectify", "align pairs by a rig; prints the epipolar error"),
    ("align", "align", "align pairs without a calibration, and say whether to trust it"),
    ("check-rig", "check_rig", "whether a rig still holds, from ordinary pairs"),
    ("match", "match", "disparity of one pair, as picture, array or point cloud"),
    ("run", "run", "the continuous process: pairs in, ranges and obstacles out"),
    ("regions", "regions", "value against column of regions of one pair, as table and pictures"),
    ("measure", "measure", "collect pairs of disparity and distance for fit-range"),
    ("fit-range", "fit_range", "fit distance = a e^(bx) + c e^(dx) to measured pairs"),
    ("evaluate", "evaluate", "accuracy against ground truth"),
    ("tune", "tune", "parameters for your own scenes, and why"),
    ("bench", "bench", "speed against OpenCV in one run, answers compared"),
    ("info", "info", "version, instruction set, cores"),
)


def _parser(verb: str | None) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="epiline", description="From two cameras to obstacle ranges, live, on a CPU.")
    parser.add_argument("--version", action="version", version=f"epiline {__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for name, module, summary in _VERBS:
        sub = verbs.add_parser(name, help=summary, description=summary[0].upper() + summary[1:] + ".")
        if name == verb:
            chosen = importlib.import_module(f"epiline.cli.{module}")
            chosen.add_arguments(sub)
            sub.set_defaults(run=chosen.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one verb.

    Returns
    -------
    int
        0 done, 1 failed (one line on standard error says why), 2 wrong usage, 130 interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    verb = next((a for a in arguments if not a.startswith("-")), None)
    args = _parser(verb).parse_args(arguments)
    try:
        args.run(args)
    except BrokenPipeError:
        # The reader of our output went away, as `head` does; what is buffered has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except (ValueError, OSError, Error) as error:
        print(f"epiline: {_one_line(error)}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.strerror:
        where = f"{error.filename}: " if error.filename else ""
        return f"{where}{error.strerror}"
    return " ".join(str(error).split()) or type(error).__name__
