"""Where rays meet a scene: analytic intersections, all rays of an image at once.

Directions are given with their camera's z equal to 1, so that the ray parameter of a hit *is* its depth Z in that
camera's frame. The precision of the arrays given is the precision of the answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import EllipsisType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from epiline.sources.rendered.camera import Floats
from epiline.sources.rendered.scene import ROOM_SIDES, Board, Box, Pole, Room, Scene, Solid
from epiline.sources.rendered.textures import Material

AnyFloats: TypeAlias = NDArray[Any]
Rays: TypeAlias = tuple[AnyFloats, AnyFloats, AnyFloats]
# Which rays may meet a solid: a rectangle, a list, all of them, or none.
Window: TypeAlias = tuple[slice, slice] | None
Part: TypeAlias = Window | tuple[slice, NDArray[np.intp]] | EllipsisType

_NEAR_M = 1e-3


@dataclass(frozen=True)
class Surface:
    """One face: which object it belongs to, and its own coordinates u, v for the texture.

    A flat face has `u = u_axis·p − origin`; a cylinder's side has `axis_xy` instead, and u runs around it.
    """

    object_id: int
    material: Material | None
    normal: Floats
    u_axis: Floats
    v_axis: Floats
    center: Floats
    half_u_m: float
    half_v_m: float
    axis_xy: tuple[float, float] | None = None
    board: Board | None = None


class Tracer:
    """A scene made ready for rays."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.surfaces = _room_surfaces(scene.room)
        self._hits: list[Callable[[Floats, Rays], tuple[AnyFloats, NDArray[np.int16]]]] = []
        for i, solid in enumerate(scene.solids):
            first = len(self.surfaces)
            faces, hit = _COMPILERS[type(solid)](solid, len(ROOM_SIDES) + i, first)
            self.surfaces += faces
            self._hits.append(hit)
        self.object_of = np.array([surface.object_id for surface in self.surfaces], np.int16)

    def cast(
        self, origin: Floats, rays: Rays, parts: Sequence[Part] | None = None
    ) -> tuple[AnyFloats, NDArray[np.int16]]:
        """Ray parameter and surface number of the nearest hit of every ray; all from one `origin` in the world.

        `parts` says for each solid which rays can meet it at all.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            nearest, surface = _hit_room(self.scene.room, origin, rays)
            for hit, part in zip(self._hits, parts or [...] * len(self._hits), strict=True):
                if part is None:
                    continue
                x, y, z = rays
                at, which = hit(origin, (x[part], y[part], z[part]))
                before = nearest[part]
                closer = at < before  # False for NaN, which is a miss
                nearest[part] = np.where(closer, at, before)
                surface[part] = np.where(closer, which, surface[part])
        return nearest, surface

    def windows(self, world_from_view: Floats, x: AnyFloats, y: AnyFloats) -> list[Window]:
        """For each solid the rectangle of an image whose rays (x, y, 1) can meet it; None where none can."""
        stride = 8
        coarse_x, coarse_y = x[::stride, ::stride], y[::stride, ::stride]
        # A ray between coarse ones is at most one cell away.
        cell = stride * 1.5 * max(np.abs(np.diff(x, axis=1)).max(), np.abs(np.diff(y, axis=0)).max())
        parts: list[Window] = []
        for solid in self.scene.solids:
            corners = (_extent(solid) - world_from_view[:3, 3]) @ world_from_view[:3, :3]
            if (corners[:, 2] <= 0).all():
                parts.append(None)
                continue
            if (corners[:, 2] < 0.05).any():
                parts.append((slice(None), slice(None)))
                continue
            image = corners[:, :2] / corners[:, 2:]
            (x0, y0), (x1, y1) = image.min(0) - cell, image.max(0) + cell
            inside = (coarse_x >= x0) & (coarse_x <= x1) & (coarse_y >= y0) & (coarse_y <= y1)
            rows, cols = np.flatnonzero(inside.any(1)), np.flatnonzero(inside.any(0))
            if rows.size == 0:
                parts.append(None)
            else:
                parts.append(
                    (
                        slice(int(rows[0]) * stride, int(rows[-1] + 1) * stride),
                        slice(int(cols[0]) * stride, int(cols[-1] + 1) * stride),
                    )
                )
        return parts


def _extent(solid: Solid) -> Floats:
    """Eight points (8, 3) in the world whose hull holds the solid."""
    signs = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)]) * 2.0 - 1.0
    if isinstance(solid, Box):
        return np.asarray(signs * np.array(solid.size_m) / 2 @ solid.rotation.T + solid.center_m, float)
    if isinstance(solid, Pole):
        half = np.array([solid.radius_m, solid.radius_m, solid.height_m / 2])
        return np.asarray(signs * half + [solid.x_m, solid.y_m, solid.bottom_m + solid.height_m / 2], float)
    x0, x1, y0, y1 = solid.card_m
    half = np.array([x1 - x0, y1 - y0, 0.0]) / 2
    local = signs * half + [(x0 + x1) / 2, (y0 + y1) / 2, 0.0]
    return np.asarray(local @ solid.world_from_board[:3, :3].T + solid.world_from_board[:3, 3], float)


# ---- the room ----------------------------------------------------------------------------------


def _room_surfaces(room: Room) -> list[Surface]:
    (x0, x1), (y0, y1), h = room.x_m, room.y_m, room.height_m
    ex, ey, ez = np.eye(3)
    middle = np.array([(x0 + x1) / 2, (y0 + y1) / 2, h / 2])
    half = np.array([(x1 - x0) / 2, (y1 - y0) / 2, h / 2])
    # (material, inward normal, u axis, v axis) in the order of ROOM_SIDES
    sides = (
        (room.floor, ez, ey, ex),
        (room.ceiling, -ez, ex, ey),
        (room.front, -ex, ey, ez),
        (room.back, ex, ey, ez),
        (room.left, -ey, ex, ez),
        (room.right, ey, ex, ez),
    )
    return [
        Surface(i, material, n, u, v, middle - n * half, float(np.abs(u) @ half), float(np.abs(v) @ half))
        for i, (material, n, u, v) in enumerate(sides)
    ]


def _hit_room(room: Room, origin: Floats, rays: Rays) -> tuple[AnyFloats, NDArray[np.int16]]:
    """The side a ray leaves through, from inside."""
    spans = (room.x_m, room.y_m, (0.0, room.height_m))
    sides = ((3, 2), (5, 4), (0, 1))
    nearest: AnyFloats | None = None
    for start, ray, (low, high), (low_side, high_side) in zip(origin, rays, spans, sides, strict=True):
        upward = ray > 0
        at = np.where(upward, ray.dtype.type(high - start), ray.dtype.type(low - start)) / ray
        at = np.where(ray == 0, ray.dtype.type(np.inf), at)  # along the side: never there
        side = np.where(upward, np.int16(high_side), np.int16(low_side))
        if nearest is None:
            nearest, surface = at, side
            continue
        closer = ~(nearest <= at)
        nearest = np.where(closer, at, nearest)
        surface = np.where(closer, side, surface)
    assert nearest is not None
    return nearest, surface


# ---- solids ------------------------------------------------------------------------------------

Compiled: TypeAlias = tuple[list[Surface], Callable[[Floats, Rays], tuple[AnyFloats, NDArray[np.int16]]]]


def _compile_box(box: Box, object_id: int, first: int) -> Compiled:
    rotation, center = box.rotation, np.array(box.center_m)
    half = np.array(box.size_m) / 2
    faces = []
    for axis in range(3):
        u, v = ((1, 2), (0, 2), (0, 1))[axis]
        for sign in (-1.0, 1.0):
            normal = sign * rotation[:, axis]
            middle = center + normal * half[axis]
            faces.append(
                Surface(object_id, box.material, normal, rotation[:, u], rotation[:, v], middle, half[u], half[v])
            )

    def hit(origin: Floats, rays: Rays) -> tuple[AnyFloats, NDArray[np.int16]]:
        """Slabs (Kay and Kajiya 1986)."""
        x, y, z = rays
        number = x.dtype.type
        start = (origin - center) @ rotation
        enter: AnyFloats | None = None
        for axis in range(3):
            rx, ry, rz = (number(value) for value in rotation[:, axis])
            inverse = 1 / (rx * x + ry * y + rz * z)
            low, high = number(-half[axis] - start[axis]) * inverse, number(half[axis] - start[axis]) * inverse
            face = np.where(inverse > 0, np.int16(first + 2 * axis), np.int16(first + 2 * axis + 1))
            inward, outward = np.minimum(low, high), np.maximum(low, high)
            if enter is None:
                enter, leave, which = inward, outward, face
                continue
            which = np.where(inward > enter, face, which)
            enter = np.maximum(enter, inward)
            leave = np.minimum(leave, outward)
        assert enter is not None
        return np.where((enter <= leave) & (enter > _NEAR_M), enter, number(np.inf)), which

    return faces, hit


def _compile_pole(pole: Pole, object_id: int, first: int) -> Compiled:
    ex, ey, ez = np.eye(3)
    top = pole.bottom_m + pole.height_m
    axis = np.array([pole.x_m, pole.y_m, pole.bottom_m + pole.height_m / 2])
    side = Surface(
        object_id, pole.material, ex, ey, ez, axis, pole.radius_m, pole.height_m / 2, axis_xy=(pole.x_m, pole.y_m)
    )
    cap = Surface(
        object_id, pole.material, ez, ex, ey, np.array([pole.x_m, pole.y_m, top]), pole.radius_m, pole.radius_m
    )

    def hit(origin: Floats, rays: Rays) -> tuple[AnyFloats, NDArray[np.int16]]:
        x, y, z = rays
        number = x.dtype.type
        to_x, to_y = number(pole.x_m - origin[0]), number(pole.y_m - origin[1])
        across = x * x + y * y
        # The distance of the axis from the ray, not b² − 4ac: that loses a thin pole's edge in single precision.
        miss = (to_x * y - to_y * x) ** 2 / across
        half_chord = np.sqrt(np.maximum(number(pole.radius_m**2) - miss, 0) / across)
        at = (to_x * x + to_y * y) / across - half_chord
        height = number(origin[2]) + at * z
        on_side = (miss < pole.radius_m**2) & (at > _NEAR_M) & (height >= pole.bottom_m) & (height <= top)
        to_cap = number(top - origin[2]) / z
        dx, dy = to_cap * x - to_x, to_cap * y - to_y
        on_cap = (to_cap > _NEAR_M) & (dx * dx + dy * dy <= pole.radius_m**2) & (z < 0)
        at = np.where(on_side, at, number(np.inf))
        return np.where(on_cap, np.minimum(to_cap, at), at), np.where(on_cap, np.int16(first + 1), np.int16(first))

    return [side, cap], hit


def _compile_board(board: Board, object_id: int, first: int) -> Compiled:
    rotation, start = board.world_from_board[:3, :3], board.world_from_board[:3, 3]
    x0, x1, y0, y1 = board.card_m
    # Texture coordinates begin at the first inner corner.
    face = Surface(
        object_id, None, -rotation[:, 2], rotation[:, 0], rotation[:, 1], start, x1 - x0, y1 - y0, board=board
    )

    def hit(origin: Floats, rays: Rays) -> tuple[AnyFloats, NDArray[np.int16]]:
        x, y, z = rays
        number = x.dtype.type
        local = (origin - start) @ rotation
        along = [
            number(rotation[0, axis]) * x + number(rotation[1, axis]) * y + number(rotation[2, axis]) * z
            for axis in range(3)
        ]
        at = number(-local[2]) / along[2]
        u, v = number(local[0]) + at * along[0], number(local[1]) + at * along[1]
        on = (at > _NEAR_M) & (u >= x0) & (u <= x1) & (v >= y0) & (v <= y1)
        return np.where(on, at, number(np.inf)), np.full(at.shape, first, np.int16)

    return [face], hit


_COMPILERS: dict[type, Callable[[Any, int, int], Compiled]] = {
    Box: _compile_box,
    Pole: _compile_pole,
    Board: _compile_board,
}
