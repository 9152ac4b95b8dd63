"""Which right image belongs to which left one.

Pairs are made by name only, never by position in a listing: one missing file would shift every pair after it, and a
pair shifted by one frame looks plausible on a slow robot.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from epiline._images import is_image_name

FOLDER_NAMES = (
    ("left", "right"),
    ("image_0", "image_1"),
    ("image_00", "image_01"),
    ("image_2", "image_3"),
    ("image_02", "image_03"),
    ("cam0", "cam1"),
    ("cam_0", "cam_1"),
    ("im0", "im1"),
    ("l", "r"),
)

# A word of its own at its start ("left01", "a_right", "camLeft", but not "bright"), or one letter between separators.
_WORD = re.compile(r"(?<![A-Za-z])(?i:left|right)|(?<=[a-z])(?:Left|Right)")
_LETTER = re.compile(r"(?<![A-Za-z0-9])([lr])(?![A-Za-z])", re.IGNORECASE)
_NUMBERED = re.compile(r"(?<![A-Za-z])(im|img|image|cam|camera)(_?0?)([0-9])(?![0-9])", re.IGNORECASE)
# Companions of a pair in data sets, which are no photographs.
_NO_PHOTOGRAPH = re.compile(
    r"(?<![a-z])(gt|truth|disp|disparity|depth|mask|occ|occl|nocc|conf)(?![a-z])", re.IGNORECASE
)


@dataclass(frozen=True)
class ImagePair:
    """Two files of one moment, and what to call them."""

    name: str
    left: Path
    right: Path


@dataclass(frozen=True)
class Pairing:
    """The pairs in natural order, and the images of each side that have no partner."""

    pairs: tuple[ImagePair, ...]
    unpaired_left: tuple[Path, ...] = ()
    unpaired_right: tuple[Path, ...] = ()

    @property
    def unpaired(self) -> tuple[Path, ...]:
        """Those of both sides."""
        return tuple(sorted(self.unpaired_left + self.unpaired_right, key=natural_key))


def natural_key(path: Path) -> tuple[tuple[int, int, str], ...]:
    """Sorts img2 before img10."""
    pieces = re.split(r"(\d+)", str(path).lower())
    return tuple((1, int(piece), "") if piece.isdigit() else (0, 0, piece) for piece in pieces)


def images_in(folder: Path) -> list[Path]:
    """The photographs of a folder in natural order, without a data set's truth and masks."""
    names = (entry for entry in folder.iterdir() if is_image_name(entry) and entry.is_file())
    return sorted((entry for entry in names if not _NO_PHOTOGRAPH.search(entry.stem)), key=natural_key)


def find_folders(root: Path) -> tuple[Path, Path] | None:
    """The two folders of a stereo recording below `root`, if it has them (also ``cam0/data``, as EuRoC and KITTI)."""
    for left_name, right_name in FOLDER_NAMES:
        found = []
        for name in (left_name, right_name):
            folder = next((entry for entry in (root / name, root / name.capitalize()) if entry.is_dir()), None)
            if folder is not None and (folder / "data").is_dir():
                folder = folder / "data"
            found.append(folder)
        if found[0] is not None and found[1] is not None:
            return found[0], found[1]
    return None


def pair_names(files: Sequence[Path]) -> Pairing:
    """Pairs images whose names say which side they are, such as ``left01.jpg`` and ``right01.jpg``.

    Names without a side are left alone. Raises ValueError where no name tells a side or two names mean the same.
    """
    left: list[Path] = []
    right: list[Path] = []
    numbered = _numbered_are_sides(files)
    for file in files:
        side, _ = _side_and_rest(file.stem, numbered=numbered)
        if side is not None:
            (left if side == "left" else right).append(file)
    if not left and not right:
        examples = ", ".join(file.name for file in files[:3])
        raise ValueError(
            f"{_place(files)}: none of its {len(files)} images ({examples}, …) says whether it is left or right; "
            "name them left01/right01, a_left/a_right or im0/im1, or give two folders or globs"
        )
    return _pair_by(left, right, lambda file: _numbers_plain(_side_and_rest(file.stem, numbered=numbered)[1]))


def pair_lists(left: Sequence[Path], right: Sequence[Path]) -> Pairing:
    """Pairs two lists by what their names share: the name without its side, or else the last number in it.

    Raises ValueError where two names of one side mean the same moment.
    """
    by_name = _pair_by(left, right, lambda file: _numbers_plain(_side_and_rest(file.stem, numbered=False)[1]))
    if by_name.pairs:
        return by_name
    return _pair_by(left, right, _last_number)


def pair_mixed(files: Sequence[Path]) -> Pairing:
    """Pairs one list holding both sides, as a shell makes it from ``left/*.png right/*.png`` or ``*.png``."""
    folders = list(dict.fromkeys(file.parent for file in files))
    if len(folders) == 2:
        first, second = ([file for file in files if file.parent == folder] for folder in folders)
        side, _ = _side_and_rest(folders[0].name, numbered=False)
        return pair_lists(second, first) if side == "right" else pair_lists(first, second)
    return pair_names(sorted(files, key=natural_key))


def _pair_by(left: Iterable[Path], right: Iterable[Path], key: Callable[[Path], str | None]) -> Pairing:
    by_side: list[dict[str, Path]] = []
    unpaired: list[list[Path]] = [[], []]
    for files, nameless in zip((left, right), unpaired, strict=True):
        table: dict[str, Path] = {}
        for file in files:
            name = key(file)
            if name is None:
                nameless.append(file)
            elif name in table:
                raise ValueError(f"{table[name]} and {file.name} would both be the same frame: rename one of them")
            else:
                table[name] = file
        by_side.append(table)
    lefts, rights = by_side
    common = sorted(lefts.keys() & rights.keys(), key=lambda name: natural_key(lefts[name]))
    pairs = tuple(ImagePair(lefts[name].stem, lefts[name], rights[name]) for name in common)
    unpaired[0] += [file for name, file in lefts.items() if name not in rights]
    unpaired[1] += [file for name, file in rights.items() if name not in lefts]
    alone_left, alone_right = (tuple(sorted(files, key=natural_key)) for files in unpaired)
    return Pairing(pairs, alone_left, alone_right)


def _side_and_rest(stem: str, *, numbered: bool) -> tuple[Literal["left", "right"] | None, str]:
    """The side a name tells, and the name without it."""
    for pattern in (_WORD, _LETTER):
        if found := pattern.search(stem):
            side: Literal["left", "right"] = "left" if found.group().lower().startswith("l") else "right"
            return side, stem[: found.start()] + "*" + stem[found.end() :]
    if numbered and (found := _NUMBERED.search(stem)) and found.group(3) in "01":
        return "left" if found.group(3) == "0" else "right", stem[: found.start()] + "*" + stem[found.end() :]
    return None, stem


def _numbered_are_sides(files: Iterable[Path]) -> bool:
    """im0 and im1 are the sides of a pair, unless an im2 shows that they are frames of a sequence."""
    numbers = {found.group(3) for file in files if (found := _NUMBERED.search(file.stem))}
    return numbers == {"0", "1"}


def _numbers_plain(name: str) -> str:
    """007 and 7 are the same number."""
    return re.sub(r"\d+", lambda digits: str(int(digits.group())), name)


def _last_number(file: Path) -> str | None:
    numbers = re.findall(r"\d+", file.stem)
    return str(int(numbers[-1])) if numbers else None


def _place(files: Sequence[Path]) -> str:
    return str(files[0].parent) if files else "no files"
