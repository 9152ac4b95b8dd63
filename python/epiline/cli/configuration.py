"""The TOML file of `epiline run --config`: a table for each stage, and the regions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from epiline._core import (
    Mounting,
    RectifiedGeometry,
    Rectifier,
    Region,
    RobotFromCamera,
    Scanner,
    StereoCalibration,
    StereoMatcher,
    Tracker,
)
from epiline._regions import RegionSet, choose_set, read_toml, region_sets

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
    **dict.fromkeys(("enabled", "scene_stands_still"), bool),
    **dict.fromkeys(("confirm_hits", "confirm_window", "max_misses"), int),
    **dict.fromkeys(("velocity_walk_mps", "initial_velocity_mps", "bearing_sigma_rad", "extent_share"), float),
    **dict.fromkeys(("gate_probability", "max_gap_s"), float),
}
_TABLES = ("matcher", "pipeline", "mounting", "ground", "scan", "tracks", "regions", "camera")


@dataclass(frozen=True)
class Configuration:
    """What a file says; empty where it is silent."""

    matcher: dict[str, Any] = field(default_factory=dict)
    pipeline: dict[str, Any] = field(default_factory=dict)
    mounting: dict[str, float] = field(default_factory=dict)
    ground: dict[str, Any] = field(default_factory=dict)
    scan: dict[str, Any] = field(default_factory=dict)
    tracks: dict[str, Any] = field(default_factory=dict)
    regions: RegionSet | None = None

    def regions_for(self, rig: StereoCalibration | RectifiedGeometry) -> list[Region] | None:
        """The regions as that rig's aligned left image shows them; None where the file is silent."""
        if self.regions is None:
            return None
        return self.regions.place(geometry=Rectifier(rig).geometry if isinstance(rig, StereoCalibration) else rig)


def read_configuration(path: Path) -> Configuration:
    """Reads and checks a configuration.

    The tables are ``[matcher]`` (parameters of :class:`epiline.StereoMatcher`), ``[pipeline]`` (options of
    :class:`epiline.Pipeline`; ``regions`` names one of several sets), ``[mounting]``
    (:class:`epiline.RobotFromCamera`: where the camera is on the robot), ``[ground]`` (``enabled``, and how far the
    ground may be from what the mounting says), ``[scan]`` (``enabled``, and parameters of :class:`epiline.Scanner`),
    ``[tracks]`` (``enabled``, and parameters of :class:`epiline.Tracker`), and regions with their ``[camera]`` as
    :func:`epiline.read_region_sets` describes them.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no TOML, or an entry is unknown or of the wrong type or out of range; the message names file and entry.
    """
    content = read_toml(path)
    unknown = set(content) - set(_TABLES)
    if unknown:
        expected = f"{', '.join(_TABLES[:-1])} or {_TABLES[-1]}"
        raise ValueError(f"{path}: unknown table '{sorted(unknown)[0]}'; expected {expected}")
    mounting = _table(path, content, "mounting", _MOUNTING)
    if mounting and "height_m" not in mounting:
        raise ValueError(f"{path}: mounting.height_m is missing")
    table = content.get("pipeline")
    chosen = table.pop("regions", None) if isinstance(table, dict) else None
    if chosen is not None and not isinstance(chosen, str):
        raise ValueError(f"{path}: pipeline.regions = {chosen!r} is not the name of a set of regions")
    sets = region_sets(content, str(path)) if "regions" in content else {}
    configuration = Configuration(
        matcher=_matcher(path, content.get("matcher", {})),
        pipeline=_table(path, content, "pipeline", _PIPELINE),
        mounting=mounting,
        ground=_table(path, content, "ground", _GROUND),
        scan=_table(path, content, "scan", _SCAN),
        tracks=_table(path, content, "tracks", _TRACKS),
        regions=choose_set(sets, chosen, str(path)) if sets or chosen is not None else None,
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
    sigmas = _parameters(configuration.ground)
    angles = {name: configuration.mounting.get(name, 0.0) for name in ("pitch_rad", "roll_rad")}
    return Mounting(configuration.mounting["height_m"], **angles, **sigmas)


def scanner(configuration: Configuration) -> Scanner | None:
    """What scans, unless the file turns it off."""
    made = Scanner(**_parameters(configuration.scan))
    return made if configuration.scan.get("enabled", True) else None


def tracker(configuration: Configuration) -> Tracker | None:
    """What tracks, unless the file turns it off."""
    made = Tracker(**_parameters(configuration.tracks))
    return made if configuration.tracks.get("enabled", True) else None


def _parameters(table: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in table.items() if name != "enabled"}


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
