"""Folders as KITTI gives them to download: stereo 2012 and scene flow 2015, the training halves.

* 2012: ``training/colored_0 colored_1`` (or ``image_0 image_1``), ``disp_noc``, ``disp_occ``
* 2015: ``training/image_2 image_3``, ``disp_noc_0``, ``disp_occ_0``, ``obj_map``
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from epiline.evaluation.scenes import Benchmark, Scene, TruthFile

_SCALE = 256
# Both years' truths stay below 230 px; most programs search 192.
_DISPARITIES = 192
# Left, right, occluded truth, non-occluded truth, moving objects.
_LAYOUTS: tuple[tuple[Benchmark, str, str, str, str, str], ...] = (
    ("kitti2015", "image_2", "image_3", "disp_occ_0", "disp_noc_0", "obj_map"),
    ("kitti2012", "colored_0", "colored_1", "disp_occ", "disp_noc", ""),
    ("kitti2012", "image_0", "image_1", "disp_occ", "disp_noc", ""),
)


def kitti_scenes(root: Path) -> Iterator[Scene]:
    """Every training frame with ground truth, by number; `root` is the download or its folder ``training``."""
    training = root / "training" if (root / "training").is_dir() else root
    for benchmark, left, right, occluded, non_occluded, objects in _LAYOUTS:
        if not (training / left).is_dir():
            continue
        folder = next((f for f in (occluded, non_occluded) if (training / f).is_dir()), None)
        if folder is None:
            continue
        for truth in sorted((training / folder).glob("*_10.png")):
            seen = training / non_occluded / truth.name
            moving = training / objects / truth.name
            yield Scene(
                name=f"{benchmark}/{truth.stem}",
                left_path=training / left / truth.name,
                right_path=training / right / truth.name,
                num_disparities=_DISPARITIES,
                truth_file=TruthFile(truth, _SCALE),
                non_occluded_file=TruthFile(seen, _SCALE) if seen != truth and seen.parent.is_dir() else None,
                objects_path=moving if objects and moving.is_file() else None,
                benchmark=benchmark,
            )
        return
