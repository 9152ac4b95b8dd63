"""Pictures as PNG or JPEG files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline._files import StrPath, write_atomically


def write_picture(path: StrPath, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Writes an image in the format its file name ends with.

    Parameters
    ----------
    path : path-like
        Ends in ``.png``, ``.jpg`` or whatever else OpenCV encodes.
    image : (H, W) or (H, W, 3) uint8, or (H, W) uint16
        Three channels are blue, green, red.

    Raises
    ------
    ValueError
        The suffix is no picture format.
    OSError
        The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if not suffix or not cv2.haveImageWriter(f"x{suffix}"):
        raise ValueError(f"{path}: '{suffix}' is no picture format; use .png or .jpg")
    done, encoded = cv2.imencode(suffix, image)
    if not done:
        raise ValueError(f"{path}: an image of {image.shape} {image.dtype} cannot be encoded as {suffix}")
    write_atomically(path, encoded.tobytes())
