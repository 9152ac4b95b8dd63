"""Why pixels have no answer: the bits of a disparity map's validity, in words and colours."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Reason:
    """One bit of the validity mask. `colour` is `#rrggbb`."""

    bit: int
    label: str
    colour: str

    @property
    def bgr(self) -> tuple[int, int, int]:
        """The colour as blue, green, red."""
        red, green, blue = bytes.fromhex(self.colour[1:])
        return blue, green, red


FILLED = 1 << 7

REASONS = (
    Reason(1 << 0, "border: outside the right image", "#94a3b8"),
    Reason(1 << 1, "no source pixel after rectification", "#475569"),
    Reason(1 << 2, "not unique", "#f59e0b"),
    Reason(1 << 3, "left and right disagree", "#ef4444"),
    Reason(1 << 4, "too little texture", "#3b82f6"),
    Reason(1 << 5, "speckle", "#a855f7"),
    Reason(1 << 6, "over- or under-exposed", "#fde047"),
    Reason(FILLED, "filled from neighbours (has a value)", "#10b981"),
)
"""In the order of the bits; `epiline::Validity` in the core defines them."""


def first_reason(validity: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """For each pixel, 0 if it was measured, else 1 + the number of its lowest bit. Shape (H, W) uint8."""
    table = np.zeros(256, np.uint8)
    table[1:] = [(bits & -bits).bit_length() for bits in range(1, 256)]
    return table[validity]


def has_value(validity: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Whether a pixel carries a disparity: no bit but `FILLED`."""
    return np.asarray((validity & np.uint8(0xFF ^ FILLED)) == 0)
