"""Frame results as JSON lines: one object a line, NaN as null."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol, TextIO

import numpy as np

from epiline._core import FrameResult, GroundPlane, Obstacle, RegionProfile, Scan, Track
from epiline._json import finite


class FrameLike(Protocol):
    """What a line needs to know of the frame a result belongs to."""

    @property
    def seq(self) -> int: ...
    @property
    def name(self) -> str: ...
    @property
    def left_stamp_nanos(self) -> int | None: ...
    @property
    def right_stamp_nanos(self) -> int | None: ...


class JsonLines:
    """Writes a line per frame to a text stream, flushed: a reader at the other end of a pipe is not kept waiting."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    @classmethod
    @contextmanager
    def open(cls, path: Path) -> Iterator[JsonLines]:
        """Writes to a file that takes its name when the run ends, however it ends."""
        temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        try:
            stream = temporary.open("w", encoding="utf-8")
        except OSError as error:
            raise type(error)(error.errno, f"cannot be written: {error.strerror}", str(path)) from error
        try:
            with stream:
                yield cls(stream)
        finally:
            # Lines written before an interruption are whole and worth keeping.
            temporary.replace(path)

    def write(self, frame: FrameLike, result: FrameResult) -> None:
        """One line."""
        json.dump(frame_record(frame, result), self._stream, allow_nan=False)
        self._stream.write("\n")
        self._stream.flush()


def frame_record(frame: FrameLike, result: FrameResult) -> dict[str, Any]:
    """A frame's result as plain values; ranges in metres, angles in radians, times in milliseconds."""
    alignment = result.alignment
    record = {
        "seq": frame.seq,
        "name": frame.name,
        "left_stamp_nanos": frame.left_stamp_nanos,
        "right_stamp_nanos": frame.right_stamp_nanos,
        "valid_share": result.disparity.density,
        "alignment": None
        if alignment is None
        else {
            "median_px": alignment.median_px,
            "spread_px": alignment.spread_px,
            "matches": alignment.matches,
        },
        "ground": ground_record(result.ground, result.ground_reason),
        "regions": [region_record(profile) for profile in result.profiles],
        "obstacles": [obstacle_record(obstacle) for obstacle in result.obstacles],
        "tracks": [track_record(track) for track in result.tracks],
        "scan": None if result.scan is None else scan_record(result.scan),
        "stage_ms": result.stage_ms,
    }
    return finite(record)


def region_record(profile: RegionProfile) -> dict[str, Any]:
    """A region's figures without its columns."""
    region = profile.region
    record = {
        "name": region.name,
        "box": [region.x, region.y, region.width, region.height],
        "valid_share": profile.valid_share,
        "minimum_px": profile.minimum,
        "maximum_px": profile.maximum,
        "total_px": profile.total,
        "range_m": profile.range_m,
        "sigma_m": profile.sigma_m,
    }
    return finite(record)


def obstacle_record(obstacle: Obstacle) -> dict[str, Any]:
    """Everything about an obstacle."""
    record: dict[str, Any] = {"id": obstacle.id, "region": obstacle.region, "box": list(obstacle.box)}
    record["regions"] = obstacle.regions
    for name in ("range_m", "depth_m", "sigma_m", "bearing_rad", "width_m", "height_m", "height_above_ground_m"):
        record[name] = getattr(obstacle, name)
    record["support"] = obstacle.support
    return finite(record)


def ground_record(ground: GroundPlane | None, reason: str | None) -> dict[str, Any]:
    """The camera's pose over the ground, or why there is none."""
    if ground is None:
        return {"reason": reason}
    names = ("camera_height_m", "pitch_rad", "roll_rad")
    record: dict[str, Any] = {name: getattr(ground, name) for name in names}
    for name in ("camera_height_sigma_m", "pitch_sigma_rad", "roll_sigma_rad", "support_share"):
        record[name] = getattr(ground, name)
    return finite(record)


def track_record(track: Track) -> dict[str, Any]:
    """Everything about a track but its covariance, of which the standard deviations stand for the whole."""
    sigmas = np.sqrt(np.diag(track.covariance))
    record = {
        "id": track.id,
        "confirmed": track.confirmed,
        "obstacle": track.obstacle,
        "box": list(track.box),
        "position_m": list(track.position_m),
        "position_sigma_m": [float(sigma) for sigma in sigmas[:2]],
        "velocity_mps": list(track.velocity_mps),
        "velocity_sigma_mps": [float(sigma) for sigma in sigmas[2:]],
    }
    for name in ("range_m", "sigma_m", "bearing_rad", "width_m", "height_m", "age_s", "hits", "misses"):
        record[name] = getattr(track, name)
    return finite(record)


def scan_record(scan: Scan) -> dict[str, Any]:
    """A scan at equal angles, counter-clockwise; distances in metres from `origin_m`, to the millimetre.

    ``seen`` has a letter per angle: ``o`` an obstacle, ``.`` nothing as far as was looked, ``?`` unknown. ``free_to_m``
    is null where nothing is known to be free, ``nearest_m`` where no obstacle is.
    """
    obstacles, free = scan.to_laser_scan(), scan.to_clearing_scan()
    ranges = obstacles["ranges"]
    free_to = np.where(np.isposinf(free["ranges"]), scan.max_range_m, free["ranges"])
    seen = np.select([np.isfinite(ranges), np.isposinf(ranges)], ["o", "."], "?")
    record = {
        "angle_min_rad": obstacles["angle_min"],
        "angle_increment_rad": obstacles["angle_increment"],
        "origin_m": list(scan.origin_m),
        "max_range_m": scan.max_range_m,
        "blind_m": scan.blind_m,
        "free_from_m": free["range_min"],
        "seen": "".join(seen),
        "nearest_m": [round(float(value), 3) for value in np.where(np.isfinite(ranges), ranges, np.nan)],
        "free_to_m": [round(float(value), 3) for value in free_to],
    }
    return finite(record)
