"""The fit of eq. 6 against the best of many SciPy fits, on tables of many kinds.

    python benchmarks/range_curve.py                        # 200 tables, 50 starts each: some minutes
    python benchmarks/range_curve.py --tables 20 --starts 10 --seed 7

A table is worse than SciPy's if its sum of squares, taken in float64 from the constants a, b, c, d as printed, exceeds
that of SciPy's best by more than 1e-9 of it; what both reach to the rounding of the measurements themselves, 1e-15 of
their sum of squares, counts as equal. SciPy starts from log-linear fits of either half of the table and from random
constants of several sizes, with exact derivatives (least_squares, method "lm") and tight tolerances.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import epiline as ep

Floats = NDArray[np.float64]
NOISES_M = (1e-4, 1e-3, 0.01, 0.05, 0.2)


def curve(constants: Floats, x: Floats) -> Floats:
    a, b, c, d = constants
    return np.asarray(a * np.exp(b * x) + c * np.exp(d * x))


def _two_falling(rng: np.random.Generator, x: Floats) -> Floats:
    return curve(np.array([rng.uniform(1, 8), -rng.uniform(0.02, 0.5), rng.uniform(0.3, 4), -rng.uniform(0, 0.05)]), x)


def _difference(rng: np.random.Generator, x: Floats) -> Floats:
    return curve(np.array([rng.uniform(2, 8), -rng.uniform(0.02, 0.3), -rng.uniform(0.3, 2), -rng.uniform(0, 0.05)]), x)


def _triangulated(rng: np.random.Generator, x: Floats) -> Floats:
    return rng.uniform(10, 60) / x


def _triangulated_with_offset(rng: np.random.Generator, x: Floats) -> Floats:
    return rng.uniform(10, 60) / (x + rng.uniform(-0.5, 5))


def _single(rng: np.random.Generator, x: Floats) -> Floats:
    return rng.uniform(1, 5) * np.exp(-rng.uniform(0.02, 0.1) * x)


def _nearly_equal_rates(rng: np.random.Generator, x: Floats) -> Floats:
    rate = -rng.uniform(0.02, 0.1)
    return curve(np.array([5.0, rate, rng.uniform(-4, 4), rate * (1 + rng.choice([1e-6, 1e-4, 1e-2]))]), x)


def _double_rate(rng: np.random.Generator, x: Floats) -> Floats:
    return (rng.uniform(1, 5) + rng.uniform(-0.2, 0.2) * x) * np.exp(-rng.uniform(0.01, 0.1) * x)


def _constant(rng: np.random.Generator, x: Floats) -> Floats:
    return np.full_like(x, rng.uniform(0.5, 5))


def _growing(rng: np.random.Generator, x: Floats) -> Floats:
    return curve(np.array([rng.uniform(0.1, 1), rng.uniform(0.01, 0.08), rng.uniform(-1, 2), rng.uniform(0, 0.02)]), x)


def _straight(rng: np.random.Generator, x: Floats) -> Floats:
    return rng.uniform(3, 6) - rng.uniform(0.01, 0.06) * x


def _noise(rng: np.random.Generator, x: Floats) -> Floats:
    return rng.uniform(0, 5, x.size)


KINDS: dict[str, Callable[[np.random.Generator, Floats], Floats]] = {
    "two falling": _two_falling,
    "difference of two": _difference,
    "f b / d": _triangulated,
    "f b / (d + d0)": _triangulated_with_offset,
    "one exponential": _single,
    "nearly equal rates": _nearly_equal_rates,
    "double rate": _double_rate,
    "constant": _constant,
    "growing": _growing,
    "straight": _straight,
    "noise alone": _noise,
}


def table(kind: str, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Disparities and distances: few points or many, evenly spaced, scattered or repeated, with noise."""
    count = int(rng.choice([5, 6, 7, 9, 12, 20, 40]))
    spacing = rng.integers(3)
    if spacing == 0:
        x = np.linspace(3, 45, count)
    elif spacing == 1:
        x = np.sort(rng.uniform(1, 60, count))
    else:
        x = np.sort(np.concatenate([np.arange(4) * 9.0 + 4, rng.choice(np.arange(4, 40, 4.0), count - 4)]))
    return x, KINDS[kind](rng, x) + rng.normal(0, rng.choice(NOISES_M), count)


def starts(x: Floats, y: Floats, count: int, rng: np.random.Generator) -> list[Floats]:
    """Constants to start SciPy from."""
    found = []
    for part in (slice(None), slice(None, x.size // 2 + 1), slice(x.size // 2, None)):
        rate, log_amplitude = np.polyfit(x[part], np.log(np.maximum(np.abs(y[part]), 1e-6)), 1)
        for share in (0.3, 0.9):
            amplitude = np.exp(np.clip(log_amplitude, -50, 50))
            found.append(np.array([share * amplitude, 3 * rate, (1 - share) * amplitude, rate / 2]))
    scale = float(np.abs(y).max())
    while len(found) < count:
        size = rng.choice([0.01, 0.1, 0.5])
        found.append(rng.normal(0, [2 * scale, size, 2 * scale, size]))
    return found[:count]


def best_of_scipy(x: Floats, y: Floats, count: int, rng: np.random.Generator) -> float:
    """The smallest sum of squares that any start comes to."""

    def residual(p: Floats) -> Floats:
        r = curve(p, x) - y
        return np.where(np.isfinite(r), r, 1e150)

    def jacobian(p: Floats) -> Floats:
        e, g = np.exp(p[1] * x), np.exp(p[3] * x)
        return np.nan_to_num(np.stack([e, p[0] * x * e, g, p[2] * x * g], axis=1), posinf=1e150, neginf=-1e150)

    best = np.inf
    with np.errstate(all="ignore"):
        for start in starts(x, y, count, rng):
            fit = least_squares(
                residual, start, jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=1000
            )
            best = min(best, float(np.sum(residual(fit.x) ** 2)))
    return best


def main() -> None:
    parser = argparse.ArgumentParser(description="The fit of eq. 6 against SciPy")
    parser.add_argument("--tables", type=int, default=200)
    parser.add_argument("--starts", type=int, default=50)
    parser.add_argument("--seed", type=int, default=2011)
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    print(f"{args.tables} tables, best of {args.starts} SciPy starts, seed {args.seed}")
    excess: dict[str, list[float]] = {kind: [] for kind in KINDS}
    seconds = [0.0, 0.0]
    for number in range(args.tables):
        kind = list(KINDS)[number % len(KINDS)]
        x, y = table(kind, rng)
        begin = time.perf_counter()
        fit = ep.fit_range_curve(x, y)
        middle = time.perf_counter()
        with np.errstate(under="ignore"):
            ours = float(np.sum((curve(np.array([fit.a, fit.b, fit.c, fit.d]), x) - y) ** 2))
        theirs = best_of_scipy(x, y, args.starts, rng)
        seconds[0] += middle - begin
        seconds[1] += time.perf_counter() - middle
        floor = 1e-15 * float(y @ y)
        excess[kind].append((ours - theirs) / max(theirs, floor))
    print(f"{'kind':<20} {'tables':>6} {'worse':>6} {'better':>7} {'worst excess':>13}")
    for kind, found in excess.items():
        if found:
            worse, better = sum(e > 1e-9 for e in found), sum(e < -1e-9 for e in found)
            print(f"{kind:<20} {len(found):>6} {worse:>6} {better:>7} {max(found):>13.1e}")
    everything = np.concatenate([np.array(found) for found in excess.values()])
    print(
        f"never worse: {bool((everything <= 1e-9).all())}; "
        f"better in {(everything < -1e-9).sum()} of {everything.size}; "
        f"{1e3 * seconds[0] / args.tables:.1f} ms a fit, SciPy's {1e3 * seconds[1] / args.tables:.0f} ms"
    )


if __name__ == "__main__":
    main()
