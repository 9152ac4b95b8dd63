"""`epiline info`: what this build is and what the machine offers it; with --rig, what a rig file holds."""

from __future__ import annotations

import argparse
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np

from epiline._core import (
    CameraModel,
    Rectifier,
    StereoCalibration,
    __version__,
    default_disparities,
    simd_level,
    useful_depth_m,
)
from epiline.cli.arguments import positive, whole
from epiline.cli.console import print_json, print_table

_WRITTEN = ("epiline", "opencv", "ros", "kalibr", "mrcal", "middlebury", "kitti")
_READ = (*_WRITTEN, "boofcv", "kitti-grey", "kitti-raw")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument(
        "--rig",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="describe a rig instead: one file, or two (left and right; OpenCV: intrinsics and extrinsics)",
    )
    parser.add_argument("--save-as", nargs="+", type=Path, metavar="FILE", help="write that rig to one file or two")
    parser.add_argument("--format", choices=_WRITTEN, help="of the files written; by default their names decide")
    parser.add_argument("--read-as", choices=_READ, help="format of the files read; by default their content decides")
    parser.add_argument(
        "--cameras", nargs=2, type=whole(0), metavar="N", help="left and right camera of KITTI's files, which hold four"
    )
    parser.add_argument(
        "--image-size", type=_size, metavar="WxH", help="of the photographs, px, for files that do not say"
    )
    parser.add_argument(
        "--disparities", type=whole(1), metavar="N", help="of the rig's blind zone (default: a sixth of the width)"
    )
    parser.add_argument(
        "--disparity-sigma",
        type=positive,
        default=0.25,
        metavar="PX",
        help="standard deviation of a disparity that useful ranges are for (default 0.25)",
    )
    parser.add_argument(
        "--unit", type=float, default=1.0, metavar="M", help="metres in a unit of length, for files that do not say"
    )


def run(args: argparse.Namespace) -> None:
    if args.rig is not None:
        _run_rig(args)
        return
    if args.save_as is not None:
        raise ValueError("--save-as: give the rig to write with --rig")
    facts: dict[str, object] = {
        "version": __version__,
        "simd_level": simd_level(),
        "cores": _cores(),
        "machine": platform.machine(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "cameras": _cameras(),
    }
    if args.json:
        print_json(facts)
        return
    cameras = facts.pop("cameras")
    assert isinstance(cameras, list)
    rows = [(name.replace("_", " "), value) for name, value in facts.items()]
    rows.append(("cameras", ", ".join(c["device"] for c in cameras) or "none found"))
    print_table("epiline", ("", ""), rows)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise argparse.ArgumentTypeError(f"'{text}': expected WIDTHxHEIGHT, like 640x480")
    return int(width), int(height)


def _paths(option: str, paths: list[Path]) -> Path | tuple[Path, Path]:
    if len(paths) == 1:
        return paths[0]
    if len(paths) == 2:
        return paths[0], paths[1]
    raise ValueError(f"{option}: expected one file or two, got {len(paths)}")


def _run_rig(args: argparse.Namespace) -> None:
    rig = StereoCalibration.load(
        _paths("--rig", args.rig),
        format=args.read_as,
        image_size=args.image_size,
        unit_m=args.unit,
        cameras=None if args.cameras is None else (args.cameras[0], args.cameras[1]),
    )
    if args.save_as is not None:
        rig.save(_paths("--save-as", args.save_as), format=args.format)
    facts: dict[str, object] = {
        "baseline_m": rig.baseline_m,
        "translation_m": rig.translation_m.tolist(),
        "rotation": rig.rotation.tolist(),
        "rms_px": rig.rms_px,
        "epipolar_error_px": rig.epipolar_error_px,
    }
    cameras = {"left": rig.left, "right": rig.right}
    reach = _reach(rig, args.disparities, args.disparity_sigma)
    if args.json:
        described = {
            side: {
                "width": camera.width,
                "height": camera.height,
                "lens": camera.lens,
                "camera_matrix": camera.camera_matrix.tolist(),
                "distortion": camera.distortion.tolist(),
                "fov_deg": _field_of_view(camera),
            }
            for side, camera in cameras.items()
        }
        print_json({**facts, **described, "reach": reach})
        return
    rows: list[tuple[str, object]] = []
    for side, camera in cameras.items():
        (fx, _, cx), (_, fy, cy), _ = camera.camera_matrix.tolist()
        across, along = _field_of_view(camera)
        rows += [
            (side, f"{camera.width}x{camera.height} px, {camera.lens}, {across:.1f} x {along:.1f} degrees"),
            ("", f"fx {fx:.2f}  fy {fy:.2f}  cx {cx:.2f}  cy {cy:.2f} px"),
            ("", " ".join(f"{c:.4g}" for c in camera.distortion)),
        ]
    rows.append(("baseline", f"{1e3 * rig.baseline_m:.3f} mm"))
    rows.append(("rms, held-out epipolar error", f"{rig.rms_px:.3f}, {rig.epipolar_error_px:.3f} px"))
    rows += _reach_rows(reach)
    print_table("rig", ("", ""), rows)


_SHARES = (0.01, 0.02, 0.05, 0.1, 0.2)
"""Standard deviations of a range, as shares of it, that useful ranges are printed for."""


def _reach(rig: StereoCalibration, disparities: int | None, disparity_sigma_px: float) -> dict[str, Any]:
    """Where the aligned pair measures: from the largest disparity searched to where the range grows too uncertain."""
    geometry = Rectifier(rig).geometry
    count = disparities or default_disparities(geometry.width)
    useful = {share: useful_depth_m(geometry, share, disparity_sigma_px=disparity_sigma_px) for share in _SHARES}
    return {
        "num_disparities": count,
        "disparity_sigma_px": disparity_sigma_px,
        "blind_below_m": geometry.depth_m(count - 1),
        "useful_depth_m": {f"{share:g}": depth_m for share, depth_m in useful.items()},
    }


def _reach_rows(reach: dict[str, Any]) -> list[tuple[str, object]]:
    count, blind_m, sigma_px = reach["num_disparities"], reach["blind_below_m"], reach["disparity_sigma_px"]
    rows: list[tuple[str, object]] = [("blind zone", f"below {blind_m:.3f} m with {count} disparities")]
    title = "useful range"
    for share, depth_m in reach["useful_depth_m"].items():
        end = f"up to {depth_m:.2f} m" if depth_m > 0 else "nowhere: the calibration alone is worse"
        beyond = "" if depth_m > blind_m or depth_m == 0 else ", inside the blind zone"
        rows.append((title, f"sigma <= {100 * float(share):g} %: {end}{beyond}"))
        title = ""
    rows.append(("", f"depth Z, for a disparity sigma of {sigma_px:g} px and this calibration"))
    return rows


def _field_of_view(camera: CameraModel) -> tuple[float, float]:
    """Degrees between the rays of the middle row's ends and of the middle column's; NaN where the lens has none."""
    right, bottom = camera.width - 1.0, camera.height - 1.0
    ends = [[0, bottom / 2], [right, bottom / 2], [right / 2, 0], [right / 2, bottom]]
    # From the axis outward: between the rays themselves an angle beyond 180 degrees would count as less.
    angles = np.degrees(np.arccos(np.clip(camera.directions(ends)[:, 2], -1, 1)))
    return float(angles[0] + angles[1]), float(angles[2] + angles[3])


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _cameras() -> list[dict[str, str]]:
    """V4L2 devices as the kernel lists them; other systems name none without opening them."""
    devices = sorted(Path("/sys/class/video4linux").glob("video*"), key=lambda p: (len(p.name), p.name))
    found = []
    for device in devices:
        try:
            name = (device / "name").read_text().strip()
        except OSError:
            name = ""
        found.append({"device": f"/dev/{device.name}", "name": name})
    return found
