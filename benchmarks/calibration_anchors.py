"""Prints the calibration figures of the README: optimum, held-out error, outliers, honesty of sigma, Tsai, times.

    python benchmarks/calibration_anchors.py [DATA] [--only PART ...]

PART is one of rigs, corners, charuco, stereopi, speed, twin, sigma, tsai; all of them without.

Corners come from OpenCV, so that a change of our own detection cannot move the solver's figures; those of the parts
corners, charuco and stereopi are our own. Times are of one thread, beside OpenCV's for the same corners in one run.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
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


Photographs = tuple[list[tuple[Path, Path]], int, int, float]


def photographs(data: Path) -> dict[str, Photographs]:
    """Pairs, columns, rows and side of the squares of each set."""
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
        "opencv_bouguet": (bouguet, 9, 6, 0.025),
        "Bumblebee2": (bumblebee, 6, 4, 0.03),
        "stereopi": (stereopi, 9, 6, 0.025),
        "sourishg_2": (sourishg, 9, 6, 0.025),
    }


def rigs(data: Path, half_window: int | None, only: str | None = None) -> dict[str, Rig]:
    sets = photographs(data)
    return {name: detect(*of, half_window) for name, of in sets.items() if only in (None, name)}


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


def held_out(rig: Rig, **options: Any) -> tuple[Array, Array]:
    """Of all corners, each from the half that did not see it: |vertical disparity| in px, and distance of the
    triangulated corner from the board moved to where it fits best, in mm."""
    vertical, off_board = [], []
    for first in (0, 1):
        train = [i for i in range(len(rig.left)) if i % 2 != first]
        half = rig.some(train).calibrate(held_out=False, **options)
        for left_px, right_px in zip(rig.left[first::2], rig.right[first::2], strict=True):
            left, right = aligned(half, left_px, right_px)
            vertical.append(focal_px(half) * np.abs(left[:, 1] - right[:, 1]))
            depth_m = half.baseline_m / (left[:, 0] - right[:, 0])
            points = depth_m[:, None] * np.column_stack(
                [left[:, 0], (left[:, 1] + right[:, 1]) / 2, np.ones(len(left))]
            )
            off_board.append(1e3 * np.linalg.norm(points - fitted(rig.board, points), axis=1))
    return np.concatenate(vertical), np.concatenate(off_board)


def fitted(board: Array, points: Array) -> Array:
    """The board moved rigidly to where it is closest to the points (Kabsch)."""
    to, origin = points.mean(axis=0), board.mean(axis=0)
    u, _, vt = np.linalg.svd((board - origin).T @ (points - to))
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return np.asarray((board - origin) @ (u @ flip @ vt) + to)


def milliseconds(run: Callable[[], Any], repeats: int) -> float:
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        run()
        times.append(time.perf_counter() - start)
    return 1e3 * sorted(times)[repeats // 2]


def opencv_stereo(rig: Rig) -> ep.StereoCalibration:
    """calibrateCamera on each side, then stereoCalibrate on everything."""
    boards = [rig.board.astype(np.float32)] * len(rig.left)
    lists = [[c.astype(np.float32) for c in side] for side in (rig.left, rig.right)]
    mono = [cv2.calibrateCamera(boards, side, rig.size, None, None, flags=cv2.CALIB_FIX_K3) for side in lists]
    (_, k1, d1, *_), (_, k2, d2, *_) = mono
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_USE_INTRINSIC_GUESS
    _, k1, d1, k2, d2, turn, shift, *_ = cv2.stereoCalibrate(boards, *lists, k1, d1, k2, d2, rig.size, flags=flags)
    width, height = rig.size
    left, right = (ep.CameraModel(k, d.ravel()[:5], width=width, height=height) for k, d in ((k1, d1), (k2, d2)))
    return ep.StereoCalibration(left, right, turn, shift.ravel())


def real_rigs(data: Path) -> None:
    print(
        "rig             window     loss     model   rms px   baseline mm        fx px             "
        "held-out mean / max, board rms   corners left out"
    )
    for half_window in (5, None):
        for name, rig in rigs(data, half_window).items():
            for loss, model in (("squared", "brown4"), ("huber", "brown4"), ("huber", "brown5")):
                found = rig.calibrate(loss=loss, model=model)
                errors, board_mm = held_out(rig, loss=loss, model=model)
                baseline = f"{1e3 * found.baseline_m:8.3f} ± {1e3 * found.sigma['translation_x_m']:.3f}"
                focal = f"{found.left.camera_matrix[0, 0]:.2f} {found.right.camera_matrix[0, 0]:.2f}"
                print(
                    f"{name:15} {half_window or '0.35 sp.':>8}  {loss:8} {model}  {found.rms_px:.4f}  "
                    f"{baseline}   {focal}   {errors.mean():.4f} / {errors.max():.3f} px, "
                    f"{np.sqrt(np.mean(board_mm**2)):.3f} mm   {len(found.outliers)}"
                )


def speed(data: Path) -> None:
    rig = rigs(data, 5, only="opencv_bouguet")["opencv_bouguet"]
    cv2.setNumThreads(1)
    ours = milliseconds(lambda: rig.calibrate(held_out=False), 21)
    with_folds = milliseconds(rig.calibrate, 9)
    opencv = milliseconds(lambda: opencv_stereo(rig), 5)
    print(
        f"13 pairs: {ours:.1f} ms, {with_folds:.1f} with the held-out fits; OpenCV {cv2.__version__}: {opencv:.1f} ms"
    )


def own_corners(data: Path) -> None:
    """Our detection, refinement and screening in place of OpenCV's."""
    for name, (pairs, columns, rows, square_m) in photographs(data).items():
        views = ep.find_boards(*zip(*pairs, strict=True), ep.Chessboard(columns=columns, rows=rows, square_m=square_m))
        rig = Rig(views.left_px, views.right_px, views.board.points_m, views.image_size)
        found = rig.calibrate()
        errors, board_mm = held_out(rig)
        print(
            f"{name:15} our own corners, {len(views)} of {len(pairs)} pairs: rms {found.rms_px:.4f} px, "
            f"baseline {1e3 * found.baseline_m:.3f} mm, held-out {errors.mean():.4f} / {errors.max():.3f} px, "
            f"{np.sqrt(np.mean(board_mm**2)):.3f} mm, {len(found.outliers)} corners left out"
        )


def charuco(data: Path) -> None:
    """Our own detection here: baseline against the published 75.00 mm."""
    folder = data / "calib" / "shubhamwagh_charuco"
    board = ep.Charuco(columns=31, rows=16, square_m=0.04933, marker_m=0.03846, dictionary="DICT_4X4_250")
    sides = [sorted((folder / side).iterdir()) for side in ("left", "right")]
    views = ep.find_boards(*sides, board, model="rational")
    for model in ("brown4", "brown5", "rational", "thin-prism", "fisheye", "auto"):
        found = ep.calibrate(views, model=model)
        print(
            f"ChArUco, {model:10} ({found.left.lens}): rms {found.rms_px:.4f} px, "
            f"baseline {1e3 * found.baseline_m:.3f} ± {1e3 * found.sigma['translation_x_m']:.3f} mm, "
            f"held-out {found.epipolar_error_px:.4f} px, {len(found.outliers)} corners left out"
        )


def stereopi(data: Path) -> None:
    """Our own detection: pair 15's right grid is mis-found by OpenCV's."""
    folder = data / "calib" / "stereopi" / "pairs"
    sides = [[folder / f"{side}_{i:02d}.png" for i in range(1, 31)] for side in ("left", "right")]
    views = ep.find_boards(*sides, ep.Chessboard())
    found = ep.calibrate(views)
    left_out = "; ".join(f"{view.name_left}: {view.reason}" for view in views.rejected)
    print(
        f"stereopi: rms {found.rms_px:.4f} px, {len(views)} of {len(views.views)} pairs, "
        f"{len(found.outliers)} corners left out; {left_out or 'every pair used'}"
    )


class Twin:
    """The 13 views again with known truth."""

    def __init__(self, data: Path) -> None:
        self.rig = rigs(data, 5, only="opencv_bouguet")["opencv_bouguet"]
        self.truth = self.rig.calibrate(held_out=False)
        boards = [self.rig.board @ v.rotation.T + v.translation_m for v in self.truth.views]
        self.left = [self.truth.left.project(p) for p in boards]
        self.right = [self.truth.right.project(self.in_right(p)) for p in boards]

    def in_right(self, points: Array) -> Array:
        return np.asarray(points @ self.truth.rotation.T + self.truth.translation_m)

    def errors(self, found: ep.StereoCalibration, margin_px: int, depth_m: float) -> Array:
        """(2, N): vertical disparity, px, and error of the range, %, of a grid of points of the left picture at one
        depth, as far as the right camera sees them."""
        width, height = self.rig.size
        columns = np.linspace(margin_px, width - 1 - margin_px, 25)
        rows = np.linspace(margin_px, height - 1 - margin_px, 19)
        at = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        pixels = self.truth.right.project(self.in_right(undistorted(at, self.truth.left) * depth_m))
        ok = ((pixels > 0) & (pixels < self.rig.size)).all(axis=1)
        ours, real = (np.subtract(*aligned(rig, at[ok], pixels[ok])) for rig in (found, self.truth))
        ratio = (found.baseline_m / ours[:, 0]) / (self.truth.baseline_m / real[:, 0])
        return np.stack([focal_px(found) * ours[:, 1], 100 * (ratio - 1)])

    def seen(self, seed: int, wild_share: float, *, known: bool = False) -> Rig:
        """With 0.15 px noise per coordinate, and outliers of up to ±5 px; those unseen if they are known."""
        rng = np.random.default_rng(seed)
        seen = []
        for side in (self.left, self.right):
            moved = [c + rng.normal(0, 0.15, c.shape) for c in side]
            wild = [rng.random(len(c)) < wild_share for c in moved]
            kicks = [w[:, None] * rng.uniform(-5, 5, c.shape) for w, c in zip(wild, moved, strict=True)]
            if known:
                kicks = [np.where(w[:, None], np.nan, k) for w, k in zip(wild, kicks, strict=True)]
            seen.append([np.clip(c + k, 0, [639, 479]) for c, k in zip(moved, kicks, strict=True)])
        return Rig(*seen, self.rig.board, self.rig.size)


def synthetic_twin(data: Path, trials: int = 210) -> None:
    """Against known truth: 0 or 2 % outliers, every solver on the same draws.

    "known" is the squared loss told which corners are outliers: no estimator of these parameters from these corners
    does better. Vertical and range errors grow steeply towards the border of the picture, so two areas are printed; the
    errors of baseline and focal length do not depend on the area. Spreads are those of batches of 30 trials.
    """
    twin = Twin(data)
    solvers: dict[str, Callable[[Rig], ep.StereoCalibration]] = {
        "known": lambda seen: seen.calibrate(loss="squared", held_out=False),
        "squared": lambda seen: seen.calibrate(loss="squared", held_out=False),
        "huber": lambda seen: seen.calibrate(held_out=False),
        "OpenCV": opencv_stereo,
    }
    for share in (0.0, 0.02):
        for name, solve in solvers.items():
            if name == "known" and not share:
                continue
            seen = (twin.seen(seed, share, known=name == "known") for seed in range(trials))
            twin_row(f"twin, {100 * share:g} % outliers, {name:8}", twin, [solve(rig) for rig in seen])


def twin_row(title: str, twin: Twin, found: list[ep.StereoCalibration]) -> None:
    def rms(values: Array) -> float:
        return float(np.sqrt(np.nanmean(np.square(values))))

    baseline_mm = 1e3 * np.array([fit.baseline_m - twin.truth.baseline_m for fit in found])
    focal = [(fit.left.camera_matrix - twin.truth.left.camera_matrix)[0, 0] for fit in found]
    errors = f"baseline {rms(baseline_mm):.4f} mm, fx {rms(np.array(focal)):.3f} px"
    print(f"{title} rms error over {len(found)} trials: {errors}")
    for margin_px in (20, 40):
        for depth_m in (0.4, 1.0, 3.0):
            errors = np.array([twin.errors(fit, margin_px, depth_m) for fit in found])
            batches = errors[: len(errors) // 30 * 30].reshape(-1, 30, *errors.shape[1:])
            ranges = [sorted(rms(batch[:, i]) for batch in batches) for i in (0, 1)]
            print(
                f"    {margin_px} px and more from the border, {depth_m:3g} m: "
                f"vertical {rms(errors[:, 0]):.3f} px ({ranges[0][0]:.3f} to {ranges[0][-1]:.3f}), "
                f"range {rms(errors[:, 1]):.3f} % ({ranges[1][0]:.3f} to {ranges[1][-1]:.3f})"
            )


def honest_sigma(data: Path, trials: int = 500, seeds: tuple[int, ...] = (10_000, 20_000, 30_000)) -> None:
    """Shares of trials whose error is within one and two of the standard deviations that the fit reports.

    Of three independent sets of trials, each beside what chance alone leaves of an honest sigma (95 % of such sets).
    """
    twin = Twin(data)
    truth = twin.truth
    centre = np.array([[(twin.rig.size[0] - 1) / 2, (twin.rig.size[1] - 1) / 2]])
    ray = undistorted(centre, truth.left)
    half = cv2.Rodrigues(cv2.Rodrigues(truth.rotation)[0] / 2)[0]
    # 3 m deep in the aligned frame, to which the turn of the baseline adds nothing at this size.
    point = ray * (3.0 / float((half @ ray[0])[2]))
    pixel = truth.right.project(twin.in_right(point))
    real_m = truth.baseline_m / float(np.subtract(*aligned(truth, centre, pixel))[0, 0])
    shares = {sigmas: math.erf(sigmas / math.sqrt(2)) for sigmas in (1, 2)}
    chance = {n: 196 * math.sqrt(p * (1 - p) / trials) for n, p in shares.items()}
    print(
        f"sigma, sets of {trials} trials; honest: {100 * shares[1]:.1f} ± {chance[1]:.1f} % within 1 sigma, "
        f"{100 * shares[2]:.1f} ± {chance[2]:.1f} % within 2 in 95 of 100 sets"
    )
    for share in (0.0, 0.02):
        sets = []
        for first in seeds:
            ratios: dict[str, list[float]] = {}
            for seed in range(first, first + trials):
                found = twin.seen(seed, share).calibrate(held_out=False)
                error_m = found.baseline_m - truth.baseline_m
                ratios.setdefault("baseline", []).append(error_m / found.sigma["translation_x_m"])
                turn = cv2.Rodrigues(found.rotation @ truth.rotation.T)[0].ravel()
                for axis, angle in zip("xyz", turn, strict=True):
                    ratios.setdefault(f"angle {axis}", []).append(angle / found.sigma[f"rotation_{axis}"])
                depth_m = found.baseline_m / float(np.subtract(*aligned(found, centre, pixel))[0, 0])
                # Ranges err as inverse depths do: for those the error is Gaussian.
                ratios.setdefault("range at 3 m", []).append(
                    (1 / depth_m - 1 / real_m) * real_m**2 / found.range_sigma(real_m)
                )
            sets.append({name: np.abs(values) for name, values in ratios.items()})
        for name in sets[0]:
            text = [
                ", ".join(f"{100 * np.mean(one[name] < n):.1f}" for one in sets)
                + f" (all {100 * np.mean([one[name] < n for one in sets]):.1f}) % within {n}"
                for n in (1, 2)
            ]
            print(f"sigma, {100 * share:g} % outliers, {name:12} {'; '.join(text)}")


def willson(data: Path) -> None:
    sensor = tsai.Sensor(ncx=576, nfx=576, dx_mm=0.023, dy_mm=0.023, cx=258, cy=204)
    for name, title in (("cc_cd.dat", "coplanar"), ("ncc_cd.dat", "in space")):
        table = np.loadtxt(data / "tsai" / "willson_3.0b3" / name)
        for full in (False, True):
            c = tsai.calibrate(table[:, :3], table[:, 3:], sensor=sensor, full=full)
            stages = "full" if full else "two-stage"
            found = f"f {c.f:.4f} mm  kappa1 {c.kappa1:.4e}  Tz {c.Tz:.2f} mm  SSE {c.sse_px2:.6f} px²"
            print(f"Tsai {title:9} {stages:9} {found}")


def tilted_boards(trials: int = 60) -> None:
    """f of a board of 10x10 points, 200 mm wide at 500 mm, f 8 mm, noise 0.1 px, by its tilt; principal point known.

    An error is so many pixels, so it grows with the pixel. How large that was, and which way the board was tilted,
    is not known of the floors (1.4, 0.40 and 0.08 % at 5, 10 and 30 degrees): hence several of each.
    """
    for pitch_mm in (0.005, 0.0065, 0.01):
        for about in ("x or y", "any axis"):
            columns = [tilted_row(tilt_deg, about, pitch_mm, trials) for tilt_deg in (0, 1, 2, 3, 5, 10, 30)]
            print(f"Tsai, pixel {1e3 * pitch_mm:g} um, tilt about {about}: " + "; ".join(columns))


def tilted_row(tilt_deg: int, about: str, pitch_mm: float, trials: int) -> str:
    sensor = tsai.Sensor(ncx=768, nfx=768, dx_mm=pitch_mm, dy_mm=pitch_mm, cx=384, cy=288)
    side = np.linspace(-100, 100, 10)
    world = np.column_stack([*(axis.ravel() for axis in np.meshgrid(side, side)), np.zeros(100)])
    errors: dict[bool, list[float]] = {False: [], True: []}
    refused = 0
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        direction = rng.uniform(0, 2 * math.pi) if about == "any axis" else math.pi / 2 * (seed % 2)
        axis = np.array([math.cos(direction), math.sin(direction), 0.0]) * math.radians(tilt_deg)
        points = world @ cv2.Rodrigues(axis)[0].T + [10.0, 15.0, 500.0]
        noise = rng.normal(0, 0.1, (100, 2))
        pixels = np.array([sensor.cx, sensor.cy]) + 8 / pitch_mm * points[:, :2] / points[:, 2:] + noise
        for full, list_of in errors.items():
            try:
                list_of.append(100 * abs(tsai.calibrate(world, pixels, sensor=sensor, full=full).f / 8 - 1))
            except ep.Error:
                refused += not full
    if refused == trials:
        return f"{tilt_deg} deg all refused"
    median = " / ".join(f"{np.median(e):.3f}" if e else "-" for e in errors.values())
    return f"{tilt_deg} deg {median} % ({refused} of {trials} refused)"


def any_start(data: Path, trials: int = 100) -> None:
    """The full optimum from starts up to 20 % off in every parameter."""
    sensor = tsai.Sensor(ncx=576, nfx=576, dx_mm=0.023, dy_mm=0.023, cx=258, cy=204)
    for name, title in (("cc_cd.dat", "coplanar"), ("ncc_cd.dat", "in space")):
        table = np.loadtxt(data / "tsai" / "willson_3.0b3" / name)
        best = tsai.calibrate(table[:, :3], table[:, 3:], sensor=sensor)
        rng = np.random.default_rng(1)
        names = ["f", "kappa1", "Cx", "Cy", "Tx", "Ty", "Tz", "Rx", "Ry", "Rz", *([] if best.coplanar else ["sx"])]
        worst, reached = 0.0, 0
        for _ in range(trials):
            start = replace(best, **{n: getattr(best, n) * rng.uniform(0.8, 1.2) for n in names})
            try:
                sse_px2 = tsai.calibrate(table[:, :3], table[:, 3:], sensor=sensor, start=start).sse_px2
            except ep.Error:
                continue
            worst = max(worst, sse_px2)
            reached += sse_px2 < best.sse_px2 * (1 + 1e-6)
        print(f"Tsai {title:9} from {trials} starts within 20 %: {reached} at the optimum, worst SSE {worst:.6f} px²")


def tsai_figures(data: Path) -> None:
    willson(data)
    any_start(data)
    tilted_boards()


PARTS: dict[str, Callable[[Path], None]] = {
    "rigs": real_rigs,
    "corners": own_corners,
    "charuco": charuco,
    "stereopi": stereopi,
    "speed": speed,
    "twin": synthetic_twin,
    "sigma": honest_sigma,
    "tsai": tsai_figures,
}


def main() -> None:
    default = os.environ.get("EPILINE_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("data", type=Path, nargs="?", default=Path(default))
    parser.add_argument("--only", nargs="+", choices=PARTS, default=list(PARTS))
    arguments = parser.parse_args()
    for part in arguments.only:
        PARTS[part](arguments.data)


if __name__ == "__main__":
    main()
