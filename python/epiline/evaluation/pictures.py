"""Error maps in the colours of KITTI's development kit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from epiline.evaluation.scores import D1_PX, D1_SHARE

# Upper bound of the error in units of what counts as wrong, then red, green, blue (ColorBrewer's RdYlBu, reversed).
_STEPS = (
    (0.0625, (49, 54, 149)),
    (0.125, (69, 117, 180)),
    (0.25, (116, 173, 209)),
    (0.5, (171, 217, 233)),
    (1.0, (224, 243, 248)),
    (2.0, (254, 224, 144)),
    (4.0, (253, 174, 97)),
    (8.0, (244, 109, 67)),
    (16.0, (215, 48, 39)),
    (np.inf, (165, 0, 38)),
)
_BOUNDS = np.array([bound for bound, _ in _STEPS[:-1]])
_COLOURS_BGR = np.array([rgb[::-1] for _, rgb in _STEPS], np.uint8)
NO_ANSWER_BGR = (120, 120, 120)


def error_picture(
    values: NDArray[np.float32], truth: NDArray[np.float32], non_occluded: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    """The error of every pixel with a truth: from blue, through white where it becomes wrong, to red.

    Errors are in units of what KITTI 2015 counts as wrong, min(error / 3 px, error / 5 % of the truth), and the colours
    step with their logarithm. Black has no truth, grey no answer; occluded pixels are half as bright.

    Parameters
    ----------
    values, truth : (H, W) float32
        Px, NaN where unknown.
    non_occluded : (H, W) bool

    Returns
    -------
    (H, W, 3) uint8, blue, green, red.
    """
    known = np.isfinite(truth)
    error = np.abs(values - truth)
    with np.errstate(invalid="ignore", divide="ignore"):
        units = np.minimum(error / D1_PX, error / (D1_SHARE * truth))
    picture: NDArray[np.uint8] = _COLOURS_BGR[np.searchsorted(_BOUNDS, np.nan_to_num(units), side="right")]
    picture[known & ~np.isfinite(values)] = NO_ANSWER_BGR
    picture[known & ~non_occluded] //= 2
    picture[~known] = 0
    return picture
