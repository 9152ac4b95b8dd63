"""Sources that are images in files: pairs of files, and files with both views side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from epiline._images import read_image, size_of
from epiline.sources.base import Frame, Image, Source
from epiline.sources.pairing import ImagePair


class ImagePairs(Source):
    """Pairs of image files.

    Parameters
    ----------
    pairs : sequence of ImagePair
        At least one.
    unpaired : sequence of Path
        Images of the same place that were left out, kept for a report.
    """

    def __init__(self, pairs: Sequence[ImagePair], *, unpaired: Sequence[Path] = ()) -> None:
        if not pairs:
            raise ValueError("no image pairs")
        self.pairs = tuple(pairs)
        self.unpaired = tuple(unpaired)
        left, _ = _read_pair(self.pairs[0])
        self._size = size_of(left)

    @property
    def size(self) -> tuple[int, int]:
        return self._size

    @property
    def length(self) -> int:
        return len(self.pairs)

    def __iter__(self) -> Iterator[Frame]:
        for seq, pair in enumerate(self.pairs):
            left, right = _read_pair(pair)
            check_same_size(size_of(left), self._size, pair.left, self.pairs[0].left)
            yield Frame(left, right, seq, None, None, pair.name)


class SideBySideImages(Source):
    """Images that hold the left view in their left half and the right view in their right half."""

    def __init__(self, files: Sequence[Path]) -> None:
        if not files:
            raise ValueError("no images")
        self.files = tuple(files)
        left, _ = split_side_by_side(read_image(self.files[0]), self.files[0])
        self._size = size_of(left)

    @property
    def size(self) -> tuple[int, int]:
        return self._size

    @property
    def length(self) -> int:
        return len(self.files)

    def __iter__(self) -> Iterator[Frame]:
        for seq, file in enumerate(self.files):
            left, right = split_side_by_side(read_image(file), file)
            check_same_size(size_of(left), self._size, file, self.files[0])
            yield Frame(left, right, seq, None, None, file.stem)


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


def _read_pair(pair: ImagePair) -> tuple[Image, Image]:
    left, right = read_image(pair.left), read_image(pair.right)
    check_same_size(size_of(right), size_of(left), pair.right, pair.left)
    if left.ndim != right.ndim:
        # One grey and one colour file are still a pair; the grey one is spread over three channels.
        left, right = (read_image(path, channels="bgr") for path in (pair.left, pair.right))
    return left, right
