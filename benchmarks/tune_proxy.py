"""How often answers are wrong where `epiline tune` without truth has no reference: the constants of its judge.

    python benchmarks/tune_proxy.py [FOLDER]

Block matching (preset fast) on every other scene by name, and on the rest as a check; percent over scenes.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np

from epiline import StereoMatcher
from epiline.evaluation import load_scenes
from epiline.evaluation.scores import wrong_as_d1
from epiline.tuning import find_range
from epiline.tuning.judges import reference_of


def main() -> None:
    default = os.environ.get("EPILINE_DATA", Path(__file__).parent.parent.parent / "shared" / "data")
    root = Path(sys.argv[1] if len(sys.argv) > 1 else default)
    rows = []
    for scene in load_scenes(root):
        searched = find_range([(scene.left, scene.right)], None)
        reference, seen = reference_of(scene.left, scene.right, searched, None)
        span = {"num_disparities": searched.count, "min_disparity": searched.first}
        values = StereoMatcher(preset="fast", **span)(scene.left, scene.right).values
        guessed = np.isfinite(values) & ~np.isfinite(reference) & seen & scene.non_occluded
        error, truth = np.abs(values - scene.truth)[guessed], scene.truth[guessed]
        rows.append([*(100 * (error > limit).mean() for limit in (1, 2, 3)), 100 * wrong_as_d1(error, truth).mean()])
    for name, part in (("even half", rows[::2]), ("odd half", rows[1::2])):
        means = np.nanmean(part, axis=0)
        print(
            f"{name}: " + ", ".join(f"{m} {v:.0f}" for m, v in zip(("bad1", "bad2", "bad3", "d1"), means, strict=True))
        )


if __name__ == "__main__":
    main()
