"""Sources that are images in files: pairs of files, and files with both views side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from epiline._images import read_image, size_of
from epiline.sources.base import Frame, Image, Source
from epiline.sources.pairing import ImagePair, Pairing


class _Item(NamedTuple):
    path: Path
    name: str
    read: Callable[[], tuple[Image, Image]]


class _ImageFiles(Source):
    """A frame per item; all have the size of the first."""

    def __init__(self, items: Sequence[_Item], kind: str) -> None:
        if not items:
            raise ValueError(f"no {kind}")
        self._items = tuple(items)
        left, _ = self._items[0].read()
        self._size = size_of(left)

    @property
    def size(self) -> tuple[int, int]:
        return self._size

    @property
    def length(self) -> int:
        return len(self._items)

    def __iter__(self) -> Iterator[Frame]:
        for seq, item in enumerate(self._items):
            left, right = item.read()
            check_same_size(size_of(left), self._size, item.path, self._items[0].path)
            yield Frame(left, right, seq, None, None, item.name)


class ImagePairs(_ImageFiles):
    """Pairs of image files.

    Parameters
    ----------
    pairing : Pairing
        At least one pair; images without a partner are no frames, and kept for who can use them.
    """

    def __init__(self, pairing: Pairing) -> None:
        self.pairing = pairing
        self.pairs = pairing.pairs
        items = [_Item(pair.left, pair.name, partial(_read_pair, pair)) for pair in pairing.pairs]
        super().__init__(items, "image pairs")


class SideBySideImages(_ImageFiles):
    """Images that hold the left view in their left half and the right view in their right half."""

    def __init__(self, files: Sequence[Path]) -> None:
        self.files = tuple(files)
        super().__init__([_Item(file, file.stem, partial(_read_halves, file)) for file in files], "images")


def split_side_by_side(image: Image, path: Path) -> tuple[Image, Image]:
    """The left and the right half; raises ValueError for an odd width."""
    width = image.shape[1]
    if width % 2:
        raise ValueError(f"{path}: {width} px wide: a side-by-side image has an even width")
    return image[:, : width // 2].copy(), image[:, width // 2 :].copy()


def check_same_size(size: tuple[int, int], expected: tuple[int, int], path: Path, expected_path: Path) -> None:
    """Raises ValueError, naming both files, where the sizes differ."""
    if size != expected:
        raise ValueError(
            f"sizes differ: {path} is {size[0]}x{size[1]} px, {expected_path} is {expected[0]}x{expected[1]} px"
        )


def _read_halves(file: Path) -> tuple[Image, Image]:
    return split_side_by_side(read_image(file), file)


def _read_pair(pair: ImagePair) -> tuple[Image, Image]:
    left, right = read_image(pair.left), read_image(pair.right)
    check_same_size(size_of(right), size_of(left), pair.right, pair.left)
    if left.ndim != right.ndim:
        # One grey and one colour file are still a pair; the grey one is spread over three channels.
        left, right = (read_image(path, channels="bgr") for path in (pair.left, pair.right))
    return left, right
