"""Frame results as JSON lines: one object a line, NaN as null."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Protocol, TextIO

from epiline._core import FrameResult, Obstacle, RegionProfile
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
        "regions": [region_record(profile) for profile in result.profiles],
        "obstacles": [obstacle_record(obstacle) for obstacle in result.obstacles],
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
    for name in ("range_m", "depth_m", "sigma_m", "bearing_rad", "width_m", "height_m"):
        record[name] = getattr(obstacle, name)
    record["support"] = obstacle.support
    return finite(record)
