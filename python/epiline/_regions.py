"""Sets of regions in a TOML file: in pixels, in shares of the image, or in metres."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from epiline._core import CameraOverGround, RectifiedGeometry, Region, Slab, paper_regions

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

StrPath: TypeAlias = str | os.PathLike[str]

_PIXELS = ("x", "y", "width", "height")
_SLAB = ("height_m", "range_m", "lateral_m")
_CAMERA = ("height_m", "pitch_deg", "roll_deg")
_KNOWN = ("name", *_PIXELS, "shares", *_SLAB, "disparities")


@dataclass(frozen=True)
class RegionSet:
    """Regions as a file describes them; :meth:`place` makes boxes of pixels of them.

    Attributes
    ----------
    entries : tuple of mappings
        One for each region, checked.
    camera : CameraOverGround, optional
        How the camera stands, for regions in metres.
    where : str
        Names the set in messages.
    """

    entries: tuple[Mapping[str, Any], ...]
    camera: CameraOverGround | None
    where: str

    def place(
        self,
        *,
        image_size: tuple[int, int] | None = None,
        geometry: RectifiedGeometry | None = None,
        camera: CameraOverGround | None = None,
    ) -> list[Region]:
        """The regions of an image.

        Parameters
        ----------
        image_size : (int, int), optional
            Width and height of the aligned image, px; the geometry's by default.
        geometry : RectifiedGeometry, optional
            Projects regions in metres.
        camera : CameraOverGround, optional
            How the camera stands, instead of what the file says; for example as estimated from the ground it sees.

        Raises
        ------
        ValueError
            A region that lies outside the image, or that needs a size, a geometry or a camera that is not given; the
            message names the file and the region.
        """
        size = (geometry.width, geometry.height) if geometry is not None else image_size
        placed: list[Region] = []
        for number, entry in enumerate(self.entries, start=1):
            where = f"{self.where}: region {number}"
            if "paper" in entry:
                placed += paper_regions(*_given(size, where, "the size of the image"))
                continue
            name = entry["name"]
            where = f"{where} '{name}'"
            try:
                if "height_m" in entry:
                    stand = _given(camera or self.camera, where, "a [camera] with height_m, in metres above the ground")
                    slab = Slab(**{key: tuple(entry[key]) for key in _SLAB if key in entry})
                    placed.append(Region.in_space(name, slab, stand, _given(geometry, where, "the geometry of a rig")))
                    continue
                if "shares" in entry:
                    x, y, width, height = entry["shares"]
                    box = Region.from_shares(
                        name, x=x, y=y, width=width, height=height, image_size=_given(size, where, "the image's size")
                    )
                    pixels: dict[str, Any] = {"x": box.x, "y": box.y, "width": box.width, "height": box.height}
                else:
                    pixels = {key: entry[key] for key in _PIXELS}
                search: dict[str, Any] = {key: tuple(entry[key]) for key in ("disparities", "range_m") if key in entry}
                placed.append(Region(name, **pixels, **search))
            except ValueError as error:
                message = str(error)
                raise ValueError(message if message.startswith(where) else f"{where}: {message}") from error
        return placed


def _given(value: Any, where: str, what: str) -> Any:
    if value is None:
        raise ValueError(f"{where}: needs {what}")
    return value


def read_region_sets(path: StrPath) -> dict[str, RegionSet]:
    """Reads the named sets of regions of a TOML file.

    Each entry of the table ``[regions]`` is a set: a list of regions, or the word ``"paper"`` for the 2011 paper's four
    bands. A list ``[[regions]]`` is one set without a name, ``""``. A region has a ``name`` and one of

    - ``x``, ``y``, ``width``, ``height``: whole pixels of the left aligned image;
    - ``shares = [x, y, width, height]``: the same as shares of its width and height, 0 to 1;
    - ``height_m = [low, high]``, ``range_m = [near, far]`` and optionally ``lateral_m = [left, right]``: a layer over
      the ground, metres, seen by a camera that stands as ``[camera]`` says (``height_m``; ``pitch_deg``, positive looks
      down; ``roll_deg``, positive lowers the right side).

    The first two may say what a matcher searches: ``disparities = [first, count]``, px, or ``range_m = [near, far]``.

    Parameters
    ----------
    path : path-like
        The file. Tables other than ``regions`` and ``camera`` are left to others.

    Returns
    -------
    dict of RegionSet
        By name.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no TOML, or an entry is unknown or out of range; the message names file, set, region, value and unit.
    """
    content = read_toml(path)
    if "regions" not in content:
        raise ValueError(f"{path}: has no [regions]")
    return region_sets(content, str(path))


def read_regions(
    path: StrPath,
    name: str | None = None,
    *,
    image_size: tuple[int, int] | None = None,
    geometry: RectifiedGeometry | None = None,
    camera: CameraOverGround | None = None,
) -> list[Region]:
    """The regions of one set of a TOML file (see :func:`read_region_sets`), as boxes of pixels.

    Parameters
    ----------
    path : path-like
        The file.
    name : str, optional
        The set; may be left out where there is only one.
    image_size, geometry, camera
        As :meth:`RegionSet.place` takes them.

    Returns
    -------
    list of Region

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        As both functions named above; or there is no such set.
    """
    chosen = choose_set(read_region_sets(path), name, str(path))
    return chosen.place(image_size=image_size, geometry=geometry, camera=camera)


def choose_set(sets: Mapping[str, RegionSet], name: str | None, where: str) -> RegionSet:
    """The set of that name, or the only one."""
    if name is None and len(sets) == 1:
        return next(iter(sets.values()))
    if name is not None and name in sets:
        return sets[name]
    there = ", ".join(sets)
    asked = "several sets of regions" if name is None else f"no set of regions '{name}'"
    raise ValueError(f"{where}: {asked}; choose one of {there}")


def read_toml(path: StrPath) -> dict[str, Any]:
    """The tables of a TOML file; a message names the file."""
    try:
        content: dict[str, Any] = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from error
    return content


def region_sets(content: Mapping[str, Any], where: str) -> dict[str, RegionSet]:
    """The sets of a file's `regions` and `camera`, already parsed."""
    camera = _camera(content["camera"], where) if "camera" in content else None
    regions = content["regions"]
    named = {"": regions} if isinstance(regions, list) else regions
    if not isinstance(named, dict) or not named:
        raise ValueError(f"{where}: regions = {regions!r}: must be sets of regions, as in [[regions.NAME]]")
    return {name: _set(entries, camera, f"{where}: set '{name}'" if name else where) for name, entries in named.items()}


def _set(entries: Any, camera: CameraOverGround | None, where: str) -> RegionSet:
    if entries == "paper":
        return RegionSet(({"paper": True},), camera, where)
    if not isinstance(entries, list) or not entries:
        raise ValueError(f"{where} = {entries!r}: must be a list of regions, or 'paper'")
    seen: set[str] = set()
    for number, entry in enumerate(entries, start=1):
        _check(entry, f"{where}: region {number}")
        if entry["name"] in seen:
            raise ValueError(f"{where}: region {number}: there is already a region '{entry['name']}'")
        seen.add(entry["name"])
    return RegionSet(tuple(entries), camera, where)


def _check(entry: Any, where: str) -> None:
    if not isinstance(entry, dict) or not isinstance(entry.get("name"), str) or not entry["name"]:
        raise ValueError(f"{where}: must be a table with a name")
    where = f"{where} '{entry['name']}'"
    for key in entry:
        if key not in _KNOWN:
            raise ValueError(f"{where}: {key} is unknown; there are {', '.join(_KNOWN)}")
    pixels = [key for key in _PIXELS if key in entry]
    kinds = sum((bool(pixels), "shares" in entry, "height_m" in entry))
    if kinds != 1 or (pixels and len(pixels) != 4) or ("height_m" in entry and "range_m" not in entry):
        raise ValueError(
            f"{where}: must have exactly one of x, y, width, height (pixels), shares, or height_m with range_m (metres)"
        )
    if "lateral_m" in entry and "height_m" not in entry:
        raise ValueError(f"{where}: lateral_m goes with height_m and range_m")
    if "disparities" in entry and "range_m" in entry:
        raise ValueError(f"{where}: give either disparities or range_m, not both")
    for key in pixels:
        if not _is_whole(entry[key]):
            raise ValueError(f"{where}: {key} = {entry[key]!r} is not a whole number of pixels")
    if "disparities" in entry and not (_is_list(entry["disparities"], 2) and all(map(_is_whole, entry["disparities"]))):
        raise ValueError(f"{where}: disparities = {entry['disparities']!r} are not two whole numbers of pixels")
    if "shares" in entry and not (_is_list(entry["shares"], 4) and all(map(_is_number, entry["shares"]))):
        raise ValueError(f"{where}: shares = {entry['shares']!r} are not four numbers: x, y, width, height")
    for key in _SLAB:
        if key in entry and not (_is_list(entry[key], 2) and all(map(_is_number, entry[key]))):
            raise ValueError(f"{where}: {key} = {entry[key]!r} are not two numbers of metres")


def _camera(table: Any, where: str) -> CameraOverGround:
    where = f"{where}: camera"
    if not isinstance(table, dict) or "height_m" not in table:
        raise ValueError(f"{where} must be a table with a height_m")
    for key, value in table.items():
        if key not in _CAMERA:
            raise ValueError(f"{where}.{key} is unknown; there are {', '.join(_CAMERA)}")
        if not _is_number(value):
            unit = "metres" if key == "height_m" else "degrees"
            raise ValueError(f"{where}.{key} = {value!r} is not a number of {unit}")
    pitch_rad, roll_rad = (math.radians(table.get(key, 0.0)) for key in _CAMERA[1:])
    try:
        return CameraOverGround(table["height_m"], pitch_rad=pitch_rad, roll_rad=roll_rad)
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from error


def _is_list(value: Any, length: int) -> bool:
    return isinstance(value, list) and len(value) == length


def _is_number(value: Any) -> bool:
    # TOML knows nan, and true is an int to Python.
    return isinstance(value, int | float) and not isinstance(value, bool) and not math.isnan(value)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0
