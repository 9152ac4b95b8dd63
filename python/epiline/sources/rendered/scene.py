"""What stands in the rendered world: a room, boxes, poles, a chessboard, lamps; and the rooms we ship.

The world is right-handed: x forward, y left, z up, metres; the floor is z = 0.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np

from epiline.sources.rendered.camera import Floats, rotation_xyz
from epiline.sources.rendered.textures import Material

CONCRETE = Material("concrete", ((92, 96, 98), (140, 145, 148), (186, 191, 194)), scale=1.2)
PLANKS = Material("planks", ((16, 26, 38), (52, 84, 122), (92, 142, 190), (138, 182, 222)))
BRICKS = Material("bricks", ((172, 182, 188), (66, 82, 128), (78, 98, 164), (112, 136, 202), (150, 172, 224)))
PLASTER = Material("plaster", ((120, 122, 112), (168, 172, 160), (206, 210, 200), (232, 236, 228)))
TILES = Material("tiles", ((84, 86, 86), (178, 180, 180), (248, 250, 248)))
CRATE = Material("planks", ((10, 22, 34), (40, 92, 140), (84, 150, 204), (140, 196, 236)), scale=0.8, border_m=0.055)
CARDBOARD = Material("concrete", ((44, 74, 108), (84, 126, 168), (122, 166, 206)), scale=0.8, tape_m=0.06)
HAZARD = Material("hazard", ((26, 24, 22), (44, 44, 44), (48, 190, 236), (90, 226, 255)))
STEEL = Material("lockers", ((34, 30, 26), (120, 96, 66), (176, 142, 104), (206, 178, 140)))
GREEN = Material("concrete", ((50, 82, 46), (92, 136, 84), (140, 182, 130)), scale=0.7)
RED = Material("concrete", ((30, 28, 96), (52, 50, 168), (90, 92, 214)), scale=0.6)
CHART = Material("hazard", ((70, 60, 44), (120, 96, 62), (176, 186, 190), (206, 212, 214)), scale=1.6)
WHITEWASH = Material("plain", ((0, 0, 0), (200, 204, 200)))
POSTS = Material("posts", ((70, 74, 78), (206, 208, 206)))


@dataclass(frozen=True)
class Room:
    """The inside of a box, with a material for each side."""

    x_m: tuple[float, float]
    y_m: tuple[float, float]
    height_m: float
    floor: Material = PLANKS
    ceiling: Material = TILES
    front: Material = PLASTER
    back: Material = PLASTER
    left: Material = BRICKS
    right: Material = CONCRETE


@dataclass(frozen=True)
class Box:
    """A box, turned by yaw and leaned by pitch (a ramp): crates, kerbs, shelves, partitions."""

    name: str
    center_m: tuple[float, float, float]
    size_m: tuple[float, float, float]
    material: Material
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0

    @property
    def rotation(self) -> Floats:
        """World from box."""
        return rotation_xyz(0.0, self.pitch_rad, self.yaw_rad)


@dataclass(frozen=True)
class Pole:
    """An upright cylinder from `bottom_m` to `bottom_m + height_m`."""

    name: str
    x_m: float
    y_m: float
    radius_m: float
    height_m: float
    material: Material
    bottom_m: float = 0.0


@dataclass(frozen=True)
class Board:
    """A chessboard of `columns` x `rows` inner corners on a white card one square wider on each side.

    Its frame has the origin at the first inner corner, x along the columns, y along the rows; it is seen from -z.
    """

    columns: int
    rows: int
    square_m: float
    world_from_board: Floats
    name: str = "board"

    @property
    def corners_m(self) -> Floats:
        """Inner corners (rows·columns, 3) in the board's frame, row by row."""
        cols, rows = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.stack([cols.ravel(), rows.ravel(), np.zeros(cols.size)], axis=1).astype(float) * self.square_m

    @property
    def card_m(self) -> tuple[float, float, float, float]:
        """The card's extent in the board's frame: x from, x to, y from, y to."""
        s = self.square_m
        return -2 * s, (self.columns + 1) * s, -2 * s, (self.rows + 1) * s


Solid: TypeAlias = Box | Pole | Board


@dataclass(frozen=True)
class Lamp:
    """A small lamp: radiance falls with the square of distance beyond `reach_m`."""

    position_m: tuple[float, float, float]
    strength: float = 0.75
    reach_m: float = 3.5


ROOM_SIDES = ("floor", "ceiling", "front wall", "back wall", "left wall", "right wall")


@dataclass(frozen=True)
class Scene:
    """A room and what stands in it. Object ids count the room's six sides (`ROOM_SIDES`) first, then the solids."""

    room: Room
    solids: tuple[Solid, ...] = ()
    lamps: tuple[Lamp, ...] = ()
    ambient: float = 0.55
    seed: int = 0
    decoration: frozenset[str] = field(default_factory=frozenset)

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each object id."""
        return ROOM_SIDES + tuple(solid.name for solid in self.solids)

    @property
    def obstacle_ids(self) -> tuple[int, ...]:
        """Ids of what a robot could run into: solids that are not decoration on a wall."""
        first = len(ROOM_SIDES)
        return tuple(first + i for i, solid in enumerate(self.solids) if solid.name not in self.decoration)


def workshop(seed: int = 0) -> Scene:
    """The demo's room: a robot's eye at half a metre, boxes and poles ahead of it between one and eight metres.

    What stands nearest in the full-width bands of the paper, 20/240 to 50/240 of the image around its middle, is
    taller than the eye and crosses all of them: an edge that only grazes a band would belong to it or not by a row or
    two, and no matcher with a window can say which. The toolbox stays below all bands.
    """
    solids: tuple[Solid, ...] = (
        Box("toolbox", (2.08, -0.33, 0.10), (0.24, 0.44, 0.20), RED, yaw_rad=0.05),
        Box("parcel", (2.85, 0.65, 0.36), (0.50, 0.56, 0.72), CARDBOARD, yaw_rad=-0.22),
        Box("crate", (4.0, -1.25, 0.40), (0.80, 0.80, 0.80), CRATE, yaw_rad=0.30),
        Pole("bollard", 4.75, 0.22, 0.075, 1.05, HAZARD),
        Box("large crate", (5.7, 1.55, 0.50), (1.00, 1.00, 1.00), CRATE, yaw_rad=-0.42),
        Box("top crate", (5.65, 1.5, 1.25), (0.50, 0.50, 0.50), CRATE, yaw_rad=0.10),
        Pole("thin pole", 6.1, -0.62, 0.03, 2.3, GREEN),
        Box("locker", (7.1, -2.1, 0.95), (0.60, 1.10, 1.90), STEEL, yaw_rad=0.12),
        Box("cabinet", (7.75, 0.35, 0.55), (0.55, 1.25, 1.10), GREEN, yaw_rad=-0.08),
        Pole("column", 8.6, 2.25, 0.17, 3.0, CONCRETE),
        Box("kerb", (6.6, 2.55, 0.04), (3.6, 0.12, 0.08), HAZARD),
        Box("stack", (8.5, -0.95, 0.35), (0.70, 0.60, 0.70), CARDBOARD, yaw_rad=0.5),
        Box("door", (10.99, 0.9, 1.05), (0.06, 1.00, 2.10), STEEL),
        Box("poster", (10.995, -1.3, 1.75), (0.02, 1.10, 0.80), CHART),
    )
    lamps = (Lamp((1.2, 0.9, 2.7)), Lamp((4.8, -0.9, 2.7)), Lamp((8.6, 0.6, 2.7)))
    return Scene(
        Room((-3.0, 11.0), (-3.0, 3.0), 3.0),
        solids,
        lamps,
        ambient=0.62,
        seed=seed,
        decoration=frozenset({"door", "poster"}),
    )


def studio(board: Board, seed: int = 0) -> Scene:
    """A bare room around a board, large enough to hold it at any pose."""
    s = 5 * max(board.columns, board.rows, 6) * board.square_m
    center = board.world_from_board[:3, 3]
    room = Room(
        (min(-s, center[0] - s), max(s, center[0] + s)),
        (min(-s, center[1] - s), max(s, center[1] + s)),
        height_m=max(2.2 * s, center[2] + s),
        left=PLASTER,
        right=PLASTER,
        front=BRICKS,
    )
    above = room.height_m * 0.9
    lamps = (Lamp((-0.3 * s, 0.5 * s, above), 0.4, 2 * s), Lamp((0.2 * s, -0.6 * s, above), 0.3, 2 * s))
    return Scene(room, (board,), lamps, ambient=0.6, seed=seed)
