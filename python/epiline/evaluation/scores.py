"""How good a disparity map is, in the measures of Middlebury and KITTI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.floating]

_BAD_PX = (1.0, 2.0, 3.0)
# KITTI 2015: wrong if off by more than 3 px and by more than 5 % of the truth.
D1_PX, D1_SHARE = 3.0, 0.05


@runtime_checkable
class HasValues(Protocol):
    """A disparity map: `epiline.DisparityMap` or anything else with float values in pixels, NaN where unknown."""

    @property
    def values(self) -> NDArray[np.float32]: ...


@dataclass(frozen=True, kw_only=True)
class Evaluation:
    """Errors of a disparity map over the scored pixels: those with a truth, inside the mask.

    Shares are percent. *matched* is over the pixels that have an answer, *total* over all scored pixels, an
    unanswered one counting as wrong. NaN where there is nothing to score.

    Attributes
    ----------
    pixels : int
        Scored pixels.
    density : float
        Share of them with an answer.
    avg, rms : float
        Mean absolute and root mean square error of the answers, px.
    bad1_matched … bad3_total : float
        Off by more than 1, 2, 3 px.
    d1_matched, d1_total : float
        Off by more than 3 px and 5 % of the truth.
    """

    pixels: int
    density: float
    avg: float
    rms: float
    bad1_matched: float
    bad2_matched: float
    bad3_matched: float
    d1_matched: float
    bad1_total: float
    bad2_total: float
    bad3_total: float
    d1_total: float


def evaluate(disp: HasValues | Floats, ground_truth: Floats, mask: NDArray[np.bool_] | None = None) -> Evaluation:
    """Scores a disparity map.

    Parameters
    ----------
    disp : DisparityMap or (H, W) float
        Disparity, px; NaN, or a negative number as OpenCV writes it, where there is no answer.
    ground_truth : (H, W) float
        True disparity, px; NaN or infinite where unknown.
    mask : (H, W) bool, optional
        Pixels to score; all that have a truth if not given.

    Returns
    -------
    Evaluation

    Raises
    ------
    ValueError
        The shapes differ.
    """
    values = np.array(disp.values if isinstance(disp, HasValues) else disp, np.float64)
    values[values < 0] = np.nan
    truth = np.asarray(ground_truth, np.float64)
    if values.ndim != 2 or values.shape != truth.shape:
        raise ValueError(f"disparity has shape {values.shape}, ground truth {truth.shape}; they must be one (H, W)")
    scored = np.isfinite(truth)
    if mask is not None:
        chosen = np.asarray(mask, bool)
        if chosen.shape != truth.shape:
            raise ValueError(f"mask has shape {chosen.shape}, ground truth {truth.shape}")
        scored &= chosen
    error = np.abs(values - truth)[scored]
    answered = np.isfinite(error)
    wrong = {f"bad{limit:g}": error > limit for limit in _BAD_PX}
    wrong["d1"] = wrong_as_d1(error, truth[scored])
    shares = {f"{name}_matched": _percent(flags[answered]) for name, flags in wrong.items()}
    shares |= {f"{name}_total": _percent(flags | ~answered) for name, flags in wrong.items()}
    known = error[answered]
    return Evaluation(
        pixels=int(error.size),
        density=_percent(answered),
        avg=float(known.mean()) if known.size else float("nan"),
        rms=float(np.sqrt(np.square(known).mean())) if known.size else float("nan"),
        **shares,
    )


def wrong_as_d1(error: Floats, truth: Floats) -> NDArray[np.bool_]:
    """Which errors, px, KITTI 2015 counts as wrong."""
    return np.asarray((error > D1_PX) & (error > D1_SHARE * truth), bool)


def _percent(flags: NDArray[np.bool_]) -> float:
    return 100.0 * float(flags.mean()) if flags.size else float("nan")
