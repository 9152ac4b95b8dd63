"""Folders as Middlebury and ETH3D give them to download.

* 2001: ``im2 im6 disp2 disp6``; Tsukuba: ``scene1.row3.col3/4``, ``truedisp.row3.col3``
* 2003: ``im2 im6 disp2 disp6`` at quarter, half or full size
* 2005, 2006: ``view1 view5 disp1 disp5`` at third, half or full size
* 2014, 2021 and the third evaluation: ``im0 im1 calib.txt`` with ``disp0.pfm`` (and ``disp1.pfm``), or
  ``disp0GT.pfm`` and ``mask0nocc.png``
* ETH3D's two-view sets: the same names; truth may lie in ``two_view_training_gt`` beside ``two_view_training``
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path

from epiline._images import read_image
from epiline.evaluation.scenes import Scene, TruthFile, whole_steps

# Stored truth is an 8-bit number: with a scale of 4, no disparity reaches 256 / 4 px.
_LEVELS = 256
_SCALE_2001, _SCALE_TSUKUBA = 8, 16
_SCALE_2003 = {(450, 375): 4, (900, 750): 2, (1800, 1500): 1}
_SCALE_2005 = {370: 3, 555: 2, 1110: 1}
# 2001's images are all about this tall.
_TALLEST_2001 = 400
_ETH3D_SCENE = re.compile(r"(delivery_area|electro|facade|forest|playground|terrace|terrains)_\d[ls]")
# ETH3D's calib.txt gives the image's width as its number of disparities; none of its scenes needs more than this.
_ETH3D_DISPARITIES = 64
_PICTURES = (".png", ".ppm", ".pgm")


def middlebury_scenes(root: Path) -> Iterator[Scene]:
    """Every scene with ground truth in a folder or the two levels below it, by name."""
    folders = [root, *sorted(root.glob("*/")), *sorted(root.glob("*/*/"))]
    for folder in (f for f in folders if f.is_dir()):
        for recognise in (_of_2014, _of_2005, _of_2001_or_2003, _tsukuba):
            scene = recognise(root, folder)
            if scene:
                yield scene
                break


def _of_2014(root: Path, folder: Path) -> Scene | None:
    left = folder / "im0.png"
    # ETH3D packs images and truth apart.
    beside = folder.parent.with_name(f"{folder.parent.name}_gt") / folder.name
    places = [p / name for p in (folder, beside) for name in ("disp0.pfm", "disp0GT.pfm")]
    truth = next((p for p in places if p.is_file()), None)
    if truth is None or not left.is_file():
        return None
    eth3d = bool(_ETH3D_SCENE.fullmatch(folder.name)) or (folder / "cameras.txt").is_file()
    mask, right_truth = truth.with_name("mask0nocc.png"), truth.with_name("disp1.pfm")
    return Scene(
        name=_name("eth3d" if eth3d else "middlebury2014-2021", root, folder),
        left_path=left,
        right_path=folder / "im1.png",
        num_disparities=_disparities_of(folder / "calib.txt", left, eth3d=eth3d),
        truth_file=TruthFile(truth),
        right_truth_file=TruthFile(right_truth) if right_truth.is_file() and not mask.is_file() else None,
        mask_path=mask if mask.is_file() else None,
        benchmark="middlebury",
    )


def _of_2005(root: Path, folder: Path) -> Scene | None:
    left, truth = folder / "view1.png", folder / "disp1.png"
    if not (left.is_file() and truth.is_file()):
        return None
    width, height = _size(left)
    scale = _SCALE_2005.get(height)
    if scale is None:
        raise ValueError(
            f"{left}: {width}x{height} px is no size of Middlebury 2005 or 2006 (370, 555 or 1110 rows), "
            "so the scale of its truth is unknown"
        )
    return _stored_as_levels("middlebury2005-2006", root, folder, ("view1", "view5", "disp1", "disp5"), scale)


def _of_2001_or_2003(root: Path, folder: Path) -> Scene | None:
    left, truth = _picture(folder, "im2"), _picture(folder, "disp2")
    if left is None or truth is None:
        return None
    width, height = _size(left)
    scale = _SCALE_2003.get((width, height))
    names = ("im2", "im6", "disp2", "disp6")
    if scale is not None:
        return _stored_as_levels("middlebury2003", root, folder, names, scale)
    if height > _TALLEST_2001:
        raise ValueError(
            f"{left}: {width}x{height} px is no size of Middlebury 2001 or 2003, so the scale of its truth is unknown"
        )
    return _stored_as_levels("middlebury2001", root, folder, names, _SCALE_2001)


def _tsukuba(root: Path, folder: Path) -> Scene | None:
    left, truth = folder / "scene1.row3.col3.ppm", folder / "truedisp.row3.col3.pgm"
    if not (left.is_file() and truth.is_file()):
        return None
    return Scene(
        name=_name("middlebury2001", root, folder),
        left_path=left,
        right_path=folder / "scene1.row3.col4.ppm",
        num_disparities=_LEVELS // _SCALE_TSUKUBA,
        truth_file=TruthFile(truth, _SCALE_TSUKUBA),
        benchmark="middlebury",
    )


def _stored_as_levels(family: str, root: Path, folder: Path, names: tuple[str, str, str, str], scale: int) -> Scene:
    """A scene whose truth is 8-bit pictures; left and right image, left and right truth by their stems."""
    left, right, truth, right_truth = (_picture(folder, name) for name in names)
    assert left is not None
    assert truth is not None
    return Scene(
        name=_name(family, root, folder),
        left_path=left,
        # A file that is not there is named when it is read.
        right_path=right or left.with_stem(names[1]),
        num_disparities=whole_steps(_LEVELS / scale),
        truth_file=TruthFile(truth, scale),
        right_truth_file=TruthFile(right_truth, scale) if right_truth else None,
        benchmark="middlebury",
    )


def _picture(folder: Path, stem: str) -> Path | None:
    return next((p for suffix in _PICTURES if (p := folder / f"{stem}{suffix}").is_file()), None)


def _name(family: str, root: Path, folder: Path) -> str:
    inside = folder.relative_to(root).as_posix()
    return f"{family}/{folder.resolve().name if inside == '.' else inside}"


def _size(image: Path) -> tuple[int, int]:
    """Width and height; a PNG's from its header alone."""
    with image.open("rb") as file:
        head = file.read(24)
    if head.startswith(b"\x89PNG\r\n\x1a\n") and len(head) == 24:
        width, height = struct.unpack(">II", head[16:])
        return width, height
    height, width = read_image(image).shape[:2]
    return width, height


def _disparities_of(calib: Path, left: Path, *, eth3d: bool) -> int:
    """The entry ``ndisp`` of a `calib.txt`, at most the image's width."""
    if eth3d:
        return _ETH3D_DISPARITIES
    text = calib.read_text(encoding="utf-8", errors="replace")
    entry = re.search(r"^ndisp\s*=\s*(\d{1,6})\s*$", text, re.M)
    if entry is None or int(entry[1]) < 1:
        raise ValueError(f"{calib}: no entry 'ndisp=N' with a whole number of disparities")
    return min(whole_steps(int(entry[1])), _size(left)[0])
