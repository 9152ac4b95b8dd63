"""Reads photographs, and says so when a file is not a whole photograph.

OpenCV returns a partly grey picture for some truncated files and prints to stderr for others; a grey area looks like
a textureless wall to a matcher, so completeness is checked here, on the bytes, before decoding.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from pathlib import Path
from typing import Literal, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

StrPath: TypeAlias = str | os.PathLike[str]

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pbm", ".pgm", ".png", ".pnm", ".ppm", ".tif", ".tiff", ".webp"})
MAX_SIDE_PX = 16384

_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"
_OTHERS = (b"BM", b"P1", b"P2", b"P3", b"P4", b"II*\0", b"MM\0*", b"RIFF")
_BINARY_PNM = (b"P5", b"P6")
# Magic, width, height, largest value; white space and comments between them, one white space before the pixels.
_PNM_HEADER = re.compile(rb"P([56])" + 3 * rb"(?:\s|#[^\n]*\n)+(\d{1,9})" + rb"\s")


def read_image(path: StrPath, *, channels: Literal["stored", "grey", "bgr"] = "stored") -> NDArray[np.uint8]:
    """One photograph from a file.

    Pixels come as stored: a rotation noted in EXIF is not applied, for a lens is calibrated on the sensor's pixels.
    More than 8 bits are scaled to 8; transparency is dropped.

    Parameters
    ----------
    path : path-like
        PNG, JPEG, BMP, TIFF, WebP or PNM.
    channels : {"stored", "grey", "bgr"}
        ``"stored"`` keeps a grey image grey and a colour image colour.

    Returns
    -------
    (H, W) or (H, W, 3) uint8
        Three channels are blue, green, red.

    Raises
    ------
    OSError
        The file cannot be read, is empty, truncated, damaged, or no image.
    ValueError
        A side is longer than 16384 px.
    """
    import cv2

    flags = {"stored": cv2.IMREAD_ANYCOLOR, "grey": cv2.IMREAD_GRAYSCALE, "bgr": cv2.IMREAD_COLOR}[channels]
    return cast("NDArray[np.uint8]", _decode(Path(path), flags | cv2.IMREAD_IGNORE_ORIENTATION))


def read_levels(path: StrPath) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """An image file's numbers as stored, 8 or 16 bits: for images that hold disparity, not light.

    Raises as :func:`read_image`.
    """
    import cv2

    return _decode(Path(path), cv2.IMREAD_UNCHANGED)


def _decode(path: Path, flags: int) -> NDArray[np.uint8] | NDArray[np.uint16]:
    import cv2

    data = path.read_bytes()
    _check_complete(path, data)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise OSError(f"{path}: cannot be decoded ({error.err})") from None
    if image is None:
        raise OSError(f"{path}: cannot be decoded: damaged, or of a kind that is not read here")
    _check_size(path, image.shape[1], image.shape[0])
    return cast("NDArray[np.uint8] | NDArray[np.uint16]", image)


def is_image_name(path: Path) -> bool:
    """Whether the name ends like a photograph's."""
    return path.suffix.lower() in IMAGE_SUFFIXES


def size_of(image: NDArray[np.uint8]) -> tuple[int, int]:
    """Width and height, pixels."""
    return image.shape[1], image.shape[0]


def _check_size(path: Path, width: int, height: int) -> None:
    if max(width, height) > MAX_SIDE_PX:
        raise ValueError(f"{path}: {width}x{height} px is too large: at most {MAX_SIDE_PX} px a side")


def _check_complete(path: Path, data: bytes) -> None:
    if not data:
        raise OSError(f"{path}: the file is empty")
    if data.startswith(_PNG):
        _check_png(path, data)
    elif data.startswith(_JPEG):
        _check_jpeg(path, data)
    elif data.startswith(_BINARY_PNM):
        _check_pnm(path, data)
    elif not data.startswith(_OTHERS):
        raise OSError(f"{path}: not an image")


def _check_png(path: Path, data: bytes) -> None:
    """Walks the chunks (PNG, third edition, section 5) up to IEND."""
    at = len(_PNG)
    while True:
        if at + 12 > len(data):
            raise OSError(f"{path}: truncated PNG: {len(data)} bytes, the end chunk IEND is missing")
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 12 + length
        if end > len(data):
            raise OSError(f"{path}: truncated PNG: {len(data)} bytes, chunk {kind!r} needs {end}")
        (stored,) = struct.unpack_from(">I", data, end - 4)
        if zlib.crc32(memoryview(data)[at + 4 : end - 4]) != stored:
            raise OSError(f"{path}: damaged PNG: wrong checksum of chunk {kind!r}")
        if kind == b"IHDR" and length >= 8:
            _check_size(path, *struct.unpack_from(">II", data, at + 8))
        if kind == b"IEND":
            return
        at = end


def _check_jpeg(path: Path, data: bytes) -> None:
    """Walks the marker segments (ITU-T T.81, annex B) to the first scan, then looks for the end-of-image marker.

    A thumbnail in the EXIF segment has an end marker of its own, hence the walk. Inside a scan 0xFF is always
    followed by 0x00 or a restart marker, so 0xFFD9 there is the end.
    """
    at = 2
    while at + 4 <= len(data):
        if data[at] != 0xFF:
            raise OSError(f"{path}: damaged JPEG: no marker at byte {at}")
        marker = data[at + 1]
        if marker == 0xFF:  # a fill byte
            at += 1
            continue
        if marker == 0xDA:
            if data.find(b"\xff\xd9", at) < 0:
                raise OSError(f"{path}: truncated JPEG: {len(data)} bytes, the end marker EOI is missing")
            return
        (length,) = struct.unpack_from(">H", data, at + 2)
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC) and at + 9 <= len(data):
            height, width = struct.unpack_from(">HH", data, at + 5)
            _check_size(path, width, height)
        at += 2 + length
    raise OSError(f"{path}: truncated JPEG: {len(data)} bytes, no image data")


def _check_pnm(path: Path, data: bytes) -> None:
    """Compares the header's size with the file's (netpbm's pgm(5) and ppm(5))."""
    header = _PNM_HEADER.match(data)
    if header is None:
        raise OSError(f"{path}: damaged PNM: no header 'P5 WIDTH HEIGHT MAXVAL'")
    width, height, largest = (int(header[i]) for i in (2, 3, 4))
    _check_size(path, width, height)
    needed = width * height * (3 if header[1] == b"6" else 1) * (2 if largest > 255 else 1)
    if len(data) - header.end() < needed:
        raise OSError(
            f"{path}: truncated PNM: {len(data) - header.end()} bytes of pixels, {width}x{height} px need {needed}"
        )
