"""Prints the calibration figures of the README: optimum, held-out error, outliers, Tsai, times.

    python benchmarks/calibration_anchors.py [DATA]

Corners come from OpenCV here, so that a change of our own detection cannot move the solver's figures. Times are of
one thread, beside OpenCV's for the same corners in the same run.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import epiline as ep
from epiline import tsai

Array = np.ndarray


@dataclass(frozen=True)
class Rig:
    """Corners of one set of photographs."""

    left: list[Array]
    right: list[Array]
    board: Array
    size: tuple[int, int]

    def some(self, views: list[int]) -> Rig:
        return Rig([self.left[i] for i in views], [self.right[i] for i in views], self.board, self.size)

    def calibrate(self, **options: Any) -> ep.StereoCalibration:
        return ep.calibrate_points(self.left, self.right, [self.board] * len(self.left), self.size, **options)


def spacing(corners: Array, columns: int) -> float:
    grid = corners.reshape(-1, columns, 2)
    return float(min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1)))


def detect(pairs: list[tuple[Path, Path]], columns: int, rows: int, square_m: float, half_window: int | None) -> Rig:
    """Corners of the pairs in which both boards are found; half-window None: 0.35 times the smallest spacing."""
    left: list[Array] = []
    right: list[Array] = []
    size = (0, 0)
    for pair in pairs:
        found = []
        for path in pair:
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            ok, corners = cv2.findChessboardCorners(image, (columns, rows))
            if not ok:
                break
            size = (image.shape[1], image.shape[0])
            half = half_window or max(2, round(0.35 * spacing(corners, columns)))
            # OpenCV's sample stops at 0.01 px, and so does the published optimum for a fixed window.
            stop = (3, 100, 0.01 if half_window else 1e-4)
            corners = cv2.cornerSubPix(image, corners.reshape(-1, 1, 2), (half, half), (-1, -1), stop)
            found.append(corners.reshape(-1, 2).astype(float))
        if len(found) == 2:
            if (found[0][-1] - found[0][0]) @ (found[1][-1] - found[1][0]) < 0:
                found[1] = found[1][::-1].copy()
            left.append(found[0])
            right.append(found[1])
    board = np.array([[x * square_m, y * square_m, 0.0] for y in range(rows) for x in range(columns)])
    return Rig(left, right, board, size)


def rigs(data: Path, half_window: int | None) -> dict[str, Rig]:
    folder = data / "calib"

    def numbered(name: str, pattern: str, numbers: list[int]) -> list[tuple[Path, Path]]:
        return [
            (folder / name / pattern.format("left", i), folder / name / pattern.format("right", i)) for i in numbers
        ]

    bouguet = numbered("opencv_bouguet", "{}{:02d}.jpg", [i for i in range(1, 15) if i != 10])
    bumblebee = numbered("boofcv_Bumblebee2_Chess", "{}{:02d}.jpg", list(range(1, 12)))
    stereopi = numbered("stereopi/pairs", "{}_{:02d}.png", list(range(1, 31)))
    sourishg = numbered("sourishg_2", "{}{}.jpg", list(range(1, 29)))
    return {
        "opencv_bouguet": detect(bouguet, 9, 6, 0.025, half_window),
        "Bumblebee2": detect(bumblebee, 6, 4, 0.03, half_window),
        "stereopi": detect(stereopi, 9, 6, 0.025, half_window),
        "sourishg_2": detect(sourishg, 9, 6, 0.025, half_window),
    }


def undistorted(pixels: Array, camera: ep.CameraModel) -> Array:
    k = camera.camera_matrix
    ideal = camera.undistort(pixels)
    rays = [(ideal[:, 0] - k[0, 2]) / k[0, 0], (ideal[:, 1] - k[1, 2]) / k[1, 1], np.ones(len(ideal))]
    return np.column_stack(rays)


def aligned(calibration: ep.StereoCalibration, left: Array, right: Array) -> tuple[Array, Array]:
    """Normalised positions of both corners in the aligned frame, as docs/conventions.md defines it."""
    half = cv2.Rodrigues(cv2.Rodrigues(calibration.rotation)[0] / 2)[0]
    center = -half.T @ calibration.translation_m
    axis = np.cross(center, [1.0, 0, 0])
    angle = math.atan2(float(np.linalg.norm(axis)), float(center[0]))
    level = cv2.Rodrigues(axis / np.linalg.norm(axis) * angle)[0]
    rays = (
        undistorted(left, calibration.left) @ (level @ half).T,
        undistorted(right, calibration.right) @ (level @ half.T).T,
    )
    return rays[0][:, :2] / rays[0][:, 2:], rays[1][:, :2] / rays[1][:, 2:]


def focal_px(calibration: ep.StereoCalibration) -> float:
    return float(calibration.left.camera_matrix[1, 1] + calibration.right.camera_matrix[1, 1]) / 2


def held_out_px(rig: Rig, **options: Any) -> Array:
    """|Vertical disparity| of all corners, each from the half that did not see it."""
    errors = []
    for first in (0, 1):
        train = [i for i in range(len(rig.left)) if i % 2 != first]
        half = rig.some(train).calibrate(held_out=False, **options)
        left, right = aligned(half, np.concatenate(rig.left[first::2]), np.concatenate(rig.right[first::2]))
        errors.append(focal_px(half) * np.abs(left[:, 1] - right[:, 1]))
    return np.concatenate(errors)


def milliseconds(run: Callable[[], Any], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * sorted(times)[repeats // 2]


def opencv_stereo(rig: Rig) -> float:
    boards = [rig.board.astype(np.float32)] * len(rig.left)
    lists = [[c.astype(np.float32) for c in side] for side in (rig.left, rig.right)]
    mono = [cv2.calibrateCamera(boards, side, rig.size, None, None, flags=cv2.CALIB_FIX_K3) for side in lists]
    (_, k1, d1, *_), (_, k2, d2, *_) = mono
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_USE_INTRINSIC_GUESS
    return float(cv2.stereoCalibrate(boards, *lists, k1, d1, k2, d2, rig.size, flags=flags)[0])


def real_rigs(data: Path) -> None:
    print(
        "rig             window     loss     model   rms px   baseline mm        fx px             held-out mean / max"
    )
    for half_window in (5, None):
        for name, rig in rigs(data, half_window).items():
            for loss, model in (("squared", "brown4"), ("huber", "brown4"), ("huber", "brown5")):
                found = rig.calibrate(loss=loss, model=model)
                errors = held_out_px(rig, loss=loss, model=model)
                baseline = f"{1e3 * found.baseline_m:8.3f} ± {1e3 * found.sigma['translation_x_m']:.3f}"
                focal = f"{found.left.camera_matrix[0, 0]:.2f} {found.right.camera_matrix[0, 0]:.2f}"
                print(
                    f"{name:15} {half_window or '0.35 sp.':>8}  {loss:8} {model}  {found.rms_px:.4f}  "
                    f"{baseline}   {focal}   {errors.mean():.4f} / {errors.max():.3f} px"
                )


def speed(data: Path) -> None:
    rig = rigs(data, 5)["opencv_bouguet"]
    cv2.setNumThreads(1)
    ours = milliseconds(lambda: rig.calibrate(held_out=False), 9)
    with_folds = milliseconds(rig.calibrate, 9)
    opencv = milliseconds(lambda: opencv_stereo(rig), 5)
    print(
        f"13 pairs: {ours:.1f} ms, {with_folds:.1f} with the held-out fits; OpenCV {cv2.__version__}: {opencv:.1f} ms"
    )


def synthetic_twin(data: Path, trials: int = 30) -> None:
    """The 13 views again with known truth: 0.15 px noise per coordinate, 0 or 2 % outliers of up to ±5 px."""
    rig = rigs(data, 5)["opencv_bouguet"]
    truth = rig.calibrate(held_out=False)
    to_right = truth.rotation, truth.translation_m
    boards = [rig.board @ v.rotation.T + v.translation_m for v in truth.views]
    left = [truth.left.project(p) for p in boards]
    right = [truth.right.project(p @ to_right[0].T + to_right[1]) for p in boards]
    # Points of every part of the left image at one depth, as far as the right camera sees them.
    at = np.stack(np.meshgrid(np.linspace(20, 620, 25), np.linspace(20, 460, 19)), axis=-1).reshape(-1, 2)
    rays = undistorted(at, truth.left)
    for share in (0.0, 0.02):
        for loss in ("squared", "huber"):
            errors: dict[float, list[tuple[Array, Array]]] = {0.4: [], 1.0: [], 3.0: []}
            for seed in range(trials):
                rng = np.random.default_rng(seed)
                seen = []
                for side in (left, right):
                    moved = [c + rng.normal(0, 0.15, c.shape) for c in side]
                    wild = [rng.random(len(c)) < share for c in moved]
                    kicks = [w[:, None] * rng.uniform(-5, 5, c.shape) for w, c in zip(wild, moved, strict=True)]
                    seen.append([np.clip(c + k, 0, [639, 479]) for c, k in zip(moved, kicks, strict=True)])
                found = Rig(*seen, rig.board, rig.size).calibrate(loss=loss, held_out=False)
                for depth_m, list_of in errors.items():
                    points = rays * depth_m
                    pixels = truth.right.project(points @ to_right[0].T + to_right[1])
                    ok = ((pixels > 0) & (pixels < [640, 480])).all(axis=1)
                    ours = np.subtract(*aligned(found, at[ok], pixels[ok]))
                    real = np.subtract(*aligned(truth, at[ok], pixels[ok]))
                    ratio = (found.baseline_m / ours[:, 0]) / (truth.baseline_m / real[:, 0])
                    list_of.append((focal_px(found) * ours[:, 1], 100 * (ratio - 1)))
            rms = {
                z: [np.sqrt(np.mean(np.concatenate(e) ** 2)) for e in zip(*v, strict=True)] for z, v in errors.items()
            }
            text = "   ".join(f"{z:g} m: {dy:.3f} px {share_:.3f} %" for z, (dy, share_) in rms.items())
            print(f"twin, {100 * share:g} % outliers, {loss:8} vertical rms, range error at {text}")


def willson(data: Path) -> None:
    sensor = tsai.Sensor(ncx=576, nfx=576, dx_mm=0.023, dy_mm=0.023, cx=258, cy=204)
    for name, title in (("cc_cd.dat", "coplanar"), ("ncc_cd.dat", "in space")):
        table = np.loadtxt(data / "tsai" / "willson_3.0b3" / name)
        for full in (False, True):
            c = tsai.calibrate(table[:, :3], table[:, 3:], sensor=sensor, full=full)
            stages = "full" if full else "two-stage"
            found = f"f {c.f:.4f} mm  kappa1 {c.kappa1:.4e}  Tz {c.Tz:.2f} mm  SSE {c.sse_px2:.6f} px²"
            print(f"Tsai {title:9} {stages:9} {found}")


def main() -> None:
    default = os.environ.get("EPILINE_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")
    data = Path(sys.argv[1] if len(sys.argv) > 1 else default)
    real_rigs(data)
    speed(data)
    synthetic_twin(data)
    willson(data)


if __name__ == "__main__":
    main()
