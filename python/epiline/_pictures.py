"""Disparity as pictures: grey (nearer is brighter) and colour, with invalid pixels told apart from far ones.

Both pictures are look-ups of the same levels: 0 is "no answer", 1 to 255 run from far to near.
"""

from collections.abc import Iterable
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

Levels: TypeAlias = NDArray[np.uint8]
Palette: TypeAlias = NDArray[np.uint8]
Limits: TypeAlias = tuple[float, float]
"""Disparities, px, painted as the farthest and the nearest level."""

FARTHEST_GREY = 40
"""Grey of the farthest disparity. Above zero, so that black means "no answer" and nothing else."""

INVALID_BGR = (24, 20, 20)
"""Colour of a pixel without an answer in the colour picture."""

# The first 8 % of turbo is too near to black to be told from an invalid pixel.
_FIRST_TURBO = 20


def disparity_limits(maps_px: Iterable[NDArray[np.float32]]) -> Limits:
    """Limits that one picture, or a whole run of them, is painted with.

    Parameters
    ----------
    maps_px
        Disparity maps, (H, W) float32 px, NaN where invalid.

    Returns
    -------
    The 0.5th and the 99.5th percentile over all maps, so that a few wild matches do not take the contrast from the
    rest; at least one pixel apart. `(0, 1)` if no map has an answer.
    """
    answered = [values[np.isfinite(values)] for values in maps_px]
    samples = np.concatenate([part[:: max(1, part.size // 200_000)] for part in answered] or [np.empty(0, np.float32)])
    if samples.size == 0:
        return 0.0, 1.0
    low, high = (float(v) for v in np.percentile(samples, (0.5, 99.5)))
    return low, max(high, low + 1.0)


def disparity_levels(values_px: NDArray[np.float32], limits_px: Limits) -> Levels:
    """Levels 1 (far limit or beyond) to 255 (near limit or nearer), linear in disparity; 0 where NaN.

    Parameters
    ----------
    values_px
        (H, W) float32 disparity, px, NaN where invalid.
    limits_px
        Disparities of levels 1 and 255.

    Raises
    ------
    ValueError
        If the limits are not finite and increasing.
    """
    low, high = limits_px
    if not (np.isfinite(low) and np.isfinite(high) and low < high):
        raise ValueError(f"limits_px = ({low}, {high}) px: must be finite and increasing")
    share = np.clip((values_px - np.float32(low)) / np.float32(high - low), 0.0, 1.0)
    return np.where(np.isfinite(share), np.rint(1.0 + 254.0 * np.nan_to_num(share)), 0.0).astype(np.uint8)


def grey_palette() -> Palette:
    """(256, 3) BGR of each level in the grey picture: black, then `FARTHEST_GREY` to white."""
    grey = np.rint(np.linspace(FARTHEST_GREY, 255, 255)).astype(np.uint8)
    return np.repeat(np.concatenate([np.zeros(1, np.uint8), grey])[:, None], 3, axis=1)


def colour_palette() -> Palette:
    """(256, 3) BGR of each level in the colour picture: `INVALID_BGR`, then turbo from blue to red."""
    index = np.rint(np.linspace(_FIRST_TURBO, 255, 255)).astype(np.uint8)
    turbo = cv2.applyColorMap(index[:, None], cv2.COLORMAP_TURBO)[:, 0]
    return np.concatenate([np.array([INVALID_BGR], np.uint8), turbo])


def grey_picture(values_px: NDArray[np.float32], *, limits_px: Limits | None = None) -> NDArray[np.uint8]:
    """The disparity map in grey, nearer is brighter, black where invalid.

    Parameters
    ----------
    values_px
        (H, W) float32 disparity, px, NaN where invalid.
    limits_px
        Disparities painted darkest and white; by default those of `disparity_limits`.

    Returns
    -------
    (H, W) uint8.
    """
    levels = disparity_levels(values_px, limits_px or disparity_limits([values_px]))
    return np.ascontiguousarray(grey_palette()[levels][:, :, 0])


def colour_picture(values_px: NDArray[np.float32], *, limits_px: Limits | None = None) -> NDArray[np.uint8]:
    """The disparity map in colour, far is blue and near is red, `INVALID_BGR` where invalid.

    Parameters as `grey_picture`. Returns (H, W, 3) uint8 BGR.
    """
    levels = disparity_levels(values_px, limits_px or disparity_limits([values_px]))
    return colour_palette()[levels]


def grey_level_disparity(level: float, limits_px: Limits) -> float:
    """The disparity, px, that `grey_picture` paints with a grey level: `FARTHEST_GREY` to 255."""
    low, high = limits_px
    return low + (high - low) * (level - FARTHEST_GREY) / (255 - FARTHEST_GREY)
