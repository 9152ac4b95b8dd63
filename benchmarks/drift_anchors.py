"""Drift of real rigs whose right camera is turned by a known angle, and what watching a rig costs.

The photographs of the right camera are warped by the exact rotation, through the lens where they are raw: what the
camera would have seen, had it been turned about its own centre. Parts `drift` and `cost` of `align_anchors.py`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import cv2
import numpy as np

import epiline as ep
from epiline.evaluation import load_scenes

Array = np.ndarray
Pair = tuple[Array, Array]

AXES = ("pitch", "yaw", "roll")
TURN_DEG = 0.05
MOST_FRAMES = 10


@dataclass(frozen=True)
class Rig:
    """Pairs of a rig that holds: the first half tells how it holds, the second is turned.

    Without a calibration the pairs came aligned and `camera_matrix` is that of both aligned views.
    """

    name: str
    pairs: Sequence[Pair]
    calibration: ep.StereoCalibration | None = None
    geometry: ep.RectifiedGeometry | None = None

    @cached_property
    def rectifier(self) -> ep.Rectifier | None:
        return None if self.calibration is None else ep.Rectifier(self.calibration)

    def align(self, pair: Pair) -> ep.AlignmentError:
        if self.rectifier is None:
            return ep.alignment_error(*pair)
        aligned = self.rectifier(*pair)
        return ep.alignment_error(
            aligned.left, aligned.right, left_valid=aligned.left_valid, right_valid=aligned.right_valid
        )

    def turned(self, axis: str, degrees: float) -> Iterator[Pair]:
        """The second half's pairs, the right camera turned right-handed about an axis of its own."""
        vector = np.zeros(3)
        vector[AXES.index(axis)] = np.radians(degrees)
        turn, _ = cv2.Rodrigues(vector)
        if self.calibration is None:
            assert self.geometry is not None
            g = self.geometry
            K = np.array([[g.focal_px, 0, g.cx_px + g.doffs_px], [0, g.focal_px, g.cy_px], [0, 0, 1]])
            distortion = np.zeros(5)
        else:
            K, distortion = self.calibration.right.camera_matrix, self.calibration.right.distortion
        for left, right in self.pairs[len(self.pairs) // 2 :][:MOST_FRAMES]:
            height, width = right.shape
            pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 1, 2).astype(float)
            rays = cv2.undistortPoints(
                pixels, K, distortion, criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
            )
            # A ray of the turned camera is this one of the camera as it was.
            before = np.column_stack([rays[:, 0], np.ones(len(rays))]) @ turn.T
            source, _ = cv2.projectPoints(before, np.zeros(3), np.zeros(3), K, distortion)
            maps = source.reshape(height, width, 2).astype(np.float32)
            yield left, cv2.remap(right, maps, None, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)


def grey(path: Path) -> Array:
    return cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)


def calibrated(
    name: str, left: list[Path], right: list[Path], board: ep.Chessboard, pairs: list[Pair] | None = None
) -> Rig:
    """A rig calibrated from every other board view, or all where `pairs` are others; judged on `pairs`."""
    views = slice(None) if pairs else slice(None, None, 2)
    observations = ep.find_boards(left[views], right[views], board)
    calibration = ep.calibrate(observations, held_out=False)
    own = [(grey(a), grey(b)) for a, b in zip(left[1::2], right[1::2], strict=True)]
    return Rig(name, pairs or own, calibration)


def real_rigs(data: Path) -> Iterator[Rig]:
    drive = data / "karlsruhe_2010_03_09_drive_0023"
    sides = [sorted((drive / side).glob("*.png")) for side in ("left", "right")]
    pairs = [(grey(a), grey(b)) for a, b in zip(*sides, strict=True)]
    height, width = pairs[0][0].shape
    numbers = dict(line.split(":", 1) for line in (drive / "calib.txt").read_text().splitlines() if ":" in line)
    P = np.array(numbers["P2_roi"].split(), float).reshape(3, 4)
    geometry = ep.RectifiedGeometry(
        width=width, height=height, focal_px=P[0, 0], cx_px=P[0, 2], cy_px=P[1, 2], baseline_m=-P[0, 3] / P[0, 0]
    )
    yield Rig("karlsruhe, frames 0-19 and 20-29", pairs, geometry=geometry)
    # Frames that have nothing but the camera in common.
    apart = pairs[:20:2] + pairs[20::2]
    yield Rig("karlsruhe, every other frame", apart, geometry=geometry)

    calib = data / "calib"

    def boards(folder: str, pattern: str) -> tuple[list[Path], list[Path]]:
        left, right = (sorted((calib / folder).glob(pattern.format(side))) for side in ("left", "right"))
        return left, right

    scenes = data / "scenes_unrectified" / "boofcv_bumblebee2"
    sides = [sorted(scenes.glob(f"*_{side}.jpg")) for side in ("left", "right")]
    raw = [(grey(a), grey(b)) for a, b in zip(*sides, strict=True)]
    views = boards("boofcv_Bumblebee2_Chess", "{}[0-9][0-9].jpg")
    chess = ep.Chessboard(columns=6, rows=4, square_m=0.03)
    yield calibrated("bumblebee2, scenes", *views, chess, raw)
    chess = ep.Chessboard(columns=9, rows=6, square_m=0.025)
    yield calibrated("bouguet, board views", *boards("opencv_bouguet", "{}[0-9][0-9].jpg"), chess)
    yield calibrated("stereopi, board views", *boards("stereopi/pairs", "{}_*.png"), chess)


def score_drift(data: Path) -> None:
    """Against a reference from other pairs of the rig, and against the calibration alone."""
    print(f"\nright camera turned by {TURN_DEG} degrees; seen: pairs until the axis is named and stays named")
    told: dict[tuple[bool, str], list[tuple[bool, float]]] = {}
    for rig in real_rigs(data):
        half = len(rig.pairs) // 2
        held = [rig.align(pair) for pair in rig.pairs[:half]]
        geometry = rig.geometry if rig.rectifier is None else rig.rectifier.geometry
        assert geometry is not None
        reference = ep.measure_drift(geometry, held, calibration=rig.calibration)
        still = [rig.align(pair) for pair in rig.pairs[half:][:MOST_FRAMES]]
        for title, chosen in (("since a reference", reference), ("since calibration", None)):
            options = {"calibration": rig.calibration, "reference": chosen}
            unmoved = [ep.measure_drift(geometry, still[: n + 1], **options) for n in range(len(still))]
            false = [drift.axis for drift in unmoved if drift.axis]
            print(f"  {rig.name}, {title}: not turned, named {', '.join(map(str, false)) or 'never'}  {unmoved[-1]}")
            for axis in AXES:
                for degrees in (TURN_DEG, -TURN_DEG):
                    residuals = [rig.align(pair) for pair in rig.turned(axis, degrees)]
                    drifts = [ep.measure_drift(geometry, residuals[: n + 1], **options) for n in range(len(residuals))]
                    named = [drift.axis == axis for drift in drifts]
                    seen = next((n + 1 for n in range(len(named)) if all(named[n:])), None)
                    last = drifts[-1]
                    amount = last.values[axis] / np.radians(degrees)
                    told.setdefault((chosen is not None, axis), []).append((last.axis == axis, amount))
                    sigma = np.degrees(last.sigma[axis])
                    print(
                        f"    {axis:5} {degrees:+.2f}: named {last.axis!s:5} after {seen or '-':>2} of {len(drifts)}"
                        f"  amount {100 * amount:5.1f} %  sigma {sigma:.4f} degrees"
                    )
    for (with_reference, axis), results in told.items():
        named = [amount for right, amount in results if right]
        off = np.abs(np.array([amount for _, amount in results]) - 1)
        print(
            f"  => {axis:5} since {'a reference' if with_reference else 'calibration'}: axis right {len(named)}/"
            f"{len(results)}, amount within 10 % {np.sum(off < 0.1)}, within 20 % {np.sum(off < 0.2)}"
            f", worst {100 * off.max():.0f} %"
        )


def score_cost(data: Path) -> None:
    """`alignment_error` against `match(preset="fast")` at 640x480x64 in turns, one thread, by its own clock."""
    print("\nalignment_error against match, preset fast, 640x480x64, one thread")
    shares: dict[int, list[float]] = {64: [], 192: []}
    for scene in load_scenes(data):
        left, right = (
            cv2.resize(ep.grey(np.ascontiguousarray(i)), (640, 480), interpolation=cv2.INTER_AREA)
            for i in (scene.left, scene.right)
        )
        matcher = ep.StereoMatcher(preset="fast", num_disparities=64, threads=1)
        works: list[Callable[[], object]] = [partial(matcher, left, right, out=matcher(left, right))]
        works += [partial(ep.alignment_error, left, right, num_disparities=d) for d in shares]
        taken = np.zeros((15, len(works)))
        for turn in taken:
            for i, work in enumerate(works):
                begin = time.thread_time()
                work()
                turn[i] = time.thread_time() - begin
        share = np.median(taken[1:, 1:] / taken[1:, :1], axis=0)
        for disparities, value in zip(shares, share, strict=True):
            shares[disparities].append(float(value))
        milliseconds = 1e3 * np.median(taken[1:], axis=0)
        print(
            f"  {scene.name:28} fast {milliseconds[0]:5.2f} ms, alignment_error {milliseconds[1]:5.3f} ms for 64"
            f" disparities, {milliseconds[2]:5.3f} for 192: {100 * share[0]:4.1f} and {100 * share[1]:4.1f} %"
        )
    for disparities, values in shares.items():
        print(
            f"  => {disparities} disparities: median {100 * np.median(values):.1f} %, worst {100 * max(values):.1f} %"
        )
