"""Where the camera goes: a smooth curve through way-points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from epiline.sources.rendered.camera import Floats, world_from_optical


@dataclass(frozen=True)
class Waypoint:
    """Where the left camera is at a moment, and where it looks; angles as in `world_from_optical`."""

    time_s: float
    position_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0


class CameraPath:
    """Cubic Hermite curve through at least two way-points in order of time (slopes as Catmull and Rom 1974)."""

    def __init__(self, waypoints: Sequence[Waypoint]) -> None:
        if len(waypoints) < 2:
            raise ValueError(f"a path needs two way-points, not {len(waypoints)}")
        self._times = np.array([point.time_s for point in waypoints])
        if (np.diff(self._times) <= 0).any():
            raise ValueError("the times of a path's way-points must increase")
        self._values = np.array(
            [[*point.position_m, point.yaw_rad, point.pitch_rad, point.roll_rad] for point in waypoints]
        )
        self._slopes = np.gradient(self._values, self._times, axis=0)

    @property
    def duration_s(self) -> float:
        """From the first way-point to the last."""
        return float(self._times[-1] - self._times[0])

    def world_from_left(self, elapsed_s: float) -> Floats:
        """Pose (4, 4) of the left camera, seconds after the first way-point; it stands still beyond both ends."""
        time = float(np.clip(self._times[0] + elapsed_s, self._times[0], self._times[-1]))
        i = int(np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._times) - 2))
        step = self._times[i + 1] - self._times[i]
        t = (time - self._times[i]) / step
        value = (
            (1 + 2 * t) * (1 - t) ** 2 * self._values[i]
            + t * (1 - t) ** 2 * step * self._slopes[i]
            + t * t * (3 - 2 * t) * self._values[i + 1]
            + t * t * (t - 1) * step * self._slopes[i + 1]
        )
        return world_from_optical(value[:3], *value[3:])


def drive_ahead() -> CameraPath:
    """The demo's drive: four seconds, 0.8 m ahead with a gentle swerve, the eye half a metre above the floor."""
    return CameraPath(
        [
            Waypoint(0.0, (0.00, 0.00, 0.50), 0.00, 0.004, 0.000),
            Waypoint(1.0, (0.18, 0.03, 0.50), 0.05, 0.007, 0.004),
            Waypoint(2.0, (0.39, 0.08, 0.50), 0.03, 0.002, -0.003),
            Waypoint(3.0, (0.60, 0.09, 0.50), -0.03, 0.006, 0.002),
            Waypoint(4.0, (0.80, 0.06, 0.50), -0.05, 0.004, 0.000),
        ]
    )
