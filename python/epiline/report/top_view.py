"""The floor from above: what the scan says of it, and where the tracks are and go."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from markupsafe import Markup

from epiline.report.charts import nice_step
from epiline.report.numbers import number
from epiline.report.protocols import Floats, ScanLike, TrackLike
from epiline.report.svg import svg

ToPage: TypeAlias = Callable[[Floats, Floats], Floats]

_SIDE, _MARGIN = 420.0, 22.0
_SECONDS_AHEAD = 1.0
"""A track's line ends where it will be then."""


def top_view(scan: ScanLike, tracks: Sequence[TrackLike], *, title: str) -> Markup:
    """The camera at the middle of the lower edge, ahead is up; free, unknown, obstacles, and confirmed tracks.

    Angles of the scan count from straight up, counter-clockwise; tracks are in the camera's frame.
    """
    angles = np.asarray(scan.angle_rad, np.float64)
    reach = scan.max_range_m
    scale = (_SIDE - 2 * _MARGIN) / reach
    widest = float(np.abs(np.sin(angles)).max()) if angles.size else 1.0
    half = max(0.5 * _SIDE, scale * reach * min(1.0, widest) + _MARGIN)
    foot = (half, _SIDE - _MARGIN)

    def at(angle: Floats, distance: Floats) -> Floats:
        across = foot[0] - scale * distance * np.sin(angle)
        return np.stack([across, foot[1] - scale * distance * np.cos(angle)], axis=-1)

    parts = [_sector(at, angles, reach), _free(at, scan), _rings(foot, scale, reach, half)]
    nearest = np.asarray(scan.nearest_m, np.float64)
    seen = np.isfinite(nearest)
    dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in at(angles[seen], nearest[seen]))
    parts.append(f'<path class="hit" d="{dots}"/>' if dots else "")
    parts += [_track(track, foot, scale) for track in tracks if track.confirmed and track.misses == 0]
    return svg(title, 2 * half, _SIDE, "".join(parts), "top-view")


def _polygon(points: Floats) -> str:
    return "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in points) + "Z"


def _sector(at: ToPage, angles: Floats, reach: float) -> str:
    if not angles.size:
        return ""
    corners = np.vstack([at(angles[:1], np.zeros(1)), at(angles, np.full(angles.shape, reach))])
    return f'<path class="unknown" d="{_polygon(corners)}"/>'


def _free(at: ToPage, scan: ScanLike) -> str:
    angles = np.asarray(scan.angle_rad, np.float64)
    begin, end = (np.asarray(values, np.float64) for values in (scan.free_from_m, scan.free_to_m))
    known = np.isfinite(begin) & np.isfinite(end)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(np.int8)))
    outlines = []
    for first, last in edges.reshape(-1, 2):
        run = slice(first, last)
        there, back = at(angles[run], end[run]), at(angles[run], begin[run])[::-1]
        outlines.append(_polygon(np.vstack([there, back])))
    return f'<path class="free" d="{"".join(outlines)}"/>' if outlines else ""


def _rings(foot: tuple[float, float], scale: float, reach: float, half: float) -> str:
    step = nice_step(reach, 4)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    parts = []
    for k in range(1, int(reach / step + 1e-6) + 1):
        radius = scale * step * k
        across = min(radius, half)
        drop = math.sqrt(max(0.0, radius**2 - across**2))
        begin = f"{foot[0] - across:.1f} {foot[1] - drop:.1f}"
        end = f"{foot[0] + across:.1f} {foot[1] - drop:.1f}"
        parts.append(f'<path class="ring" d="M{begin}A{radius:.1f} {radius:.1f} 0 0 1 {end}"/>')
        place = f'x="{foot[0] + 4:.1f}" y="{foot[1] - radius - 3:.1f}"'
        parts.append(f'<text class="tick" {place}>{number(k * step, digits)} m</text>')
    return "".join(parts)


def _track(track: TrackLike, foot: tuple[float, float], scale: float) -> str:
    (x, z), (vx, vz) = track.position_m, track.velocity_mps
    across, up = foot[0] + scale * x, foot[1] - scale * z
    ahead = f"l{scale * vx * _SECONDS_AHEAD:.1f} {-scale * vz * _SECONDS_AHEAD:.1f}"
    return (
        f'<path class="track" d="M{across:.1f} {up:.1f}{ahead}"/><circle class="track" cx="{across:.1f}" cy="{up:.1f}" '
        f'r="4"/><text class="strong" x="{across + 6:.1f}" y="{up - 4:.1f}">{track.id}</text>'
    )
