"""The ground over a drive: the pose it gives the camera, against the truth of a course or against itself on a car."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from epiline._core import DisparityMap, GroundEstimator, GroundPlane, RectifiedGeometry, StereoMatcher, grey
from epiline._images import read_image
from epiline.evaluation.obstacles.own_motion import nod_rad

Floats = NDArray[np.float64]

# What the public recording's calib.txt says of its aligned, cropped images (P1_roi, P2_roi).
_FIRST, _SECOND = "P1_roi", "P2_roi"
CAR_DISPARITIES = 128


@dataclass(frozen=True)
class GroundRun:
    """The ground of each frame; NaN where there is none.

    Attributes
    ----------
    camera_height_m, pitch_rad, roll_rad : (N,) float64
    turned_down_rad : (N,) float64, optional
        How far the camera had turned down since the first frame, told without the ground.
    """

    camera_height_m: Floats
    pitch_rad: Floats
    roll_rad: Floats
    turned_down_rad: Floats | None = None

    @classmethod
    def of(cls, grounds: Sequence[GroundPlane | None], turned_down_rad: Floats | None = None) -> GroundRun:
        """From the grounds of a run's frames."""
        rows = [
            (float("nan"),) * 3 if ground is None else (ground.camera_height_m, ground.pitch_rad, ground.roll_rad)
            for ground in grounds
        ]
        height, pitch, roll = np.array(rows, float).reshape(-1, 3).T
        return cls(height, pitch, roll, turned_down_rad)

    def steadiness(self) -> dict[str, float]:
        """How far frames are from the run's median: height in percent of it, angles in degrees.

        A vehicle nods, and a pitch that is right nods with it: `pitch_less_nod` is the pitch less the camera's own
        turns and less the road's own slope, a cubic over the run. What is left is the ground's noise.
        """
        found = np.isfinite(self.camera_height_m)
        figures = {"frames": float(found.size), "found": 100 * float(found.mean()) if found.size else float("nan")}
        if not found.any():
            return figures
        height_m = float(np.median(self.camera_height_m[found]))
        figures["camera_height_m"] = height_m
        off = {
            "height_off": 100 * np.abs(self.camera_height_m[found] / height_m - 1),
            "pitch_off": np.rad2deg(np.abs(self.pitch_rad[found] - np.median(self.pitch_rad[found]))),
            "roll_off": np.rad2deg(np.abs(self.roll_rad[found] - np.median(self.roll_rad[found]))),
        }
        if self.turned_down_rad is not None:
            off["pitch_less_nod_off"] = np.rad2deg(np.abs(self._pitch_less_nod(found)))
        for name, values in off.items():
            figures[f"{name}_median"] = float(np.median(values))
            figures[f"{name}_p90"] = float(np.percentile(values, 90))
            figures[f"{name}_worst"] = float(values.max())
        return figures

    def _pitch_less_nod(self, found: NDArray[np.bool_]) -> Floats:
        """Radians, of the frames where a ground was found, about its own median."""
        assert self.turned_down_rad is not None
        frames = np.linspace(-1.0, 1.0, found.size)[found]
        left = (self.pitch_rad - self.turned_down_rad)[found]
        left = left - np.polynomial.Polynomial.fit(frames, left, min(3, left.size - 1), domain=[-1, 1])(frames)
        return np.asarray(left - np.median(left), float)


def is_car_sequence(folder: Path) -> bool:
    """Whether a folder is laid out as the Karlsruhe sequences are: ``left``, ``right``, ``calib.txt``."""
    return all((folder / name).exists() for name in ("left", "right", "calib.txt"))


def car_geometry(folder: Path, size: tuple[int, int]) -> RectifiedGeometry:
    """The aligned geometry of ``calib.txt``; ValueError where it is not what it should be."""
    file = folder / "calib.txt"
    lines = (line.partition(":") for line in file.read_text(encoding="utf-8").splitlines())
    try:
        found = {name: np.array(values.split(), float) for name, _, values in lines if name in (_FIRST, _SECOND)}
        first, second = (found[name].reshape(3, 4) for name in (_FIRST, _SECOND))
    except (KeyError, ValueError) as error:
        raise ValueError(f"{file}: no {_FIRST} and {_SECOND} of twelve numbers each ({error})") from error
    return RectifiedGeometry(
        width=size[0],
        height=size[1],
        focal_px=float(first[0, 0]),
        cx_px=float(first[0, 2]),
        cy_px=float(first[1, 2]),
        baseline_m=float(-second[0, 3] / second[0, 0]),
    )


def car_run(folder: Path, preset: str, threads: int | None, advance: Callable[[], object] = lambda: None) -> GroundRun:
    """The ground of each frame of a car's drive, followed from frame to frame, and how the car nodded.

    `advance` is called after each frame.
    """
    matcher = StereoMatcher(preset=preset, num_disparities=CAR_DISPARITIES, threads=threads)  # type: ignore[arg-type]
    estimator = GroundEstimator()
    grounds: list[GroundPlane | None] = []
    nods_rad: list[float] = []
    before: tuple[NDArray[np.uint8], DisparityMap] | None = None
    for left_path in sorted((folder / "left").glob("*.png")):
        left, right = read_image(left_path), read_image(folder / "right" / left_path.name)
        geometry = car_geometry(folder, (left.shape[1], left.shape[0]))
        disparity = matcher(left, right)
        grounds.append(estimator(disparity, geometry))
        left = np.asarray(grey(left), np.uint8)
        nods_rad.append(0.0 if before is None else nod_rad(before[0], left, before[1], geometry))
        before = left, disparity
        advance()
    # Where too little is seen to tell, the camera is taken to have kept its pitch.
    return GroundRun.of(grounds, np.cumsum(np.nan_to_num(nods_rad)))


@dataclass(frozen=True)
class GroundSample:
    """One frame of a course: found minus true height, metres, pitch and roll, radians; NaN where none was found.

    Attributes
    ----------
    sigmas : (height m, pitch rad, roll rad)
        Standard deviations of the three as the ground states them.
    """

    true_height_m: float
    height_m: float = float("nan")
    pitch_rad: float = float("nan")
    roll_rad: float = float("nan")
    sigmas: tuple[float, float, float] = (float("nan"),) * 3


def ground_sample(found: GroundPlane | None, world_from_aligned: Floats) -> GroundSample:
    """The ground that was found beside the floor z = 0 of the world."""
    down = world_from_aligned[:3, :3].T @ np.array([0.0, 0.0, -1.0])
    height_m = float(world_from_aligned[2, 3])
    if found is None:
        return GroundSample(height_m)
    pitch, roll = (np.arcsin(down[2]), np.arctan2(down[0], down[1]))
    return GroundSample(
        height_m,
        found.camera_height_m - height_m,
        float(found.pitch_rad - pitch),
        float(found.roll_rad - roll),
        (found.camera_height_sigma_m, found.pitch_sigma_rad, found.roll_sigma_rad),
    )


def ground_figures(samples: Sequence[GroundSample]) -> dict[str, float]:
    """Share of frames with a ground, bias and 95th percentile of its errors (percent of the height, degrees), and the
    shares, percent, within one and two of the standard deviations it states."""
    found = [sample for sample in samples if np.isfinite(sample.height_m)]
    nothing = float("nan")
    share = 100 * len(found) / len(samples) if samples else nothing
    errors = {
        "height": [100 * sample.height_m / sample.true_height_m for sample in found],
        "pitch": [float(np.rad2deg(sample.pitch_rad)) for sample in found],
        "roll": [float(np.rad2deg(sample.roll_rad)) for sample in found],
    }
    off_by = np.abs([(sample.height_m, sample.pitch_rad, sample.roll_rad) for sample in found]).reshape(-1, 3)
    off_sigmas = off_by / np.array([sample.sigmas for sample in found]).reshape(-1, 3)
    figures = {"ground_found": share}
    for (name, values), sigmas in zip(errors.items(), off_sigmas.T, strict=True):
        figures[f"{name}_bias"] = float(np.mean(values)) if values else nothing
        figures[f"{name}_p95"] = float(np.percentile(np.abs(values), 95)) if values else nothing
        for within in (1, 2):
            figures[f"{name}_within_{within}"] = 100 * float(np.mean(sigmas <= within)) if values else nothing
    return figures
