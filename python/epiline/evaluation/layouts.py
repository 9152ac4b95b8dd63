"""Finds the scenes of a folder, whatever layout it has."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from epiline.evaluation.kitti import kitti_scenes
from epiline.evaluation.manifest import MANIFEST, manifest_scenes
from epiline.evaluation.middlebury import middlebury_scenes
from epiline.evaluation.scenes import Scene


def load_scenes(root: Path) -> Iterator[Scene]:
    """Every scene with ground truth of a folder, by name.

    The folder has a ``manifest.json``, or is laid out as Middlebury (2001 to 2021), KITTI (2012, 2015) or ETH3D
    (two views) are downloaded.

    Raises
    ------
    OSError
        The folder or a file that the layout needs cannot be read.
    ValueError
        The layout is not recognised or holds no ground truth, or a file is not what it should be.
    """
    if not root.is_dir():
        raise FileNotFoundError(2, "no such folder", str(root))
    if (root / MANIFEST).is_file():
        yield from manifest_scenes(root)
        return
    found = False
    for layout in (kitti_scenes, middlebury_scenes):
        for scene in layout(root):
            found = True
            yield scene
        if found:
            return
    raise ValueError(
        f"{root}: no scene with ground truth; expected manifest.json or the layout of Middlebury "
        "(im0/im2/view1 with disp…), KITTI (training/image_2 with disp_occ_0, …) or ETH3D (im0.png, disp0GT.pfm)"
    )
