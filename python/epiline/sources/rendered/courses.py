"""Obstacle courses: rooms and corridors that are driven through, each with the truth of what one could run into.

Every course is drawn from its seed; the two halves, for choosing parameters and for checking them, share no seed, no
wall and no floor.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from epiline.sources.rendered.path import CameraPath, Waypoint
from epiline.sources.rendered.photograph import Sensor
from epiline.sources.rendered.rig import RenderedRig
from epiline.sources.rendered.scene import (
    BRICKS,
    CARDBOARD,
    CONCRETE,
    CRATE,
    GREEN,
    HAZARD,
    PLANKS,
    PLASTER,
    POSTS,
    RED,
    STEEL,
    WHITEWASH,
    Box,
    Lamp,
    Pole,
    Room,
    Scene,
    Solid,
)
from epiline.sources.rendered.textures import Material

Half: TypeAlias = Literal["development", "check"]
HALVES: tuple[Half, ...] = ("development", "check")
"""Parameters are chosen on the first and reported on both."""

POLE_DIAMETER_M, KERB_HEIGHT_M = 0.03, 0.08
# 1 in 12: as steep as a wheelchair ramp may be. What is no steeper is ground.
RAMP_PITCH_RAD = float(np.arctan(1 / 12))
_LOADING_RAMP_RAD = float(np.deg2rad(25))

_UNMATCHABLE = {WHITEWASH.pattern, POSTS.pattern}
_WALLS = {"development": (PLASTER, BRICKS), "check": (CONCRETE, replace(PLASTER, scale=1.7), STEEL)}
_FLOORS = {
    "development": (PLANKS, CONCRETE),
    "check": (replace(PLASTER, scale=0.7), replace(CONCRETE, scale=0.5), replace(PLANKS, scale=1.6)),
}
_THINGS = (CRATE, CARDBOARD, STEEL, GREEN, RED)


@dataclass(frozen=True)
class Course:
    """A drive through a scene.

    Attributes
    ----------
    kind : str
        What it tries: ``boxes``, ``corridor``, ``poles``, ``kerbs``, ``ramps``, ``textureless``, ``repetitive``,
        ``free``.
    half : {"development", "check"}
    seed : int
    size : (width, height)
        Of both images, pixels.
    frames : int
    scene : Scene
    path : CameraPath
    left_sensor, right_sensor : Sensor
        Noise and exposure; the right camera's exposure differs.
    ground : frozenset of str
        Names of solids to drive on rather than into.
    """

    kind: str
    half: Half
    seed: int
    size: tuple[int, int]
    frames: int
    scene: Scene
    path: CameraPath
    left_sensor: Sensor
    right_sensor: Sensor
    ground: frozenset[str] = frozenset()

    @property
    def name(self) -> str:
        return f"{self.half}/{self.kind}-{self.seed}-{self.size[0]}x{self.size[1]}"

    @property
    def matchable(self) -> bool:
        """Whether every surface can be matched: no side of the room is blank or repeats."""
        room = self.scene.room
        sides = (room.floor, room.ceiling, room.front, room.back, room.left, room.right)
        return not any(side.pattern in _UNMATCHABLE for side in sides)

    def rig(self) -> RenderedRig:
        """The cameras in the scene."""
        return RenderedRig(
            seed=self.seed,
            size=self.size,
            scene=self.scene,
            path=self.path,
            left_sensor=self.left_sensor,
            right_sensor=self.right_sensor,
        )


@dataclass(frozen=True)
class _World:
    room: Room
    solids: tuple[Solid, ...] = ()
    ground: frozenset[str] = frozenset()
    advance_m: float = 0.8
    sway_rad: float = 0.09


_Maker: TypeAlias = Callable[[np.random.Generator, Half], _World]


def course(kind: str, half: Half, number: int, size: tuple[int, int], frames: int) -> Course:
    """The course of a kind with that number, 0 to 99."""
    seed = 1000 * (1 + HALVES.index(half)) + 100 * KINDS.index(kind) + number
    rng = np.random.default_rng([seed, 2026])
    world = _MAKERS[kind](rng, half)
    (x0, x1), h = world.room.x_m, world.room.height_m
    strength = float(rng.uniform(0.25, 0.4))
    lamps = tuple(
        Lamp((float(x), float(rng.uniform(-0.8, 0.8)), h - 0.3), strength) for x in np.arange(x0 + 3.5, x1, 3.5)
    )
    scene = Scene(world.room, world.solids, lamps, ambient=float(rng.uniform(0.5, 0.68)), seed=seed)
    noise = float(rng.uniform(0.8, 2.5))
    sensor = Sensor(gain=float(rng.uniform(0.9, 1.0)), read_noise=noise, shot_noise=float(rng.uniform(0.01, 0.03)))
    return Course(
        kind=kind,
        half=half,
        seed=seed,
        size=size,
        frames=frames,
        scene=scene,
        path=_drive(rng, world),
        left_sensor=sensor,
        right_sensor=replace(sensor, gain=sensor.gain * float(rng.uniform(0.78, 0.95))),
        ground=world.ground,
    )


def courses(*, frames: int | None = None) -> Iterator[Course]:
    """Both sets: 8 kinds at 320x240 and 640x480; among them 540 frames of a free path. `frames` caps each course."""

    def at_most(count: int) -> int:
        return count if frames is None else min(count, frames)

    for half in HALVES:
        for kind in KINDS:
            if kind == "free":
                for number in range(_FREE_COURSES):
                    yield course(kind, half, number, (320, 240), at_most(_FREE_FRAMES))
                yield course(kind, half, _FREE_COURSES, (640, 480), at_most(_FREE_FRAMES_LARGE))
                continue
            for number in range(3):
                size = (640, 480) if number == 2 else (320, 240)
                yield course(kind, half, number, size, at_most(_FRAMES))


_FRAMES = 10
# Six at 320x240 and one at 640x480 in each half: 270.
_FREE_COURSES, _FREE_FRAMES, _FREE_FRAMES_LARGE = 6, 40, 30


def _drive(rng: np.random.Generator, world: _World) -> CameraPath:
    """Four seconds ahead; the camera sways, nods and leans a little about a pose of its own."""
    height_m, pitch_rad = float(rng.uniform(0.42, 0.75)), float(rng.uniform(0.0, 0.09))
    points = []
    for i in range(6):
        ahead_m = world.advance_m * i / 5
        points.append(
            Waypoint(
                4.0 * i / 5,
                (ahead_m, float(rng.uniform(-0.04, 0.04)), height_m),
                yaw_rad=float(rng.uniform(-1, 1)) * world.sway_rad,
                pitch_rad=pitch_rad + float(rng.normal(0, 0.008)),
                roll_rad=float(rng.normal(0, 0.008)),
            )
        )
    return CameraPath(points)


# ---- rooms -------------------------------------------------------------------------------------


def _room(rng: np.random.Generator, half: Half, length_m: float, half_width_m: float) -> Room:
    def wall() -> Material:
        return _pick(rng, _WALLS[half])

    return Room(
        (-2.0, length_m),
        (-half_width_m, half_width_m),
        height_m=float(rng.uniform(2.5, 3.0)),
        floor=_pick(rng, _FLOORS[half]),
        front=wall(),
        back=wall(),
        left=wall(),
        right=wall(),
    )


def _pick(rng: np.random.Generator, materials: tuple[Material, ...]) -> Material:
    return materials[int(rng.integers(len(materials)))]


def _places(
    rng: np.random.Generator, count: int, near_m: float, far_m: float, apart_m: float
) -> list[tuple[float, float]]:
    """Points on the floor that the camera sees, spread in depth, in front of each other only by chance."""
    places: list[tuple[float, float]] = []
    steps = np.linspace(near_m, far_m, count)
    for x in steps:
        for _ in range(50):
            y = float(rng.uniform(-0.42, 0.42) * x)
            if all(np.hypot(x - px, y - py) >= apart_m and abs(y / x - py / px) > 0.1 for px, py in places):
                break
        else:
            continue
        places.append((float(x + rng.uniform(-0.15, 0.15)), y))
    return places


def _box(rng: np.random.Generator, name: str, x_m: float, y_m: float) -> Box:
    """A box on the floor, square on or corner on."""
    side_m, deep_m, tall_m = (float(value) for value in rng.uniform((0.25, 0.25, 0.25), (0.7, 0.6, 1.1)))
    yaw = float(rng.choice([0.0, np.pi / 4]) + rng.normal(0, 0.06))
    return Box(name, (x_m, y_m, tall_m / 2), (deep_m, side_m, tall_m), _pick(rng, _THINGS), yaw_rad=yaw)


def _boxes(rng: np.random.Generator, half: Half) -> _World:
    places = _places(rng, 5, 1.9, 6.2, 1.0)
    solids = tuple(_box(rng, f"box {i}", x, y) for i, (x, y) in enumerate(places))
    return _World(_room(rng, half, float(rng.uniform(8.0, 10.0)), float(rng.uniform(2.6, 3.2))), solids)


def _corridor(rng: np.random.Generator, half: Half) -> _World:
    side_m = float(rng.uniform(1.1, 1.4))
    solids: list[Solid] = []
    for i, x in enumerate((2.6, 3.9, 5.4)):
        box = _box(rng, f"box {i}", x, 0.0)
        y = float(rng.choice([-1, 1])) * (side_m - 0.5)
        solids.append(replace(box, center_m=(x, y, box.center_m[2])))
    solids.append(Pole("bollard", 4.7, float(rng.uniform(-0.2, 0.2)), 0.06, 1.0, HAZARD))
    return _World(_room(rng, half, float(rng.uniform(9.0, 12.0)), side_m), tuple(solids), sway_rad=0.05)


def _poles(rng: np.random.Generator, half: Half) -> _World:
    places = _places(rng, 5, 1.7, 5.8, 0.9)
    solids: list[Solid] = [
        Pole(f"pole {i}", x, y, POLE_DIAMETER_M / 2 if i % 2 == 0 else 0.04, 1.9, _pick(rng, (GREEN, RED, HAZARD)))
        for i, (x, y) in enumerate(places)
    ]
    return _World(_room(rng, half, float(rng.uniform(8.0, 10.0)), float(rng.uniform(2.6, 3.2))), tuple(solids))


def _kerbs(rng: np.random.Generator, half: Half) -> _World:
    """Two kerbs across the way and one along it, and a box beside."""
    h = KERB_HEIGHT_M
    near_m, far_m = float(rng.uniform(2.2, 2.6)), float(rng.uniform(3.8, 4.6))
    solids: tuple[Solid, ...] = (
        Box(
            "near kerb", (near_m, 0.5, h / 2), (0.15, 1.4, h), _pick(rng, (HAZARD, CONCRETE)), float(rng.normal(0, 0.1))
        ),
        Box(
            "far kerb",
            (far_m, -0.6, h / 2),
            (0.2, 1.6, h),
            _pick(rng, (HAZARD, CARDBOARD)),
            float(rng.uniform(-0.5, 0.5)),
        ),
        _box(rng, "box", float(rng.uniform(4.8, 5.6)), 1.5),
    )
    return _World(_room(rng, half, float(rng.uniform(8.0, 10.0)), 3.0), solids, advance_m=0.6)


def _ramps(rng: np.random.Generator, half: Half) -> _World:
    """A gentle ramp and a platform as wide as the room, a box on it, or a steep ramp to keep off."""
    room = _room(rng, half, 10.0, float(rng.uniform(1.6, 2.2)))
    wide_m = room.y_m[1] - room.y_m[0]
    foot_m, run_m = float(rng.uniform(2.4, 3.2)), 2.4
    rise_m = run_m * np.tan(RAMP_PITCH_RAD)
    # The ramp's upper face runs from (foot, 0) to (foot + run, rise).
    thick_m, slope_m = 0.3, float(np.hypot(run_m, rise_m))
    middle = np.array([foot_m + run_m / 2, 0.0, rise_m / 2])
    down = np.array([np.sin(RAMP_PITCH_RAD), 0.0, -np.cos(RAMP_PITCH_RAD)]) * thick_m / 2
    ramp = Box("ramp", tuple(middle + down), (slope_m, wide_m, thick_m), room.floor, pitch_rad=-RAMP_PITCH_RAD)
    platform = Box("platform", (foot_m + run_m + 4.0, 0.0, rise_m / 2), (8.0, wide_m, float(rise_m)), room.floor)
    crate = _box(rng, "box", foot_m + run_m + 0.6, float(rng.uniform(-0.5, 0.5)))
    crate = replace(crate, center_m=(*crate.center_m[:2], crate.center_m[2] + float(rise_m)))
    long_m, y = 1.2, float(rng.choice([-0.8, 0.8]))
    half_rise = long_m / 2 * np.sin(_LOADING_RAMP_RAD)
    loading = Box(
        "loading ramp",
        (2.0 + long_m / 2, y, float(half_rise)),
        (long_m, 0.5, 0.02),
        _pick(rng, (CRATE, CARDBOARD)),
        pitch_rad=-_LOADING_RAMP_RAD,
    )
    return _World(room, (ramp, platform, crate, loading), frozenset({"ramp", "platform"}), sway_rad=0.04, advance_m=0.5)


def _textureless(rng: np.random.Generator, half: Half) -> _World:
    world = _corridor(rng, half) if rng.random() < 0.5 else _boxes(rng, half)
    room = replace(world.room, front=WHITEWASH, left=WHITEWASH, right=WHITEWASH)
    return replace(world, room=room)


def _repetitive(rng: np.random.Generator, half: Half) -> _World:
    world = _corridor(rng, half) if rng.random() < 0.5 else _boxes(rng, half)
    return replace(world, room=replace(world.room, front=POSTS, left=POSTS, right=POSTS))


def _free(rng: np.random.Generator, half: Half) -> _World:
    """Nothing ahead for six metres: walls of every sort at the sides, sometimes things along them."""
    side_m = float(rng.uniform(1.1, 2.2))
    room = _room(rng, half, 13.0, side_m)
    style = int(rng.integers(4))
    if style == 1:
        room = replace(room, left=WHITEWASH, right=WHITEWASH, front=WHITEWASH)
    elif style == 2:
        room = replace(room, left=POSTS, right=POSTS)
    elif style == 3:
        room = replace(room, floor=WHITEWASH)
    solids: tuple[Solid, ...] = ()
    if side_m > 1.5:
        solids = tuple(
            Box(f"shelf {i}", (x, sign * (side_m - 0.2), 0.5), (0.5, 0.4, 1.0), _pick(rng, _THINGS))
            for i, (x, sign) in enumerate(zip((3.0, 5.0, 7.5, 9.5), rng.choice([-1, 1], 4), strict=True))
        )
    return _World(room, solids, advance_m=4.5, sway_rad=0.035)


_MAKERS: dict[str, _Maker] = {
    "boxes": _boxes,
    "corridor": _corridor,
    "poles": _poles,
    "kerbs": _kerbs,
    "ramps": _ramps,
    "textureless": _textureless,
    "repetitive": _repetitive,
    "free": _free,
}
KINDS = tuple(_MAKERS)
