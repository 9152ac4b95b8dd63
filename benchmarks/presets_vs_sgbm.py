"""Speed of epiline's presets against OpenCV's StereoSGBM 3WAY with its tests: one run, one thread each.

    python benchmarks/presets_vs_sgbm.py [--repeats 9]

SGBM runs twice: as users call it, which leaves the left `disparities` columns unanswered, and padded on the left so
that it answers what epiline answers. Repetitions alternate; a ratio is the median of the repetitions' ratios of thread
time. "agree" is the share of pixels that both answer whose answers lie within 1 px: a check that both did the work.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np
from sad_vs_opencv import commit, cpu_name, photographs

import epiline as ep

SIZES = ((640, 480, 64), (640, 480, 128), (1280, 720, 128))
PRESETS = {"balanced": {"preset": "balanced"}, "accurate, filled": {"preset": "accurate", "fill": True}}


def seconds(work: Callable[[], object]) -> float:
    start = time.thread_time()
    work()
    return time.thread_time() - start


def compare(width: int, height: int, disparities: int, preset: str, repeats: int) -> tuple[float, float, float]:
    """How many times faster than SGBM as is, than SGBM padded, and how many answers agree."""
    left, right, _ = photographs(width, height)
    padded = [cv2.copyMakeBorder(image, 0, 0, disparities, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
    sgbm = cv2.StereoSGBM.create(0, disparities, 5, 8 * 25, 32 * 25, 1, 31, 10, 100, 2, cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    ours = ep.StereoMatcher(num_disparities=disparities, threads=1, **PRESETS[preset])
    out = ours(left, right)
    reference = sgbm.compute(*padded)[:, disparities:] / 16.0
    both = (reference >= 0) & np.isfinite(out.values)
    agree = float((np.abs(reference - out.values)[both] <= 1).mean())
    ratios = []
    for _ in range(repeats):
        own = seconds(lambda: ours(left, right, out=out))
        ratios.append((seconds(lambda: sgbm.compute(left, right)) / own, seconds(lambda: sgbm.compute(*padded)) / own))
    as_is, against_padded = np.median(ratios, axis=0)
    return float(as_is), float(against_padded), agree


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=9, help="repetitions per row (9)")
    repeats = parser.parse_args().repeats
    cv2.setNumThreads(1)
    print(f"{cpu_name()}; epiline {commit()} {ep.simd_level()}; OpenCV {cv2.__version__}; {photographs(64, 64)[2]}")
    print(f"{'preset':18}{'size':>14}{'x SGBM 3WAY':>14}{'x padded':>10}{'agree':>8}")
    for size in SIZES:
        for preset in PRESETS:
            as_is, padded, agree = compare(*size, preset, repeats)
            print(f"{preset:18}{'x'.join(map(str, size)):>14}{as_is:>14.2f}{padded:>10.2f}{100 * agree:>7.1f}%")


if __name__ == "__main__":
    main()
