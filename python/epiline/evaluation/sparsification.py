"""Does a confidence predict the error? Sparsification: what remains when the least trusted pixels are left out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epiline._core import DisparityMap


@dataclass(frozen=True)
class Sparsification:
    """Mean error against the share of pixels kept, most trusted first.

    Attributes
    ----------
    density : (N,) float64
        Shares of the scored pixels that are kept, from ``1 / N`` to 1.
    error, oracle_error : (N,) float64
        Mean error of those kept in the order of confidence, and in the order of the error itself.
    area, oracle_area : float
        Areas under both curves.
    pixels : int
        Pixels scored.
    """

    density: NDArray[np.float64]
    error: NDArray[np.float64]
    oracle_error: NDArray[np.float64]
    area: float
    oracle_area: float
    pixels: int

    @property
    def ratio(self) -> float:
        """Area over the oracle's: 1 is perfect; NaN if the oracle's is zero."""
        return self.area / self.oracle_area if self.oracle_area > 0 else float("nan")


def sparsification(
    disp: DisparityMap | ArrayLike,
    confidence: ArrayLike | None,
    truth: ArrayLike,
    mask: ArrayLike | None = None,
    *,
    bad_px: float | None = None,
    steps: int = 50,
) -> Sparsification:
    """Measures how well a confidence orders pixels by their error.

    Parameters
    ----------
    disp : DisparityMap or (H, W) float
        Disparity, px; NaN where there is none.
    confidence : (H, W) float, optional
        Larger is better; ``disp.confidence`` if None. A value without confidence is trusted least.
    truth : (H, W) float
        Ground truth, px; NaN where unknown.
    mask : (H, W) bool, optional
        Pixels to score; all by default.
    bad_px : float, optional
        The error of a pixel is 1 if it is off by more than this, else 0. By default it is the absolute difference, px.
    steps : int
        Points of the curves.

    Returns
    -------
    Sparsification

    Raises
    ------
    ValueError
        Sizes differ, no pixel can be scored, `steps` is not positive, or there is no confidence.

    Notes
    -----
    Pixels of equal confidence come in no order: each counts with their mean error.
    """
    if steps < 1:
        raise ValueError(f"steps = {steps}: must be at least 1")
    if confidence is None:
        if not isinstance(disp, DisparityMap):
            raise ValueError("confidence = None: only a DisparityMap brings its own")
        confidence = disp.confidence
    values = np.asarray(disp.values if isinstance(disp, DisparityMap) else disp, np.float64)
    trust, known = np.asarray(confidence, np.float64), np.asarray(truth, np.float64)
    chosen = np.ones(values.shape, bool) if mask is None else np.asarray(mask, bool)
    for name, other in (("confidence", trust), ("truth", known), ("mask", chosen)):
        if other.shape != values.shape:
            raise ValueError(f"disp is {values.shape} but {name} is {other.shape}; they must have one shape")
    scored = chosen & np.isfinite(values) & np.isfinite(known)
    if not scored.any():
        raise ValueError("no pixel has a disparity and a known truth")
    error = np.abs(values - known)[scored]
    if bad_px is not None:
        error = (error > bad_px).astype(np.float64)
    trust = np.where(np.isnan(trust), -np.inf, trust)[scored]

    _, rank, count = np.unique(-trust, return_inverse=True, return_counts=True)
    mean_of_rank = np.bincount(rank, error) / count
    by_confidence = np.repeat(mean_of_rank, count)
    kept = np.maximum(np.rint(np.arange(1, steps + 1) / steps * error.size).astype(int), 1)
    curve, oracle = (np.cumsum(ordered)[kept - 1] / kept for ordered in (by_confidence, np.sort(error)))
    return Sparsification(kept / error.size, curve, oracle, float(curve.mean()), float(oracle.mean()), error.size)
