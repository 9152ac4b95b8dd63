"""Procedural textures: patterns of numbers in [0, 1] with a pyramid, painted by a ramp of colours.

Every pattern tiles, holds detail from metres to millimetres, so that a wall can be matched from near and from far,
and is read through a pyramid at the size of the pixel's footprint, so that nothing aliases: aliasing differs between
the two cameras and would be an error of the renderer, not of the matcher.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Singles = NDArray[np.float32]

TEXELS = 1024
_LEVELS = 11
# Where each level of the pyramid begins in the flat array.
_STARTS = np.concatenate([[0], np.cumsum([(TEXELS >> level) ** 2 for level in range(_LEVELS)])[:-1]]).astype(np.int32)


@dataclass(frozen=True)
class Pattern:
    """A square, tiling picture of `tile_m` metres and its pyramid, stored as one flat array."""

    pyramid: Singles
    tile_m: float

    def sample(self, u_m: Singles, v_m: Singles, footprint_m: Singles) -> Singles:
        """Values at surface positions (N,), averaged over a footprint (N,), metres: trilinear (Williams 1983)."""
        level = np.log2(np.maximum(footprint_m * np.float32(TEXELS / self.tile_m), 1.0))
        np.minimum(level, np.float32(_LEVELS - 1.001), out=level)
        fine = level.astype(np.int32)
        level -= fine
        u, v = u_m * np.float32(1 / self.tile_m), v_m * np.float32(1 / self.tile_m)
        near = self._bilinear(u, v, fine)
        near += level * (self._bilinear(u, v, fine + 1) - near)
        return near

    def _bilinear(self, u: Singles, v: Singles, level: NDArray[np.int32]) -> Singles:
        side = np.right_shift(np.int32(TEXELS), level)
        x, y = u * side - np.float32(0.5), v * side - np.float32(0.5)
        left, top = np.floor(x), np.floor(y)
        x -= left
        y -= top
        mask = side - 1
        c0 = left.astype(np.int32) & mask
        r0 = top.astype(np.int32) & mask
        c1, r1 = (c0 + 1) & mask, (r0 + 1) & mask
        start = _STARTS[level]
        upper, lower = start + r0 * side, start + r1 * side
        take = self.pyramid.take
        a, b = take(upper + c0), take(lower + c0)
        a += x * (take(upper + c1) - a)
        b += x * (take(lower + c1) - b)
        a += y * (b - a)
        return np.asarray(a, np.float32)


@dataclass(frozen=True)
class Material:
    """How a surface looks.

    Attributes
    ----------
    pattern : str
        Name of a pattern of :func:`pattern`.
    colors : tuple of (blue, green, red)
        Radiance in 0..255 at pattern values spread evenly from 0 to 1.
    scale : float
        How much larger the pattern is than its own size.
    border_m : float
        Width of a darker frame along the edges of a box's faces, as of a crate.
    tape_m : float
        Width of a lighter band through the middle of a box's faces, as of a parcel.
    """

    pattern: str
    colors: tuple[tuple[int, int, int], ...]
    scale: float = 1.0
    border_m: float = 0.0
    tape_m: float = 0.0

    def ramp(self) -> Singles:
        """The colours (256, 3) for pattern values 0..1."""
        stops = np.linspace(0, 1, len(self.colors))
        grid = np.linspace(0, 1, 256)
        return np.stack([np.interp(grid, stops, channel) for channel in zip(*self.colors, strict=True)], 1).astype(
            np.float32
        )


@lru_cache(maxsize=32)
def pattern(name: str, seed: int) -> Pattern:
    """The pattern of that name; the same seed gives the same numbers everywhere."""
    maker, tile_m = _PATTERNS[name]
    picture = np.clip(maker(seed), 0, 1).astype(np.float32)
    levels = [picture]
    while levels[-1].shape[0] > 1:
        fine = levels[-1]
        levels.append((fine[::2, ::2] + fine[1::2, ::2] + fine[::2, 1::2] + fine[1::2, 1::2]) / np.float32(4))
    return Pattern(np.concatenate([level.ravel() for level in levels]), tile_m)


@lru_cache(maxsize=4)
def _fractal(seed: int) -> NDArray[np.float64]:
    """Tiling noise of zero mean and about unit deviation, octaves from half the tile down to two texels."""
    rng = np.random.default_rng([seed, 11])
    total = np.zeros((TEXELS, TEXELS))
    for octave in range(2, 10):
        total += _value_noise(rng, 2**octave, 2**octave) * (0.75 if octave < 4 else 1.0)
    return np.asarray(total / total.std(), float)


def _value_noise(rng: np.random.Generator, rows: int, cols: int) -> NDArray[np.float64]:
    """A lattice of random numbers, interpolated by cubic B-splines, tiling."""
    lattice = rng.standard_normal((rows, cols))
    smooth = _spline(rows) @ lattice @ _spline(cols).T
    return np.asarray(smooth / smooth.std(), float)


@lru_cache(maxsize=16)
def _spline(knots: int) -> NDArray[np.float64]:
    position = (np.arange(TEXELS) + 0.5) * knots / TEXELS
    cell = np.floor(position).astype(int)
    t = position - cell
    weights = ((1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3)
    matrix = np.zeros((TEXELS, knots))
    for offset, weight in zip((-1, 0, 1, 2), weights, strict=True):
        np.add.at(matrix, (np.arange(TEXELS), (cell + offset) % knots), weight / 6)
    return matrix


def _grid() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    along = (np.arange(TEXELS) + 0.5) / TEXELS
    u, v = np.meshgrid(along, along)
    return u, v


def _per_cell(seed: int, salt: int, cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """One random number in 0..1 for each cell number."""
    return np.random.default_rng([seed, salt]).random(int(cells.max()) + 1)[cells]


def _groove(position: NDArray[np.float64], width: float) -> NDArray[np.float64]:
    """0 in a joint of that share of the cell, 1 elsewhere, with soft sides."""
    edge = np.minimum(position % 1, 1 - position % 1)
    return np.asarray(np.clip(edge / width, 0, 1) ** 0.7, float)


def _concrete(seed: int) -> NDArray[np.float64]:
    return 0.5 + 0.17 * _fractal(seed)


def _plaster(seed: int) -> NDArray[np.float64]:
    rng = np.random.default_rng([seed, 12])
    speckle = _value_noise(rng, 512, 512)
    return 0.55 + 0.11 * np.roll(_fractal(seed), (311, 97), (0, 1)) + 0.05 * speckle


def _planks(seed: int) -> NDArray[np.float64]:
    """Sixteen boards across the tile, joints staggered, grain along them."""
    u, v = _grid()
    board = np.floor(v * 16).astype(int)
    along = u * 2 + _per_cell(seed, 13, board)
    piece = board * 4 + np.floor(along).astype(int) % 2
    rng = np.random.default_rng([seed, 14])
    grain = _value_noise(rng, 512, 16) + 0.8 * _value_noise(rng, 256, 32) + 0.6 * _value_noise(rng, 512, 128)
    tone = _per_cell(seed, 15, piece)
    value = 0.3 + 0.34 * tone + 0.07 * grain + 0.07 * _fractal(seed)
    return value * _groove(v * 16, 0.04) * _groove(along, 0.004)


def _bricks(seed: int) -> NDArray[np.float64]:
    """Running bond: eight bricks along, 24 courses up; mortar is dark in the pattern and pale by its ramp."""
    u, v = _grid()
    course = np.floor(v * 24).astype(int)
    along = u * 8 + 0.5 * (course % 2)
    brick = course * 8 + np.floor(along).astype(int) % 8
    value = 0.42 + 0.36 * _per_cell(seed, 16, brick) + 0.09 * np.roll(_fractal(seed), (57, 401), (0, 1))
    joint = np.minimum(_groove(v * 24, 0.09), _groove(along, 0.035))
    return value * joint + 0.1 * (1 - joint) * (1 + 0.5 * _fractal(seed))


def _tiles(seed: int) -> NDArray[np.float64]:
    """Four by four ceiling panels with pinholes."""
    u, v = _grid()
    rng = np.random.default_rng([seed, 17])
    holes = np.clip(_value_noise(rng, 512, 512) - 1.1, 0, 1)
    panel = np.floor(u * 4).astype(int) * 4 + np.floor(v * 4).astype(int)
    value = 0.72 + 0.1 * _per_cell(seed, 18, panel) + 0.07 * _fractal(seed) - 0.3 * holes
    return value * np.minimum(_groove(u * 4, 0.012), _groove(v * 4, 0.012))


def _hazard(seed: int) -> NDArray[np.float64]:
    """Slanting stripes, worn."""
    u, v = _grid()
    stripe = np.clip(np.sin(2 * np.pi * (4 * v + 4 * u)) * 6, -1, 1)
    return np.asarray(0.5 + 0.36 * stripe + 0.09 * np.roll(_fractal(seed), (201, 5), (0, 1)), float)


def _lockers(seed: int) -> NDArray[np.float64]:
    """Tall metal doors with vents."""
    u, v = _grid()
    value = 0.6 + 0.08 * _fractal(seed) + 0.06 * _per_cell(seed, 19, np.floor(u * 6).astype(int))
    vents = (np.sin(2 * np.pi * 40 * v) > 0.3) & (np.abs((v * 2) % 1 - 0.8) < 0.1) & (np.abs((u * 6) % 1 - 0.5) < 0.28)
    return np.where(vents, 0.22, value) * _groove(u * 6, 0.03)


def _posts(seed: int) -> NDArray[np.float64]:
    """Upright bars of equal width: repeats along the scan-line, to try a matcher's judgement."""
    u, _ = _grid()
    return np.asarray(0.5 + 0.4 * np.clip(np.sin(2 * np.pi * 16 * u) * 4, -1, 1), float)


def _plain(seed: int) -> NDArray[np.float64]:
    """One tone: nothing to match."""
    return np.full((TEXELS, TEXELS), 0.5)


_PATTERNS = {
    "concrete": (_concrete, 2.0),
    "plaster": (_plaster, 2.4),
    "planks": (_planks, 2.24),
    "bricks": (_bricks, 1.92),
    "tiles": (_tiles, 2.4),
    "hazard": (_hazard, 0.8),
    "lockers": (_lockers, 2.1),
    "posts": (_posts, 2.4),
    "plain": (_plain, 1.0),
}
