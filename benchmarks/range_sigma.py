"""Is the sigma that a confidence stands for honest? Errors of disparities against it, on the scenes with ground truth.

    python benchmarks/range_sigma.py DATA          # the folder with manifest.json

Per preset, the share of pixels within one and within two standard deviations, with the sigma of each pixel's confidence
and with 0.25 px for all; pixels that both cameras see, every scene with the same weight; the even scenes, on which the
sigmas were chosen, | the odd ones. A normal distribution has 68.3 and 95.4 %.

Then the half-widths that hold 68 % and 95 % of the errors about each confidence, the second halved: where the two
differ, the errors have longer tails than a normal distribution.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import epiline as ep
from epiline.evaluation import Scene, load_scenes

SETTINGS: dict[str, dict[str, Any]] = {
    "fast": {"preset": "fast"},
    "balanced": {"preset": "balanced"},
    "accurate": {"preset": "accurate"},
    "sad, left-right": {"block_size": 11, "left_right_max_diff": 1},
}
LEVELS = (0, 32, 64, 96, 128, 160, 192, 216, 232, 244, 255)
PER_PX, LONGEST_PX = 64, 64


def sigma_px(disparity: ep.DisparityMap) -> NDArray[np.float64]:
    """(H, W): what `to_range` takes for each pixel, px; read back from the ranges of a rig that makes it plain."""
    height, width = disparity.shape
    plain = ep.RectifiedGeometry(
        width=width, height=height, focal_px=1e3, cx_px=width / 2, cy_px=height / 2, baseline_m=1.0, doffs_px=16.0
    )
    result = ep.to_range(disparity, plain)
    depth_m = result.depth_m.astype(np.float64)
    return np.asarray(result.sigma_m / (result.range_m / depth_m) * 1e3 / depth_m**2)


def errors(scene: Scene, given: dict[str, Any]) -> tuple[NDArray[np.float64], ...]:
    """Absolute error, sigma and confidence of every pixel that can be scored."""
    disparities = min(scene.num_disparities, scene.left.shape[1])
    disp = ep.match(scene.left, scene.right, **given, num_disparities=disparities)
    scored = np.isfinite(disp.values) & np.isfinite(scene.truth) & scene.non_occluded
    error = np.abs(disp.values - scene.truth)[scored].astype(np.float64)
    return error, sigma_px(disp)[scored], np.rint(255 * disp.confidence[scored])


def main(data: Path) -> None:
    scenes = list(load_scenes(data))
    print(f"{len(scenes)} scenes; % within 1 and 2 sigma: even scenes | odd scenes")
    print(f"{'setting':<16} {'by confidence':>27} {'0.25 px':>27}")
    histogram = np.zeros((2, 256, PER_PX * LONGEST_PX))
    for setting, given in SETTINGS.items():
        rows = []
        for number, scene in enumerate(scenes):
            error, sigma, confidence = errors(scene, given)
            rows.append([np.mean(error <= k * s) for s in (sigma, 0.25) for k in (1, 2)])
            bins = np.minimum((error * PER_PX).astype(int), PER_PX * LONGEST_PX - 1)
            np.add.at(histogram[number % 2], (confidence.astype(int), bins), 1 / error.size)
        even, odd = (100 * np.mean(rows[half::2], axis=0) for half in (0, 1))
        cells = (f"{even[i]:.1f} {even[i + 1]:.1f} | {odd[i]:.1f} {odd[i + 1]:.1f}" for i in (0, 2))
        print(f"{setting:<16} " + " ".join(f"{cell:>27}" for cell in cells))
    print("confidence, half-width of 68 %, half of that of 95 %, px: even scenes | odd scenes")
    edges = np.concatenate([[0], (np.array(LEVELS[1:]) + np.array(LEVELS[:-1])) / 2, [256]])
    for level, low, high in zip(LEVELS, edges[:-1], edges[1:], strict=True):
        found = histogram[:, int(np.ceil(low)) : int(np.ceil(high))].sum(axis=1).cumsum(axis=1)
        widths = [[np.searchsorted(f, share * f[-1]) / PER_PX for share in (0.6827, 0.9545)] for f in found]
        print(f"{level:>10} " + " | ".join(f"{one:.2f} {two / 2:.2f}" for one, two in widths))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
