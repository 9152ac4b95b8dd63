"""The TOML file of `epiline run --config`: matcher, pipeline and regions."""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from epiline._core import Region, StereoMatcher

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_PIPELINE = {
    "equalize": bool,
    "alignment": bool,
    "disparity_sigma_px": float,
    "max_range_m": float,
    "min_support": int,
    "min_height_m": float,
}


@dataclass(frozen=True)
class Configuration:
    """What a file says; empty where it is silent."""

    matcher: dict[str, Any] = field(default_factory=dict)
    pipeline: dict[str, Any] = field(default_factory=dict)
    regions: tuple[Region, ...] = ()


def read_configuration(path: Path) -> Configuration:
    """Reads and checks a configuration.

    The tables are ``[matcher]`` (parameters of :class:`epiline.StereoMatcher`), ``[pipeline]`` (options of
    :class:`epiline.Pipeline`) and any number of ``[[regions]]`` (name, x, y, width, height in pixels).

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no TOML, or an entry is unknown or of the wrong type; the message names file and entry.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from error
    unknown = set(content) - {"matcher", "pipeline", "regions"}
    if unknown:
        raise ValueError(f"{path}: unknown table '{sorted(unknown)[0]}'; expected matcher, pipeline or regions")
    return Configuration(
        matcher=_matcher(path, content.get("matcher", {})),
        pipeline=_pipeline(path, content.get("pipeline", {})),
        regions=tuple(_region(path, i, entry) for i, entry in enumerate(content.get("regions", []), start=1)),
    )


def _matcher(path: Path, table: dict[str, Any]) -> dict[str, Any]:
    known = ("preset", *StereoMatcher().parameters)
    for name in table:
        if name not in known:
            raise ValueError(f"{path}: matcher.{name} is unknown; there are {', '.join(known)}")
    try:
        StereoMatcher(**table)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: matcher: {error}") from error
    return table


def _pipeline(path: Path, table: dict[str, Any]) -> dict[str, Any]:
    for name, value in table.items():
        kind = _PIPELINE.get(name)
        if kind is None:
            raise ValueError(f"{path}: pipeline.{name} is unknown; there are {', '.join(_PIPELINE)}")
        # TOML tells 2 from 2.0, people do not.
        if not isinstance(value, (int, float) if kind is float else kind):
            raise ValueError(f"{path}: pipeline.{name} = {value!r} is not a {kind.__name__}")
    return table


def _region(path: Path, number: int, entry: Any) -> Region:
    names = ("name", "x", "y", "width", "height")
    if not isinstance(entry, dict) or set(entry) != set(names):
        raise ValueError(f"{path}: region {number} must have exactly {', '.join(names)}")
    for name in names[1:]:
        if not isinstance(entry[name], int) or isinstance(entry[name], bool) or entry[name] < 0:
            raise ValueError(f"{path}: region {number}: {name} = {entry[name]!r} is not a whole number of pixels")
    return Region(str(entry["name"]), x=entry["x"], y=entry["y"], width=entry["width"], height=entry["height"])
