"""From what a person writes on the command line to a source."""

from __future__ import annotations

import glob
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, TypeAlias

from epiline._images import StrPath, is_image_name
from epiline.sources.base import Source
from epiline.sources.files import ImagePairs, SideBySideImages
from epiline.sources.pairing import (
    ImagePair,
    Pairing,
    find_folders,
    images_in,
    natural_key,
    pair_lists,
    pair_mixed,
    pair_names,
)
from epiline.sources.videos import VIDEO_SUFFIXES, SideBySideVideo, TwoVideos

Unpaired: TypeAlias = Literal["error", "skip"]


def open_source(
    spec: StrPath | Sequence[StrPath],
    *,
    layout: Literal["separate", "side-by-side"] = "separate",
    unpaired: Unpaired = "error",
) -> Source:
    """Opens stereo pairs from files, or the rendered rig.

    Parameters
    ----------
    spec : path-like, str, or sequence of them
        One of

        - a folder with ``left/`` and ``right/`` (or ``image_0/image_1``, ``image_2/image_3``, ``cam0/cam1``, …);
        - a folder or glob of images whose names tell the side (``left01.jpg``/``right01.jpg``, ``a_left``/``a_right``,
          ``im0``/``im1``);
        - two folders, globs or image files: left, then right; or a longer list of image files;
        - two video files;
        - ``sbs:PATH``: a video, image, glob or folder with both views side by side;
        - ``demo:``, optionally with ``frames``, ``seed`` and ``size``: ``demo:frames=40,size=320x240``.
    layout : {"separate", "side-by-side"}
        ``"side-by-side"`` is what the prefix ``sbs:`` says.
    unpaired : {"error", "skip"}
        What to do about a left image without its right one: refuse, or leave it out. The source's ``pairing``
        lists what was left out.

    Returns
    -------
    Source

    Raises
    ------
    ValueError
        The spec names no pairs, names do not pair up, or sizes or lengths differ.
    OSError
        A file is missing, unreadable, truncated or no image.
    """
    specs: list[StrPath] = [spec] if isinstance(spec, str) or not isinstance(spec, Sequence) else list(spec)
    if not specs:
        raise ValueError("no source given")
    if len(specs) == 1:
        if (scheme := _scheme_of(specs[0])) is not None:
            opener, rest = scheme
            return opener(rest)
        if layout == "side-by-side":
            return _open_side_by_side(str(specs[0]))
        return _open_one(Path(specs[0]), unpaired)
    if layout == "side-by-side":
        return SideBySideImages([_existing(Path(entry)) for entry in specs])
    if len(specs) == 2:
        return _open_two(Path(specs[0]), Path(specs[1]), unpaired)
    files = [_existing(Path(entry)) for entry in specs]
    return _image_pairs(pair_mixed(files), f"{files[0].parent}", unpaired)


def _open_one(path: Path, unpaired: Unpaired) -> Source:
    if path.is_dir():
        folders = find_folders(path)
        if folders is not None:
            return _open_two(*folders, unpaired)
        return _image_pairs(pair_names(_images_in(path)), str(path), unpaired)
    if _is_glob(path):
        return _image_pairs(pair_mixed(_expand(path)), str(path), unpaired)
    _existing(path)
    if path.suffix.lower() in VIDEO_SUFFIXES or is_image_name(path):
        raise ValueError(f"{path}: one file is no pair: give left and right, or sbs:{path} if it holds both views")
    raise ValueError(f"{path}: neither a folder, an image nor a video")


def _open_two(left: Path, right: Path, unpaired: Unpaired) -> Source:
    kinds = {_kind(path) for path in (left, right)}
    if len(kinds) > 1:
        raise ValueError(f"{left} and {right} are not of one kind: give two folders, globs, images or videos")
    kind = kinds.pop()
    if kind == "video":
        return TwoVideos(left, right)
    if kind == "image":
        return ImagePairs(Pairing((ImagePair(left.stem, left, right),)))
    lists = [_images_in(path) if kind == "folder" else _expand(path) for path in (left, right)]
    return _image_pairs(pair_lists(*lists), f"{left} and {right}", unpaired)


def _open_side_by_side(spec: str) -> Source:
    path = Path(spec)
    if path.is_dir():
        return SideBySideImages(_images_in(path))
    if _is_glob(path):
        return SideBySideImages(_expand(path))
    _existing(path)
    return SideBySideImages([path]) if is_image_name(path) else SideBySideVideo(path)


def _open_demo(options: str) -> Source:
    from epiline.sources.rendered import RenderedRig

    values = {"frames": "12", "seed": "0", "size": "640x480"}
    for option in filter(None, options.split(",")):
        key, _, value = option.partition("=")
        if key not in values:
            raise ValueError(f"demo:{options}: unknown option {key!r}; there are frames, seed and size")
        values[key] = value
    size = re.fullmatch(r"(\d+)x(\d+)", values["size"])
    if size is None or not values["frames"].isdigit() or not values["seed"].isdigit():
        raise ValueError(f"demo:{options}: write it as demo:frames=12,seed=0,size=640x480")
    rig = RenderedRig(seed=int(values["seed"]), size=(int(size[1]), int(size[2])))
    return rig.frames(int(values["frames"]))


# Cameras, bags and network streams register here.
_SCHEMES: dict[str, Callable[[str], Source]] = {"demo": _open_demo, "sbs": _open_side_by_side}


def _scheme_of(spec: StrPath) -> tuple[Callable[[str], Source], str] | None:
    # Two letters at least: C:\ is a drive.
    found = re.match(r"([a-z][a-z0-9+-]+):(.*)", spec, re.DOTALL) if isinstance(spec, str) else None
    if found is None or Path(str(spec)).exists():
        return None
    if found[1] not in _SCHEMES:
        known = ", ".join(f"{name}:" for name in sorted(_SCHEMES))
        raise ValueError(f"{spec}: sources that begin with {found[1]}: are not known; known are {known}")
    return _SCHEMES[found[1]], found[2]


def _kind(path: Path) -> Literal["folder", "glob", "video", "image"]:
    if path.is_dir():
        return "folder"
    if _is_glob(path):
        return "glob"
    _existing(path)
    return "video" if path.suffix.lower() in VIDEO_SUFFIXES else "image"


def _is_glob(path: Path) -> bool:
    return glob.has_magic(str(path)) and not path.exists()


def _expand(pattern: Path) -> list[Path]:
    files = [Path(name) for name in glob.glob(str(pattern))]
    files = sorted((file for file in files if is_image_name(file)), key=natural_key)
    if not files:
        raise FileNotFoundError(f"{pattern}: no image has such a name")
    return files


def _images_in(folder: Path) -> list[Path]:
    files = images_in(folder)
    if not files:
        raise FileNotFoundError(f"{folder}: no images in this folder")
    return files


def _existing(path: Path) -> Path:
    if not path.exists():
        raise FileNotFoundError(f"{path}: no such file or folder")
    return path


def _image_pairs(pairing: Pairing, place: str, unpaired: Unpaired) -> ImagePairs:
    lost = pairing.unpaired
    if not pairing.pairs:
        raise ValueError(f"{place}: no left image has a right one of the same name or number")
    if lost and unpaired == "error":
        names = ", ".join(str(file) for file in lost[:3]) + (", …" if len(lost) > 3 else "")
        raise ValueError(f"{place}: {len(lost)} images without a partner beside {len(pairing.pairs)} pairs: {names}")
    return ImagePairs(pairing)
