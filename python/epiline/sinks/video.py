"""Pictures of a run, frame by frame: as a video file, or as files in a folder."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline.sinks.pictures import write_picture

Image: TypeAlias = NDArray[np.uint8]

_CODECS = {".mp4": "mp4v", ".avi": "MJPG", ".mkv": "mp4v"}


class PictureSink(Protocol):
    """Takes the pictures of a run in their order."""

    def add(self, name: str, picture: Image) -> None:
        """The next one; (H, W, 3) uint8, of the size of the first."""
        ...


class PictureFolder:
    """A PNG per frame in a folder, which is made if it is not there."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._count = folder, 0

    def add(self, name: str, picture: Image) -> None:
        """Writes `NUMBER-NAME.png`."""
        stem = "".join(c if c.isalnum() or c in "-_" else "-" for c in Path(name).stem)
        write_picture(self._folder / f"{self._count:05}-{stem}.png", picture)
        self._count += 1


class VideoFile:
    """A video file, which takes its name when it is whole; see `open`."""

    def __init__(self, path: Path, frames_per_second: float, codec: str) -> None:
        self._path, self._rate, self._codec = path, frames_per_second, codec
        self._writer: cv2.VideoWriter | None = None

    @classmethod
    @contextmanager
    def open(cls, path: Path, frames_per_second: float) -> Iterator[VideoFile]:
        """A file of the format its name ends with: .mp4, .avi or .mkv.

        Raises
        ------
        ValueError
            Another ending.
        OSError
            The file cannot be written, or OpenCV cannot encode it here.
        """
        codec = _CODECS.get(path.suffix.lower())
        if codec is None:
            raise ValueError(f"{path}: '{path.suffix}' is no video format; use {', '.join(_CODECS)}")
        if not path.resolve().parent.is_dir():
            raise FileNotFoundError(2, "the folder of the video does not exist", str(path.parent))
        # OpenCV chooses the container by the ending.
        temporary = path.with_name(f".{path.stem}.{os.getpid()}.tmp{path.suffix}")
        video = cls(temporary, frames_per_second, codec)
        try:
            yield video
        finally:
            video.close()
            # Frames written before an interruption, as a live run ends by one, are whole and worth keeping.
            if temporary.exists():
                temporary.replace(path)

    def add(self, name: str, picture: Image) -> None:
        """The next frame; `name` is not shown."""
        height, width = picture.shape[:2]
        if self._writer is None:
            code = cv2.VideoWriter.fourcc(*self._codec)
            self._writer = cv2.VideoWriter(str(self._path), code, self._rate, (width, height))
            if not self._writer.isOpened():
                raise OSError(5, f"OpenCV cannot write {self._codec} video here", str(self._path))
        self._writer.write(picture)

    def close(self) -> None:
        """Ends the file."""
        if self._writer is not None:
            self._writer.release()
            self._writer = None
