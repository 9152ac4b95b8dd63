"""What a ray sees where it hits: texture, lamps, and the soft darkness where things meet.

Everything here depends on the point alone, not on where it is seen from, so both cameras see the same radiance.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from epiline.sources.rendered.camera import Floats
from epiline.sources.rendered.raycast import AnyFloats, Rays, Surface, Tracer
from epiline.sources.rendered.scene import Board, Box, Pole
from epiline.sources.rendered.textures import Singles, pattern

_PROBES = 4
_MAX_STRETCH = 8.0
_STAIN_SCALE = 3.7
INK, PAPER = 20.0, 190.0


def shade(
    tracer: Tracer, origin: Floats, rays: Rays, at: AnyFloats, surface: NDArray[np.int16], pixel_rad: float
) -> Singles:
    """Radiance (N, 3) in 0..255, blue green red, of the hits of N rays; `pixel_rad` is the angle a pixel spans."""
    out = np.empty((at.size, 3), np.float32)
    order = np.argsort(surface, kind="stable")
    numbers, starts = np.unique(surface[order], return_index=True)
    for number, rows in zip(numbers, np.split(order, starts[1:]), strict=True):
        x, y, z = (axis[rows].astype(np.float32, copy=False) for axis in rays)
        out[rows] = _shade_surface(
            tracer, int(number), origin, (x, y, z), at[rows].astype(np.float32, copy=False), pixel_rad
        )
    return out


def board_parity(board: Board, u_m: AnyFloats, v_m: AnyFloats) -> NDArray[np.bool_]:
    """Where the board is inked: squares of odd parity inside the chequered part."""
    s = board.square_m
    col, row = np.floor(u_m / s).astype(np.int32), np.floor(v_m / s).astype(np.int32)
    inside = (col >= -1) & (col < board.columns) & (row >= -1) & (row < board.rows)
    return np.asarray(inside & ((col + row) % 2 == 0), bool)


def surface_coordinates(surface: Surface, points: Rays) -> tuple[AnyFloats, AnyFloats]:
    """Texture coordinates u, v of points on a surface, metres from its centre."""
    px, py, pz = points
    if surface.axis_xy is not None:
        around = np.arctan2(py - np.float32(surface.axis_xy[1]), px - np.float32(surface.axis_xy[0]))
        return around * np.float32(surface.half_u_m), pz - np.float32(surface.center[2])
    u = _dot(surface.u_axis, points) - np.float32(surface.u_axis @ surface.center)
    v = _dot(surface.v_axis, points) - np.float32(surface.v_axis @ surface.center)
    return u, v


def _dot(axis: Floats, vectors: Rays) -> Any:
    total: Any = None
    for component, values in zip(axis, vectors, strict=True):
        if component:  # most faces are upright: most components are zero
            term = np.float32(component) * values
            total = term if total is None else total + term
    return total


def _shade_surface(tracer: Tracer, number: int, origin: Floats, rays: Rays, at: Singles, pixel_rad: float) -> Singles:
    surface = tracer.surfaces[number]
    x, y, z = rays
    points = tuple(np.float32(start) + at * ray for start, ray in zip(origin, rays, strict=True))
    px, py, pz = points
    u, v = surface_coordinates(surface, (px, py, pz))
    length = np.sqrt(x * x + y * y + z * z)
    footprint = at * length * np.float32(pixel_rad)
    normal: tuple[Any, Any, Any]
    if surface.axis_xy is not None:
        radius = np.float32(surface.half_u_m)
        normal = (
            (px - np.float32(surface.axis_xy[0])) / radius,
            (py - np.float32(surface.axis_xy[1])) / radius,
            np.float32(0),
        )
        facing = np.abs(normal[0] * x + normal[1] * y) / length
        along_u, along_v = np.ones_like(u), np.zeros_like(v)
    else:
        normal = tuple(np.float32(value) for value in surface.normal)
        facing = np.abs(_dot(surface.normal, rays)) / length
        along_u, along_v = _dot(surface.u_axis, rays), _dot(surface.v_axis, rays)

    light = _light(tracer, (px, py, pz), normal)
    light *= _nearby_darkness(tracer, surface, (px, py, pz))
    if surface.board is not None:
        ink = board_parity(surface.board, u, v)
        return np.repeat((np.where(ink, np.float32(INK), np.float32(PAPER)) * light)[:, None], 3, axis=1)
    color = _texture(tracer.scene.seed, number, surface, (u, v), (along_u, along_v), footprint, facing)
    color *= light[:, None]
    return color


def _texture(
    seed: int,
    number: int,
    surface: Surface,
    uv: tuple[Singles, Singles],
    along: tuple[Singles, Singles],
    footprint: Singles,
    facing: Singles,
) -> Singles:
    """The material's colours; a footprint stretched by a slanting view is covered by probes along it."""
    material = surface.material
    assert material is not None
    u, v = uv
    picture = pattern(material.pattern, seed)
    scale = np.float32(1 / material.scale)
    # The same material looks different on every face.
    shift_u, shift_v = np.random.default_rng([seed, number]).random(2, dtype=np.float32) * np.float32(picture.tile_m)
    if surface.object_id < 6:
        shift_u = shift_v = np.float32(0)
    su, sv, narrow = u * scale + shift_u, v * scale + shift_v, footprint * scale
    value = np.empty_like(u)
    stretch = np.minimum(1 / np.maximum(facing, np.float32(1e-3)), np.float32(_MAX_STRETCH))
    slanting = stretch > 1.5
    head_on = np.flatnonzero(~slanting)
    value[head_on] = picture.sample(su[head_on], sv[head_on], narrow[head_on] * np.sqrt(stretch[head_on]))
    rows = np.flatnonzero(slanting)
    if rows.size:
        long = narrow[rows] * stretch[rows]
        wide = np.maximum(narrow[rows], long / _PROBES)
        norm = np.hypot(along[0][rows], along[1][rows])
        step_u, step_v = along[0][rows] / norm * long, along[1][rows] / norm * long
        total = np.zeros(rows.size, np.float32)
        for probe in range(_PROBES):
            offset = np.float32((probe + 0.5) / _PROBES - 0.5)
            total += picture.sample(su[rows] + offset * step_u, sv[rows] + offset * step_v, wide)
        value[rows] = total / np.float32(_PROBES)
    color: Singles = material.ramp().take(np.clip(value * 255, 0, 255).astype(np.uint8), axis=0)
    if material.pattern != "plain":
        # Large stains of a period that fits no tile: no two spots of a wall are alike.
        stains = pattern("concrete", seed)
        stain = stains.sample(u / np.float32(_STAIN_SCALE) + shift_v, v / np.float32(_STAIN_SCALE), footprint)
        color *= (np.float32(0.78) + np.float32(0.44) * stain)[:, None]
    if material.border_m:
        inset = np.minimum(surface.half_u_m - np.abs(u), surface.half_v_m - np.abs(v)) - np.float32(material.border_m)
        frame = _ramp_down(inset, footprint)
        seam = _ramp_down(np.abs(inset) - np.float32(0.006), footprint)
        color *= (1 - np.float32(0.28) * frame)[:, None] * (1 - np.float32(0.5) * seam)[:, None]
    if material.tape_m:
        tape = _ramp_down(np.abs(u) - np.float32(material.tape_m / 2), footprint)
        color *= (1 + np.float32(0.35) * tape)[:, None]
    return color


def _ramp_down(signed_m: Singles, footprint: Singles) -> Singles:
    """1 where the signed distance is negative, 0 where positive, over one footprint."""
    return np.asarray(np.clip(np.float32(0.5) - signed_m / footprint, 0, 1), np.float32)


def _light(tracer: Tracer, points: Rays, normal: tuple[Any, Any, Any]) -> Any:
    """Ambient light, a little stronger from above, and Lambert's law for each lamp."""
    nx, ny, nz = normal
    scene = tracer.scene
    total = np.float32(scene.ambient) * (np.float32(0.92) + np.float32(0.08) * nz) + np.zeros_like(points[0])
    for lamp in scene.lamps:
        lx, ly, lz = (np.float32(to) - p for to, p in zip(lamp.position_m, points, strict=True))
        distance2 = lx * lx + ly * ly + lz * lz
        facing = np.maximum(nx * lx + ny * ly + nz * lz, 0) / np.sqrt(distance2)
        total += facing * np.float32(lamp.strength) / (1 + distance2 / np.float32(lamp.reach_m**2))
    return total


def _nearby_darkness(tracer: Tracer, surface: Surface, points: Rays) -> Singles:
    """Less light reaches corners and the floor around things: a factor in 0..1."""
    px, py, pz = points
    room = tracer.scene.room
    if surface.object_id >= 6:
        return np.asarray(1 - np.float32(0.35) * np.exp(-np.maximum(pz, 0) / np.float32(0.14)), np.float32)
    gaps = []
    for axis, p, (low, high) in ((0, px, room.x_m), (1, py, room.y_m), (2, pz, (0.0, room.height_m))):
        if not surface.normal[axis]:
            gaps.append(np.minimum(p - np.float32(low), np.float32(high) - p))
    dark: Singles = 1 - np.float32(0.3) * np.exp(-np.minimum(*gaps) / np.float32(0.35))
    if surface.object_id == 0:
        for solid in tracer.scene.solids:
            _darken_around(dark, solid, px, py)
    return dark


def _darken_around(dark: Singles, solid: Any, px: Singles, py: Singles) -> None:
    """A soft contact shadow on the floor around the foot of a solid."""
    if isinstance(solid, Box) and abs(solid.center_m[2] - solid.size_m[2] / 2) < 0.02 and not solid.pitch_rad:
        middle, half = solid.center_m[:2], (solid.size_m[0] / 2, solid.size_m[1] / 2)
        cos, sin = np.float32(np.cos(solid.yaw_rad)), np.float32(np.sin(solid.yaw_rad))
    elif isinstance(solid, Pole) and solid.bottom_m < 0.02:
        middle, half, cos, sin = (solid.x_m, solid.y_m), (0.0, 0.0), np.float32(1), np.float32(0)
    else:
        return
    dx, dy = px - np.float32(middle[0]), py - np.float32(middle[1])
    reach = np.float32(np.hypot(*half) + 0.8)
    rows = np.flatnonzero((np.abs(dx) < reach) & (np.abs(dy) < reach))
    dx, dy = dx[rows], dy[rows]
    out_x = np.maximum(np.abs(cos * dx + sin * dy) - np.float32(half[0]), 0)
    out_y = np.maximum(np.abs(cos * dy - sin * dx) - np.float32(half[1]), 0)
    gap = np.hypot(out_x, out_y)
    if isinstance(solid, Pole):
        gap = np.maximum(gap - np.float32(solid.radius_m), 0)
    dark[rows] *= 1 - np.float32(0.5) * np.exp(-gap / np.float32(0.16))
