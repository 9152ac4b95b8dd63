"""The TOML file of `epiline run --config`: a table for each stage, and the regions."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from epiline._core import Mounting, Region, RobotFromCamera, Scanner, StereoMatcher, Tracker

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
    "step_m": float,
    "headroom_m": float,
}
_MOUNTING = dict.fromkeys(("height_m", "x_m", "y_m", "roll_rad", "pitch_rad", "yaw_rad"), float)
_GROUND = {
    "enabled": bool,
    **dict.fromkeys(("camera_height_sigma_m", "pitch_sigma_rad", "roll_sigma_rad"), float),
}
_SCAN = {
    "enabled": bool,
    "min_support": int,
    **dict.fromkeys(("step_m", "headroom_m", "max_range_m", "gap_guard_px"), float),
}
_TRACKS = {
    "enabled": bool,
    **dict.fromkeys(("confirm_hits", "confirm_window", "max_misses"), int),
    **dict.fromkeys(("velocity_walk_mps", "initial_velocity_mps", "bearing_sigma_rad", "extent_share"), float),
    **dict.fromkeys(("gate_probability", "max_gap_s"), float),
}
_TABLES = ("matcher", "pipeline", "mounting", "ground", "scan", "tracks", "regions")


@dataclass(frozen=True)
class Configuration:
    """What a file says; empty where it is silent."""

    matcher: dict[str, Any] = field(default_factory=dict)
    pipeline: dict[str, Any] = field(default_factory=dict)
    mounting: dict[str, float] = field(default_factory=dict)
    ground: dict[str, Any] = field(default_factory=dict)
    scan: dict[str, Any] = field(default_factory=dict)
    tracks: dict[str, Any] = field(default_factory=dict)
    regions: tuple[Region, ...] = ()


def read_configuration(path: Path) -> Configuration:
    """Reads and checks a configuration.

    The tables are ``[matcher]`` (parameters of :class:`epiline.StereoMatcher`), ``[pipeline]`` (options of
    :class:`epiline.Pipeline`), ``[mounting]`` (:class:`epiline.RobotFromCamera`: where the camera is on the robot),
    ``[ground]`` (``enabled``, and how far the ground may be from what the mounting says), ``[scan]`` (``enabled``, and
    parameters of :class:`epiline.Scanner`), ``[tracks]`` (``enabled``, and parameters of :class:`epiline.Tracker`), and
    any number of ``[[regions]]`` (name, x, y, width, height in pixels).

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no TOML, or an entry is unknown or of the wrong type or out of range; the message names file and entry.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path}: {error}") from error
    unknown = set(content) - set(_TABLES)
    if unknown:
        expected = f"{', '.join(_TABLES[:-1])} or {_TABLES[-1]}"
        raise ValueError(f"{path}: unknown table '{sorted(unknown)[0]}'; expected {expected}")
    mounting = _table(path, content, "mounting", _MOUNTING)
    if mounting and "height_m" not in mounting:
        raise ValueError(f"{path}: mounting.height_m is missing")
    configuration = Configuration(
        matcher=_matcher(path, content.get("matcher", {})),
        pipeline=_table(path, content, "pipeline", _PIPELINE),
        mounting=mounting,
        ground=_table(path, content, "ground", _GROUND),
        scan=_table(path, content, "scan", _SCAN),
        tracks=_table(path, content, "tracks", _TRACKS),
        regions=tuple(_region(path, i, entry) for i, entry in enumerate(content.get("regions", []), start=1)),
    )
    for name, make in (("mounting", robot_from_camera), ("scan", scanner), ("tracks", tracker)):
        _check(path, name, make, configuration)
    return configuration


def robot_from_camera(configuration: Configuration) -> RobotFromCamera | None:
    """Where the camera is on the robot, if the file says."""
    return RobotFromCamera(**configuration.mounting) if configuration.mounting else None


def ground_prior(configuration: Configuration) -> Mounting | None:
    """How the camera stands over the ground, as far as the file says."""
    if not configuration.mounting:
        return None
    sigmas = {name: value for name, value in configuration.ground.items() if name != "enabled"}
    angles = {name: configuration.mounting.get(name, 0.0) for name in ("pitch_rad", "roll_rad")}
    return Mounting(configuration.mounting["height_m"], **angles, **sigmas)


def scanner(configuration: Configuration) -> Scanner | None:
    """What scans, unless the file turns it off."""
    return _unless_off(configuration.scan, Scanner)


def tracker(configuration: Configuration) -> Tracker | None:
    """What tracks, unless the file turns it off."""
    return _unless_off(configuration.tracks, Tracker)


def _unless_off(table: Mapping[str, Any], make: Callable[..., Any]) -> Any:
    parameters = {name: value for name, value in table.items() if name != "enabled"}
    made = make(**parameters)
    return made if table.get("enabled", True) else None


def _check(path: Path, name: str, make: Callable[[Configuration], object], configuration: Configuration) -> None:
    try:
        make(configuration)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {name}: {error}") from error


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


def _table(path: Path, content: Mapping[str, Any], title: str, kinds: Mapping[str, type]) -> dict[str, Any]:
    table = content.get(title, {})
    if not isinstance(table, dict):
        raise ValueError(f"{path}: {title} is not a table")
    for name, value in table.items():
        kind = kinds.get(name)
        if kind is None:
            raise ValueError(f"{path}: {title}.{name} is unknown; there are {', '.join(kinds)}")
        # TOML tells 2 from 2.0, people do not; and a truth value is no number.
        fits = isinstance(value, (int, float) if kind is float else kind)
        if not fits or (kind is not bool and isinstance(value, bool)):
            raise ValueError(f"{path}: {title}.{name} = {value!r} is not a {kind.__name__}")
    return table


def _region(path: Path, number: int, entry: Any) -> Region:
    names = ("name", "x", "y", "width", "height")
    if not isinstance(entry, dict) or set(entry) != set(names):
        raise ValueError(f"{path}: region {number} must have exactly {', '.join(names)}")
    for name in names[1:]:
        if not isinstance(entry[name], int) or isinstance(entry[name], bool) or entry[name] < 0:
            raise ValueError(f"{path}: region {number}: {name} = {entry[name]!r} is not a whole number of pixels")
    return Region(str(entry["name"]), x=entry["x"], y=entry["y"], width=entry["width"], height=entry["height"])
