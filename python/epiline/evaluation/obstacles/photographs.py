"""A course's photographs, kept in a folder so that they are rendered once."""

from __future__ import annotations

import hashlib
import os
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from epiline._core import grey
from epiline.sources import rendered
from epiline.sources.rendered.courses import Course

Greys = NDArray[np.uint8]


@dataclass(frozen=True)
class Photograph:
    """A raw pair (H, W) uint8, the pose (4, 4) of the left camera in the world, and when it was there."""

    left: Greys
    right: Greys
    world_from_left: NDArray[np.float64]
    stamp_nanos: int


def photographs(course: Course, cache: Path | None = None) -> Iterator[Photograph]:
    """The frames of a course, from `cache` if they are there, else rendered and put there.

    Raises OSError where the folder cannot be written, ValueError where a file in it is broken.
    """
    duration_s, count = course.path.duration_s, course.frames
    moments_s = [duration_s * i / max(count - 1, 1) for i in range(count)]
    poses = [course.path.world_from_left(moment_s) for moment_s in moments_s]
    stamps = [round(1e9 * moment_s) for moment_s in moments_s]
    stored = None if cache is None else cache / f"{_digest(course)}.npz"
    if stored is not None and stored.is_file():
        for (left, right), pose, stamp in zip(_load(stored), poses, stamps, strict=True):
            yield Photograph(left, right, pose, stamp)
        return
    rig = course.rig()
    taken = []
    for number, (pose, stamp) in enumerate(zip(poses, stamps, strict=True)):
        left, right = (np.asarray(grey(image), np.uint8) for image in rig.photograph(pose, number=number))
        if stored is not None:
            taken.append((left, right))
        yield Photograph(left, right, pose, stamp)
    if stored is not None:
        stored.parent.mkdir(parents=True, exist_ok=True)
        draft = stored.with_suffix(f".{os.getpid()}.npz")
        np.savez(draft, pairs=np.array(taken))
        draft.replace(stored)


def _load(stored: Path) -> Greys:
    """Pairs (N, 2, H, W)."""
    try:
        with np.load(stored) as file:
            return np.asarray(file["pairs"], np.uint8)
    except (zipfile.BadZipFile, KeyError, ValueError) as error:
        raise ValueError(f"{stored}: not photographs kept by an earlier run ({error}); remove it") from error


def _digest(course: Course) -> str:
    """Changes with the course and with the renderer."""
    text = hashlib.sha256()
    for field in fields(course):
        if field.name != "path":
            text.update(f"{field.name}={getattr(course, field.name)!r};".encode())
    for moment in np.linspace(0, course.path.duration_s, 9):
        text.update(course.path.world_from_left(float(moment)).tobytes())
    for file in sorted(Path(rendered.__path__[0]).glob("*.py")):
        if file.name != "courses.py":
            text.update(file.read_bytes())
    return text.hexdigest()[:24]
