"""`epiline calibrate`: photographs of a board in, a rig file and a verdict out."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from epiline._core import StereoCalibration
from epiline._operations import calibrate
from epiline.cli.arguments import whole
from epiline.cli.console import note, print_json, print_table, progress, say
from epiline.targets.boards import Board, Charuco, Chessboard, parse_board, parse_length
from epiline.verdict import Verdict, judge

if TYPE_CHECKING:
    from epiline.targets import Observations
    from epiline.targets.screening import LensModel

_DEPTHS_M = (1.0, 2.0, 4.0, 8.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "images", nargs="*", metavar="IMAGES", help="a folder of pairs, two folders or globs, or image files"
    )
    parser.add_argument(
        "--left",
        nargs="+",
        metavar="IMAGE",
        help="left photographs, instead of IMAGES; as many as right ones: pairs in this order, else pairs by name",
    )
    parser.add_argument("--right", nargs="+", metavar="IMAGE", help="right photographs, instead of IMAGES")
    parser.add_argument(
        "--board", required=True, metavar="9x6", help="columns x rows: inner corners, or squares of a ChArUco board"
    )
    parser.add_argument("--square", required=True, metavar="25mm", help="side of a square: 25mm, 2.5cm, 0.025m")
    parser.add_argument("--marker", metavar="18mm", help="side of a marker: the board is a ChArUco board")
    parser.add_argument(
        "--dictionary",
        metavar="NAME",
        default="DICT_4X4_50",
        help="of its markers, OpenCV's name (default %(default)s)",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="RIG", help="write the rig (YAML)")
    parser.add_argument("--method", choices=("bundle", "tsai"), default="bundle", help="default %(default)s")
    parser.add_argument(
        "--model",
        choices=("brown4", "brown5", "rational", "thin-prism", "fisheye", "auto"),
        default="brown4",
        help="lens: k1 k2 p1 p2; with k3; with k4 k5 k6 (80 degrees and more); with s1 to s4; Kannala-Brandt; "
        "auto: the simplest whose held-out error is next to the smallest (default %(default)s)",
    )
    parser.add_argument("--warp", action="store_true", help="also solve for the bend of the board")
    parser.add_argument(
        "--fix", action="append", default=[], metavar="NAME", help="hold a parameter: cx, left_k2, lens"
    )
    parser.add_argument(
        "--share", action="append", default=[], metavar="NAME", help="one value in both cameras: fx, k1, lens"
    )
    parser.add_argument("--square-pixels", action="store_true", help="fx = fy in each camera")
    parser.add_argument(
        "--folds",
        type=whole(2),
        default=2,
        metavar="K",
        help="parts of the views, each measured by a fit of the others (default %(default)s)",
    )
    parser.add_argument("--initial", type=Path, metavar="RIG", help="where to start, and what --fix holds")
    parser.add_argument("--loss", choices=("huber", "squared"), default="huber", help="default %(default)s")
    parser.add_argument(
        "--half-window",
        type=whole(1),
        metavar="PX",
        help="corner refinement window, half its side (default: follows the board)",
    )
    parser.add_argument(
        "--jobs",
        "--threads",
        dest="threads",
        type=whole(1),
        metavar="N",
        help="photographs looked at at once (default: all cores)",
    )
    parser.add_argument(
        "--cache", type=Path, metavar="FILE", help="keep found corners here, and look only at what is new or changed"
    )
    parser.add_argument("--report", type=Path, metavar="HTML", help="write a page with coverage, views and uncertainty")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(args: argparse.Namespace) -> None:
    board = _board(args)
    left, right = _photographs(args)
    observations = find(
        left,
        right,
        board,
        half_window=args.half_window,
        threads=args.threads,
        cache=args.cache,
        model=args.model,
    )
    calibration = calibrate(
        observations,
        method=args.method,
        model=args.model,
        loss=args.loss,
        held_out=args.folds,
        fix=args.fix,
        share=args.share,
        square_pixels=args.square_pixels,
        warp=args.warp,
        initial=StereoCalibration.load(args.initial) if args.initial else None,
    )
    verdict = judge(calibration, observations)
    if args.output:
        calibration.save(args.output)
    if args.report:
        from epiline.cli.reporting import write_calibration_report

        write_calibration_report(args.report, calibration, observations, verdict)
    if args.json:
        print_json(as_json(calibration, observations, verdict))
        return
    print_calibration(calibration, observations, verdict)
    for path in filter(None, (args.output, args.report)):
        say(f"wrote {path}")


def _board(args: argparse.Namespace) -> Board:
    columns, rows = parse_board(args.board)
    square_m = parse_length(args.square)
    if args.marker is None:
        return Chessboard(columns=columns, rows=rows, square_m=square_m)
    marker_m = parse_length(args.marker)
    return Charuco(columns=columns, rows=rows, square_m=square_m, marker_m=marker_m, dictionary=args.dictionary)


def _photographs(args: argparse.Namespace) -> tuple[list[Path | None], list[Path | None]]:
    """Left and right photographs, those of a pair at one place; None where a photograph has no partner."""
    from epiline.sources import ImagePairs, open_source, pair_lists

    if bool(args.left) != bool(args.right) or bool(args.left) == bool(args.images):
        raise ValueError("give either IMAGES or both --left and --right")
    if args.left:
        lists = [Path(p) for p in args.left], [Path(p) for p in args.right]
        if len(args.left) == len(args.right):
            return [*lists[0]], [*lists[1]]
        found = pair_lists(*lists)
        if not found.pairs:
            raise ValueError(
                f"--left has {len(args.left)} photographs, --right {len(args.right)}, and no two names belong together"
            )
    else:
        source = open_source(args.images, unpaired="skip")
        if not isinstance(source, ImagePairs):
            raise ValueError(f"{' '.join(args.images)}: calibration needs photographs as separate left and right files")
        found = source.pairing
    alone_left, alone_right = found.unpaired_left, found.unpaired_right
    for paths, side in ((alone_left, "left"), (alone_right, "right")):
        for path in paths:
            note(f"{path}: has no partner, informs the {side} camera alone")
    left = [*(pair.left for pair in found.pairs), *alone_left, *[None] * len(alone_right)]
    right = [*(pair.right for pair in found.pairs), *[None] * len(alone_left), *alone_right]
    return left, right


def find(
    left: Sequence[Path | None],
    right: Sequence[Path | None],
    board: Board,
    *,
    half_window: int | None,
    threads: int | None,
    cache: Path | None,
    model: LensModel = "brown4",
) -> Observations:
    """Finds the board in every pair, showing progress."""
    from epiline.targets import find_boards

    with progress("looking for boards", len(left)) as advance:
        return find_boards(
            left,
            right,
            board,
            corner_half_window=half_window,
            threads=threads,
            cache=cache,
            progress=lambda *_: advance(),
            model=model,
        )


def print_calibration(calibration: StereoCalibration, observations: Observations, verdict: Verdict) -> None:
    """The rig, its uncertainty, every rejected view with its reason, and the verdict."""
    for view in observations.rejected:
        if view.sides_alone:
            say(f"{view.name}: no pair, informs the {' and the '.join(view.sides_alone)} camera alone: {view.reason}")
        else:
            say(f"left out {view.name}: {view.reason}")
    for view in observations.accepted:
        if view.remark:
            say(f"{view.name}: {view.remark}")
    used = observations.calibration_views
    for outlier in outlier_names(calibration, observations):
        say(f"left out {outlier}")
    if len(used) > len(observations):
        say(f"{len(used) - len(observations)} views of one camera alone take part")
    rows = [
        (view.name, f"{v.left_rms_px:.3f}", f"{v.right_rms_px:.3f}")
        for view, v in zip(used, calibration.views, strict=True)
    ]
    print_table(
        f"{len(observations)} of {len(observations.views)} pairs", ("view", "left rms px", "right rms px"), rows
    )
    sigma = calibration.sigma
    cameras = []
    for side, camera in (("left", calibration.left), ("right", calibration.right)):
        matrix = camera.camera_matrix
        values = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
        cells = [
            f"{v:.2f} ± {sigma.get(f'{side}_{n}', float('nan')):.2f}"
            for n, v in zip(("fx", "fy", "cx", "cy"), values, strict=True)
        ]
        cameras.append((side, *cells, " ".join(f"{c:.4g}" for c in camera.distortion)))
    coefficients = [name.removeprefix("left_") for name in sigma if name.startswith("left_")][4:]
    print_table("cameras, px", ("", "fx", "fy", "cx", "cy", " ".join(coefficients)), cameras)
    baseline_sigma_mm = 1e3 * sigma.get("translation_x_m", float("nan"))
    say(f"baseline {1e3 * calibration.baseline_m:.3f} ± {baseline_sigma_mm:.3f} mm")
    say(f"stereo rms {calibration.rms_px:.4f} px, held-out epipolar error {calibration.epipolar_error_px:.4f} px")
    if calibration.board_warp_m is not None and calibration.board_warp_sigma_m is not None:
        heights = zip(1e3 * calibration.board_warp_m, 1e3 * calibration.board_warp_sigma_m, strict=True)
        say(f"board's bend along x and y: {', '.join(f'{h:.2f} ± {s:.2f} mm' for h, s in heights)}")
    depths = ", ".join(f"{1e3 * calibration.range_sigma(z):.1f} mm at {z:g} m" for z in _DEPTHS_M)
    say(f"range sigma from calibration alone: {depths}")
    say(f"verdict: {verdict}")
    for wish in verdict.photograph_next:
        say(f"photograph next: {wish}")


def outlier_names(calibration: StereoCalibration, observations: Observations) -> list[str]:
    """Every corner that the fit left out: whose photograph, where on the board (column, row), and why."""
    views = observations.calibration_views
    columns, _ = observations.board.corner_grid
    texts = []
    for outlier in calibration.outliers:
        view = views[outlier.view]
        corner = int(view.ids[outlier.corner])
        place = f"corner ({corner % columns + 1}, {corner // columns + 1})"
        texts.append(f"{view.name}, {outlier.side}, {place}: {outlier.reason}")
    return texts


def as_json(calibration: StereoCalibration, observations: Observations, verdict: Verdict) -> dict[str, object]:
    """Everything :func:`print_calibration` says."""

    def camera(side: str) -> dict[str, object]:
        model = getattr(calibration, side)
        return {
            "camera_matrix": model.camera_matrix.tolist(),
            "lens": model.lens,
            "distortion": model.distortion.tolist(),
        }

    return {
        "views": [
            {
                "left": v.name_left,
                "right": v.name_right,
                "accepted": v.accepted,
                "alone": list(v.sides_alone),
                "reason": v.reason,
                "remark": v.remark,
            }
            for v in observations.views
        ],
        "view_rms_px": [[v.left_rms_px, v.right_rms_px] for v in calibration.views],
        "outliers": outlier_names(calibration, observations),
        "image_size": list(calibration.image_size),
        "left": camera("left"),
        "right": camera("right"),
        "rotation": calibration.rotation.tolist(),
        "translation_m": calibration.translation_m.tolist(),
        "baseline_m": calibration.baseline_m,
        "rms_px": calibration.rms_px,
        "epipolar_error_px": calibration.epipolar_error_px,
        "sigma": calibration.sigma,
        "range_sigma_m": {f"{z:g}": calibration.range_sigma(z) for z in _DEPTHS_M},
        "verdict": {
            "grade": verdict.grade,
            "reasons": list(verdict.reasons),
            "photograph_next": list(verdict.photograph_next),
        },
    }
