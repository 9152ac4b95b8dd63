"""Pictures of an evaluation: what was answered, how wrong it is, and why the rest has no answer."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from epiline._pictures import colour_picture, disparity_limits

if TYPE_CHECKING:
    from epiline.evaluation import Scene
    from epiline.evaluation.settings import Method


def write_evaluation_pictures(
    folder: Path, setting: Method, scene: Scene, values: NDArray[np.float32], threads: int | None
) -> None:
    """`SCENE-SETTING-disparity.png`, `-error.png`, and `-reasons.png` for our own settings."""
    from epiline.evaluation.pictures import error_picture
    from epiline.evaluation.settings import Setting
    from epiline.sinks.pictures import write_picture

    stem = re.sub(r"[^A-Za-z0-9_]+", "-", f"{scene.name} {setting.name}").strip("-")
    # The truth's limits, so that the maps of all settings can be laid side by side.
    limits = disparity_limits([scene.truth])
    write_picture(folder / f"{stem}-disparity.png", colour_picture(values, limits_px=limits))
    write_picture(folder / f"{stem}-error.png", error_picture(values, scene.truth, scene.non_occluded))
    if isinstance(setting, Setting):
        reasons = setting.map(scene.left, scene.right, scene.num_disparities, threads).validity
        write_picture(folder / f"{stem}-reasons.png", _reasons(reasons))


def _reasons(validity: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(H, W, 3): black where measured, else the colour of the first reason, as in the report."""
    from epiline.report.reasons import REASONS, first_reason

    palette = np.array([(0, 0, 0), *(reason.bgr for reason in REASONS)], np.uint8)
    return np.ascontiguousarray(palette[first_reason(validity)])
