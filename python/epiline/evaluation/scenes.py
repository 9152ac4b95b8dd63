"""A rectified pair with ground truth, whatever folder it came from."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline._images import read_image, read_levels
from epiline.evaluation.readers import read_disparity

Benchmark: TypeAlias = Literal["common", "middlebury", "kitti2012", "kitti2015"]
"""Whose measures a scene is scored with; ETH3D's are Middlebury's."""

# Left and right truth of a point seen by both cameras agree to this, px.
_CROSS_CHECK_PX = 1.0
_VISIBLE = 255


@dataclass(frozen=True)
class TruthFile:
    """A file of disparity; what it stores is `scale` times the disparity in pixels."""

    path: Path
    scale: float = 1.0

    def read(self) -> NDArray[np.float32]:
        """(H, W) float32 px, NaN where unknown."""
        values = read_disparity(self.path, scale=self.scale)
        # No scene is infinitely far away: a truth of zero is a hole, in float files too.
        values[values == 0] = np.nan
        return values


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A rectified pair with ground truth; files are read when asked for.

    Attributes
    ----------
    name : str
        ``middlebury2003/cones``: the family, then the scene.
    left_path, right_path : Path
    num_disparities : int
        Disparities to search, as the data set gives them.
    truth_file : TruthFile
        Of the left image, all pixels.
    right_truth_file : TruthFile, optional
        Of the right image: what it does not confirm is occluded.
    non_occluded_file : TruthFile, optional
        A second truth of the left image that has only what both cameras see (KITTI).
    mask_path : Path, optional
        255 where both cameras see a pixel.
    objects_path : Path, optional
        Above zero on moving objects (KITTI 2015).
    benchmark : str
    """

    name: str
    left_path: Path
    right_path: Path
    num_disparities: int
    truth_file: TruthFile
    right_truth_file: TruthFile | None = None
    non_occluded_file: TruthFile | None = None
    mask_path: Path | None = None
    objects_path: Path | None = None
    benchmark: Benchmark = "common"

    @property
    def family(self) -> str:
        return self.name.split("/", 1)[0]

    @cached_property
    def left(self) -> NDArray[np.uint8]:
        """(H, W) or (H, W, 3) uint8."""
        return read_image(self.left_path)

    @cached_property
    def right(self) -> NDArray[np.uint8]:
        """Same size as the left."""
        image = read_image(self.right_path)
        self._require_size(image.shape, self.right_path)
        return image

    @cached_property
    def truth(self) -> NDArray[np.float32]:
        """(H, W) float32 px, NaN where unknown."""
        return self._read_truth(self.truth_file)

    @cached_property
    def non_occluded(self) -> NDArray[np.bool_]:
        """(H, W): pixels with a truth that both cameras see, as far as the data set tells."""
        seen = np.isfinite(self.truth)
        if self.non_occluded_file:
            seen &= np.isfinite(self._read_truth(self.non_occluded_file))
        if self.right_truth_file:
            seen &= agrees_with_right(self.truth, self._read_truth(self.right_truth_file))
        if self.mask_path:
            mask = read_image(self.mask_path, channels="grey")
            self._require_size(mask.shape, self.mask_path)
            seen &= mask == _VISIBLE
        return seen

    @cached_property
    def foreground(self) -> NDArray[np.bool_] | None:
        """(H, W): moving objects, where the data set marks them."""
        if self.objects_path is None:
            return None
        levels = read_levels(self.objects_path)
        self._require_size(levels.shape, self.objects_path)
        return np.asarray((levels if levels.ndim == 2 else levels[..., 0]) > 0)

    def _read_truth(self, file: TruthFile) -> NDArray[np.float32]:
        values = file.read()
        self._require_size(values.shape, file.path)
        return values

    def _require_size(self, shape: tuple[int, ...], path: Path) -> None:
        height, width = self.left.shape[:2]
        if shape[:2] != (height, width):
            raise ValueError(f"{path}: {shape[1]}x{shape[0]} px, but {self.left_path.name} has {width}x{height} px")


def agrees_with_right(left: NDArray[np.float32], right: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(H, W): left pixels whose partner in the right truth points back at them."""
    width = left.shape[1]
    columns = np.arange(width)[None, :]
    known = np.isfinite(left)
    partner = np.rint(columns - np.where(known, left, 0)).astype(int)
    inside = known & (partner >= 0) & (partner < width)
    back = np.take_along_axis(right, np.clip(partner, 0, width - 1), axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(inside & (np.abs(back - left) <= _CROSS_CHECK_PX), bool)


def whole_steps(disparities: float) -> int:
    """The next multiple of 16."""
    return max(16, -(-int(np.ceil(disparities)) // 16) * 16)
