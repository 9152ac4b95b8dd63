"""Cost of matching regions against that of the whole image, and whether their answers are the same.

    python benchmarks/regions.py            # table
    python benchmarks/regions.py --repeat 60

The four bands of the 2011 paper (320x20 to 320x50 of a 320x240 image), and boxes. "area" is the share of the image's
work that the regions need at least: their rows and those of half a window above and below (of the image's, the same),
joined where they overlap. "cost" is the median ratio of times, both measured alternately, one thread, time of the
thread; "cost / area" is what is to be small. Every answer is compared with the whole image's.
"""

from __future__ import annotations

import argparse
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

import epiline as ep
from epiline.benchmarking.pairs import pair_from

HEIGHTS = (20, 30, 40, 50)
SETTINGS: dict[str, dict[str, Any]] = {
    "sad w15": {"num_disparities": 48, "block_size": 15},
    "sad w9": {"num_disparities": 48, "block_size": 9},
    "sad w11, tests": {
        "num_disparities": 48,
        "block_size": 11,
        "uniqueness_ratio": 5,
        "texture_threshold": 10,
        "left_right_max_diff": 1,
    },
    "sad w11, speckle": {
        "num_disparities": 48,
        "block_size": 11,
        "uniqueness_ratio": 5,
        "texture_threshold": 10,
        "left_right_max_diff": 1,
        "speckle_size": 200,
    },
}


def apart() -> list[ep.Region]:
    """The bands with 14 rows and more between them."""
    tops = np.cumsum([10, *(height + 20 for height in HEIGHTS[:-1])])
    return [ep.Region(f"{h}", x=0, y=int(top), width=320, height=h) for h, top in zip(HEIGHTS, tops, strict=True)]


def boxes() -> list[ep.Region]:
    return [ep.Region("a", x=100, y=60, width=96, height=64), ep.Region("b", x=220, y=150, width=64, height=64)]


def share(regions: list[ep.Region], window: int, shape: tuple[int, int]) -> float:
    """Pixels of the regions and of half a window around, over those of the image and half a window around."""
    radius = window // 2
    touched = np.zeros((shape[0] + 2 * radius, shape[1] + 2 * radius), bool)
    for region in regions:
        touched[region.y : region.y + region.height + 2 * radius, region.x : region.x + region.width + 2 * radius] = (
            True
        )
    return float(touched.mean())


def main() -> None:
    parser = argparse.ArgumentParser(description="Cost of matching regions")
    parser.add_argument("--repeat", type=int, default=40)
    repeat = parser.parse_args().repeat
    data = os.environ.get("EPILINE_DATA")
    pair = pair_from(Path(data) if data else None).resized(320, 240)
    left, right = pair.left, pair.right
    print(f"{pair.name}, 320x240, {ep.simd_level()}, one thread, {repeat} repetitions")
    print(f"{'setting':<16} {'regions':<14} {'area':>6} {'cost':>6} {'cost / area':>12}  answers")
    sets = {"bands stacked": ep.paper_regions(320, 240), "bands apart": apart(), "two boxes": boxes()}
    for setting, given in SETTINGS.items():
        matcher = ep.StereoMatcher(**given, threads=1)
        whole = matcher(left, right)
        for label, regions in sets.items():
            disp, out = matcher(left, right, regions=regions), matcher(left, right)
            inside = np.zeros(left.shape, bool)
            for region in regions:
                inside[region.y : region.y + region.height, region.x : region.x + region.width] = True
            same = np.array_equal(disp.raw[inside], whole.raw[inside])
            same &= np.array_equal(disp.validity[inside], whole.validity[inside])
            ratios = []
            for _ in range(repeat):
                begin = time.thread_time()
                matcher(left, right, out=out)
                middle = time.thread_time()
                matcher(left, right, regions=regions, out=out)
                ratios.append((time.thread_time() - middle) / (middle - begin))
            cost, area = float(np.median(ratios)), share(regions, matcher.parameters["block_size"], left.shape)
            answers = "equal" if same else "DIFFERENT"
            print(f"{setting:<16} {label:<14} {area:>6.3f} {cost:>6.3f} {cost / area:>12.2f}  {answers}")


if __name__ == "__main__":
    main()
