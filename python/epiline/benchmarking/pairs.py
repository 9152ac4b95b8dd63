"""The pair that is matched: a real photograph where there is one, else a rendered scene."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from epiline._core import CameraModel, Rectifier, StereoCalibration, grey

# Sharp edges, slanted and textureless surfaces, and a range of disparities that fits the sizes measured.
_PREFERRED = "Motorcycle"


@dataclass(frozen=True)
class Pair:
    """An aligned pair: (H, W) uint8 each, and what it shows."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    name: str

    def resized(self, width: int, height: int) -> Pair:
        import cv2

        left, right = (cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA) for image in self._images())
        return Pair(np.asarray(left, np.uint8), np.asarray(right, np.uint8), self.name)

    def _images(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
        return self.left, self.right


@cache
def pair_from(data: Path | None) -> Pair:
    """A scene of the folder `data`, or of the rendered rig if that is None."""
    return _rendered() if data is None else _photographs(data)


def _photographs(data: Path) -> Pair:
    from epiline.evaluation import load_scenes

    scenes = list(load_scenes(data))
    scene = next((s for s in scenes if _PREFERRED in s.name), scenes[0])
    return Pair(grey(scene.left), grey(scene.right), scene.name)


def _rendered() -> Pair:
    from epiline.sources.rendered import RenderedRig

    rig = RenderedRig(size=(640, 480))
    (frame,) = rig.frames(1)
    truth = rig.truth
    left, right = (
        CameraModel(c.camera_matrix, (*c.distortion, 0.0), width=c.width, height=c.height)
        for c in (truth.left, truth.right)
    )
    aligned = Rectifier(StereoCalibration(left, right, truth.rotation, truth.translation_m))(frame.left, frame.right)
    return Pair(grey(aligned.left), grey(aligned.right), "rendered workshop")
