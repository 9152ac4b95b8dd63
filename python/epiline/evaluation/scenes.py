"""Scenes with ground truth: a folder with a `manifest.json` that says where everything is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epiline._images import read_image
from epiline.evaluation.readers import read_disparity

# Left and right truth of a point seen by both cameras agree to this, px.
_CROSS_CHECK_PX = 1.0
_VISIBLE = 255


@dataclass(frozen=True)
class Scene:
    """A rectified pair with ground truth; files are read when asked for.

    Attributes
    ----------
    name, family : str
        ``middlebury2003/cones`` and ``middlebury2003``.
    folder : Path
    entry : dict
        The scene's entry in the manifest.
    """

    name: str
    folder: Path
    entry: dict[str, Any]

    @property
    def family(self) -> str:
        return self.name.split("/", 1)[0]

    @property
    def num_disparities(self) -> int:
        """Disparities to search, a multiple of 16, as the data set gives them."""
        return -(-int(self.entry["num_disp"]) // 16) * 16

    @cached_property
    def left(self) -> NDArray[np.uint8]:
        """(H, W) or (H, W, 3) uint8."""
        return read_image(self.folder / self.entry["left"])

    @cached_property
    def right(self) -> NDArray[np.uint8]:
        """Same size as the left."""
        return read_image(self.folder / self.entry["right"])

    @cached_property
    def truth(self) -> NDArray[np.float32]:
        """(H, W) float32 px, NaN where unknown."""
        return self._read_truth("gt")

    @cached_property
    def non_occluded(self) -> NDArray[np.bool_]:
        """(H, W): pixels with a truth that both cameras see, as far as the data set tells."""
        seen = np.isfinite(self.truth)
        if self.entry.get("gt_right"):
            seen &= agrees_with_right(self.truth, self._read_truth("gt_right"))
        if self.entry.get("mask"):
            mask = read_image(self.folder / self.entry["mask"], channels="grey")
            if mask.shape == seen.shape:
                seen &= mask == _VISIBLE
        return seen

    def _read_truth(self, key: str) -> NDArray[np.float32]:
        values = read_disparity(self.folder / self.entry[key], scale=float(self.entry["gt_scale"]))
        # No scene is infinitely far away: a truth of zero is a hole, in float files too.
        values[values == 0] = np.nan
        return values


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


def load_scenes(root: Path) -> Iterator[Scene]:
    """Every scene of a folder that its manifest names and that is there, by name.

    Raises
    ------
    OSError
        No manifest.
    ValueError
        The manifest is not what it should be, or none of its scenes is there.
    """
    manifest = root / "manifest.json"
    try:
        entries = json.loads(manifest.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise ValueError(f"{manifest}: {error}") from error
    needed = {"left", "right", "gt", "gt_scale", "num_disp"}
    found = False
    for name, entry in sorted(entries.items()):
        if not isinstance(entry, dict) or not needed <= set(entry):
            raise ValueError(f"{manifest}: scene '{name}' lacks {', '.join(sorted(needed - set(entry)))}")
        if (root / name).is_dir():
            found = True
            yield Scene(name, root / name, entry)
    if not found:
        raise ValueError(f"{manifest}: none of its {len(entries)} scenes is in {root}")
