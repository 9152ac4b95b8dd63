"""The TOML file of `epiline run --config`: matcher, pipeline and regions."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from epiline._core import RectifiedGeometry, Rectifier, Region, StereoCalibration, StereoMatcher
from epiline._regions import RegionSet, choose_set, read_toml, region_sets

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
    regions: RegionSet | None = None

    def regions_for(self, rig: StereoCalibration | RectifiedGeometry) -> list[Region] | None:
        """The regions as that rig's aligned left image shows them; None where the file is silent."""
        if self.regions is None:
            return None
        return self.regions.place(geometry=Rectifier(rig).geometry if isinstance(rig, StereoCalibration) else rig)


def read_configuration(path: Path) -> Configuration:
    """Reads and checks a configuration.

    The tables are ``[matcher]`` (parameters of :class:`epiline.StereoMatcher`), ``[pipeline]`` (options of
    :class:`epiline.Pipeline`; ``regions`` names one of several sets), and regions with their ``[camera]`` as
    :func:`epiline.read_region_sets` describes them.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no TOML, or an entry is unknown or of the wrong type; the message names file and entry.
    """
    content = read_toml(path)
    unknown = set(content) - {"matcher", "pipeline", "regions", "camera"}
    if unknown:
        raise ValueError(f"{path}: unknown table '{sorted(unknown)[0]}'; expected matcher, pipeline, regions or camera")
    pipeline = dict(content.get("pipeline", {}))
    chosen = pipeline.pop("regions", None)
    if chosen is not None and not isinstance(chosen, str):
        raise ValueError(f"{path}: pipeline.regions = {chosen!r} is not the name of a set of regions")
    sets = region_sets(content, str(path)) if "regions" in content else {}
    return Configuration(
        matcher=_matcher(path, content.get("matcher", {})),
        pipeline=_pipeline(path, pipeline),
        regions=choose_set(sets, chosen, str(path)) if sets or chosen is not None else None,
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
