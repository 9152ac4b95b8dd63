"""How well the confidence orders pixels by their error: sparsification on the scenes with ground truth.

    python benchmarks/confidence.py DATA          # the folder with manifest.json

Per preset, the mean over scenes of the area under the sparsification curve over the oracle's, for the absolute error
(px) and for errors beyond 1 px; pixels that both cameras see. The last column is what a confidence that tells nothing
would have. Weights were chosen on the even scenes; the odd ones are the test.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

import epiline as ep
from epiline.evaluation import load_scenes, sparsification

SETTINGS: dict[str, dict[str, Any]] = {
    "sad, no tests": {"block_size": 11},
    "fast": {"preset": "fast"},
    "balanced": {"preset": "balanced"},
    "accurate": {"preset": "accurate"},
}


def main(data: Path) -> None:
    scenes = list(load_scenes(data))
    print(f"{len(scenes)} scenes; area under the curve / oracle's: mean over the even scenes | over the odd ones")
    print(f"{'setting':<14} {'error, px':>14} {'beyond 1 px':>14} {'constant, px':>14}")
    for setting, given in SETTINGS.items():
        rows = []
        for scene in scenes:
            disparities = min(scene.num_disparities, scene.left.shape[1])
            disp = ep.match(scene.left, scene.right, **given, num_disparities=disparities)
            scored = (disp, None, scene.truth, scene.non_occluded)
            error, beyond = sparsification(*scored), sparsification(*scored, bad_px=1.0)
            rows.append((error.ratio, beyond.ratio, error.error[-1] / error.oracle_area))
        halves = [np.nanmean(rows[half::2], axis=0) for half in (0, 1)]
        cells = (f"{even:.2f} | {odd:.2f}" for even, odd in zip(*halves, strict=True))
        print(f"{setting:<14} " + " ".join(f"{cell:>14}" for cell in cells))


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
