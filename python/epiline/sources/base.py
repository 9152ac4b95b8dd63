"""What every source of stereo pairs gives: frames, a size, and a way to close it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from typing_extensions import Self

Image: TypeAlias = NDArray[np.uint8]


@dataclass(frozen=True)
class Frame:
    """One stereo pair as the cameras took it.

    Attributes
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        The images; three channels are blue, green, red.
    seq : int
        Number of the frame in its source, from 0.
    left_stamp_nanos, right_stamp_nanos : int or None
        When each image was taken, nanoseconds on the source's clock; None where the source does not say.
    name : str
        What a person calls this frame: a file name, a frame number.
    """

    left: Image
    right: Image
    seq: int
    left_stamp_nanos: int | None
    right_stamp_nanos: int | None
    name: str


class Source(Protocol):
    """Stereo pairs, one after the other.

    A class that inherits from it gets ``close``, ``len()`` and the context manager. Iterating again starts again
    where the source can be rewound (files, rendered rig).
    """

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of every image, pixels."""
        ...

    @property
    def length(self) -> int | None:
        """How many frames there are; None where nobody knows (cameras, some videos)."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """Yields frames; raises OSError for an unreadable file and ValueError for a pair that does not fit."""
        ...

    def __len__(self) -> int:
        if self.length is None:
            raise TypeError("the number of frames of this source is not known")
        return self.length

    def __bool__(self) -> bool:
        # Without this, `if source` would ask for a length that may not be known.
        return True

    def close(self) -> None:
        """Frees files and devices; the source is not used afterwards."""
        return

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
