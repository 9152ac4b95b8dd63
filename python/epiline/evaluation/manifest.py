"""Scenes named by a `manifest.json`, which says where everything is."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from epiline.evaluation.scenes import Scene, TruthFile, whole_steps

MANIFEST = "manifest.json"
_NEEDED = {"left", "right", "gt", "gt_scale", "num_disp"}


def manifest_scenes(root: Path) -> Iterator[Scene]:
    """Every scene of the manifest that is there, by name.

    Raises
    ------
    OSError
        The manifest cannot be read.
    ValueError
        It is not what it should be, or none of its scenes is there.
    """
    manifest = root / MANIFEST
    try:
        entries = json.loads(manifest.read_text(encoding="utf-8"))
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{manifest}: {error}") from error
    if not isinstance(entries, dict):
        raise ValueError(f"{manifest}: expected an object of scenes by name")
    found = False
    for name, entry in sorted(entries.items()):
        if not isinstance(entry, dict) or not set(entry) >= _NEEDED:
            missing = _NEEDED - set(entry) if isinstance(entry, dict) else _NEEDED
            raise ValueError(f"{manifest}: scene '{name}' lacks {', '.join(sorted(missing))}")
        if (root / name).is_dir():
            found = True
            yield _scene(manifest, name, root / name, entry)
    if not found:
        raise ValueError(f"{manifest}: none of its {len(entries)} scenes is in {root}")


def _scene(manifest: Path, name: str, folder: Path, entry: dict[str, Any]) -> Scene:
    try:
        scale, disparities = float(entry["gt_scale"]), whole_steps(float(entry["num_disp"]))
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{manifest}: scene '{name}': gt_scale and num_disp must be numbers") from error

    def optional(key: str) -> Path | None:
        return folder / entry[key] if entry.get(key) else None

    right_truth = optional("gt_right")
    return Scene(
        name=name,
        left_path=folder / entry["left"],
        right_path=folder / entry["right"],
        num_disparities=disparities,
        truth_file=TruthFile(folder / entry["gt"], scale),
        right_truth_file=TruthFile(right_truth, scale) if right_truth else None,
        mask_path=optional("mask"),
    )
