"""Sources that are video files: two of them, or one with both views side by side."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from epiline._images import size_of
from epiline.sources.base import Frame, Image, Source
from epiline.sources.files import check_same_size, split_side_by_side

VIDEO_SUFFIXES = frozenset({".avi", ".m4v", ".mjpeg", ".mjpg", ".mkv", ".mov", ".mp4", ".mpg", ".webm"})


class TwoVideos(Source):
    """A video of each camera, frame by frame.

    Raises OSError where a file cannot be opened, ValueError where the two differ in size or number of frames.
    """

    def __init__(self, left: Path, right: Path) -> None:
        self._left, self._right = _Video(left), _Video(right)
        check_same_size(self._right.size, self._left.size, right, left)
        if None not in (self._left.frames, self._right.frames) and self._left.frames != self._right.frames:
            raise ValueError(f"lengths differ: {left} has {self._left.frames} frames, {right} has {self._right.frames}")

    @property
    def size(self) -> tuple[int, int]:
        return self._left.size

    @property
    def length(self) -> int | None:
        return self._left.frames

    def __iter__(self) -> Iterator[Frame]:
        self._left.rewind()
        self._right.rewind()
        seq = 0
        while True:
            left, right = self._left.read(), self._right.read()
            if left is None and right is None:
                return
            if left is None or right is None:
                ended = self._left if left is None else self._right
                raise ValueError(f"lengths differ: {ended.path} ends after {seq} frames, its partner goes on")
            yield Frame(left[0], right[0], seq, left[1], right[1], f"{self._left.path.stem} {seq}")
            seq += 1

    def close(self) -> None:
        self._left.close()
        self._right.close()


class SideBySideVideo(Source):
    """One video that holds the left view in its left half and the right view in its right half."""

    def __init__(self, path: Path) -> None:
        self._video = _Video(path)
        if self._video.size[0] % 2:
            raise ValueError(f"{path}: {self._video.size[0]} px wide: a side-by-side video has an even width")

    @property
    def size(self) -> tuple[int, int]:
        return self._video.size[0] // 2, self._video.size[1]

    @property
    def length(self) -> int | None:
        return self._video.frames

    def __iter__(self) -> Iterator[Frame]:
        self._video.rewind()
        seq = 0
        while (read := self._video.read()) is not None:
            left, right = split_side_by_side(read[0], self._video.path)
            yield Frame(left, right, seq, read[1], read[1], f"{self._video.path.stem} {seq}")
            seq += 1

    def close(self) -> None:
        self._video.close()


class _Video:
    """A video file opened with OpenCV, read in order."""

    def __init__(self, path: Path) -> None:
        if not path.is_file():
            raise FileNotFoundError(f"{path}: no such video")
        self.path = path
        self._capture = self._open()
        self._at_start = True
        first = self.read()
        if first is None:
            self.close()
            raise OSError(f"{path}: no frame can be read")
        self.size = size_of(first[0])
        self.rewind()

    @property
    def frames(self) -> int | None:
        """Number of frames by the container's own account."""
        import cv2

        count = int(self._capture.get(cv2.CAP_PROP_FRAME_COUNT))
        return count if count > 0 else None

    def read(self) -> tuple[Image, int] | None:
        """The next image and its stamp, nanoseconds from the start; None at the end."""
        import cv2

        self._at_start = False
        ok, image = self._capture.read()
        if not ok:
            return None
        return image, round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)

    def rewind(self) -> None:
        # Opening again is exact; seeking lands on a key frame in some containers.
        if not self._at_start:
            self._capture.release()
            self._capture = self._open()
            self._at_start = True

    def close(self) -> None:
        self._capture.release()

    def _open(self) -> Any:
        import cv2

        capture = cv2.VideoCapture(str(self.path))
        if not capture.isOpened():
            raise OSError(f"{self.path}: cannot be opened as a video")
        # Pixels as stored: a lens is calibrated on the sensor's pixels.
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        return capture
