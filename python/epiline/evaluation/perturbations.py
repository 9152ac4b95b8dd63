"""What goes wrong between two real cameras, done to good pairs: exposure, noise, blur, misalignment.

Each takes and returns grey images, (H, W) uint8; all but the noise change the right one only. Noise is seeded: the same
pair gets the same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Image: TypeAlias = NDArray[np.uint8]
Floats: TypeAlias = NDArray[np.float64]
Perturbation: TypeAlias = Callable[[Image, Image], tuple[Image, Image]]


def _levels(values: Floats) -> Image:
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def _on_the_right(change: Callable[[Floats], Floats]) -> Perturbation:
    return lambda left, right: (left, _levels(change(right.astype(np.float64))))


def _gamma(exponent: float) -> Perturbation:
    return _on_the_right(lambda v: 255.0 * (v / 255.0) ** exponent)


def _vignette(loss: float) -> Perturbation:
    """Darker toward the corners, which lose the share `loss`; with the square of the distance from the centre."""

    def change(values: Floats) -> Floats:
        height, width = values.shape
        y, x = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
        return np.asarray(values * (1.0 - loss * (x * x + y * y) / 2.0))

    return _on_the_right(change)


def _noise(sigma: float) -> Perturbation:
    """Gaussian, grey levels, in both images."""

    def perturb(left: Image, right: Image) -> tuple[Image, Image]:
        random = np.random.default_rng(0)
        first, second = (_levels(image + random.normal(0.0, sigma, image.shape)) for image in (left, right))
        return first, second

    return perturb


def _blur(sigma_px: float) -> Perturbation:
    import cv2

    return _on_the_right(lambda v: np.asarray(cv2.GaussianBlur(v, (0, 0), sigma_px), np.float64))


def _shift_down(pixels: float) -> Perturbation:
    import cv2

    matrix = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, pixels]])

    def change(values: Floats) -> Floats:
        # Cubic, for linear interpolation at half a pixel would blur as well.
        size = values.shape[1], values.shape[0]
        moved = cv2.warpAffine(values, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(moved, np.float64)

    return _on_the_right(change)


def perturbations() -> dict[str, Perturbation]:
    """By name, ``"none"`` first."""
    return {
        "none": lambda left, right: (left, right),
        "gain 0.8": _on_the_right(lambda v: 0.8 * v),
        "gain 0.6": _on_the_right(lambda v: 0.6 * v),
        "offset 20": _on_the_right(lambda v: v + 20.0),
        "gamma 1.5": _gamma(1.5),
        "vignette 40 %": _vignette(0.4),
        "noise 3": _noise(3.0),
        "noise 8": _noise(8.0),
        "blur 1 px": _blur(1.0),
        "shift 0.5 px": _shift_down(0.5),
        "shift 1 px": _shift_down(1.0),
    }
