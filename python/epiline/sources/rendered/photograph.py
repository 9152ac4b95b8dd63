"""A photograph of a scene: one ray through every pixel, more where edges run, then the sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from epiline.sources.rendered.camera import BrownCamera, Floats
from epiline.sources.rendered.raycast import Part, Rays, Tracer, Window
from epiline.sources.rendered.shading import board_parity, shade, surface_coordinates
from epiline.sources.rendered.textures import Singles

# Samples along one side of a pixel that holds an edge: 5 x 5 place a chessboard's corner within 0.01 px.
EDGE_SAMPLES = 5


@dataclass(frozen=True)
class Sensor:
    """What stands between radiance and the file.

    Attributes
    ----------
    gain : float
        Exposure: radiance is multiplied by it.
    read_noise, shot_noise : float
        Variance of a value `s` in 0..255 is ``read_noise² + shot_noise·s``; independent in each channel.
    blur_px : float
        Standard deviation of the lens's Gaussian blur, pixels.
    """

    gain: float = 1.0
    read_noise: float = 0.8
    shot_noise: float = 0.02
    blur_px: float = 0.45

    def expose(self, radiance: Singles, rng: np.random.Generator) -> NDArray[np.uint8]:
        """The image (H, W, 3) uint8 of a radiance image."""
        signal: Singles = _blur(radiance, self.blur_px) * np.float32(self.gain)
        deviation = np.sqrt(np.float32(self.read_noise**2) + np.float32(self.shot_noise) * signal)
        signal += deviation * rng.standard_normal(signal.shape, dtype=np.float32)
        return np.clip(np.rint(signal), 0, 255).astype(np.uint8)


class Lens:
    """A camera's rays, single precision, and how they change from pixel to pixel."""

    def __init__(self, camera: BrownCamera) -> None:
        rays = camera.pixel_rays
        self.x = np.ascontiguousarray(rays[..., 0], np.float32)
        self.y = np.ascontiguousarray(rays[..., 1], np.float32)
        # np.gradient of the double-precision rays: differences of neighbours lose half the digits in single.
        (self.x_down, self.x_right), (self.y_down, self.y_right) = (
            [np.ascontiguousarray(slope, np.float32) for slope in np.gradient(rays[..., axis])] for axis in (0, 1)
        )
        self.pixel_rad = 1 / float(np.sqrt(camera.fx * camera.fy))

    @property
    def shape(self) -> tuple[int, int]:
        return self.x.shape[0], self.x.shape[1]


def render(tracer: Tracer, lens: Lens, world_from_camera: Floats) -> Singles:
    """Radiance (H, W, 3) in 0..255, each pixel averaged over its area."""
    rotation, origin = world_from_camera[:3, :3], world_from_camera[:3, 3]
    rays = _turn(rotation, lens.x, lens.y)
    parts = tracer.windows(world_from_camera, lens.x, lens.y)
    depth, surface = tracer.cast(origin, rays, parts)
    flat: Rays = (rays[0].ravel(), rays[1].ravel(), rays[2].ravel())
    radiance = shade(tracer, origin, flat, depth.ravel(), surface.ravel(), lens.pixel_rad)

    on_edge = np.flatnonzero(_edges(_features(tracer, origin, rays, depth, surface)))
    if on_edge.size:
        radiance[on_edge] = _supersample(tracer, lens, world_from_camera, on_edge, parts)
    return radiance.reshape(*lens.shape, 3)


def _turn(rotation: Floats, x: Singles, y: Singles) -> Rays:
    """Directions (x, y, 1) of the camera in the world."""
    r = rotation.astype(np.float32)
    return (
        r[0, 0] * x + (r[0, 1] * y + r[0, 2]),
        r[1, 0] * x + (r[1, 1] * y + r[1, 2]),
        r[2, 0] * x + (r[2, 1] * y + r[2, 2]),
    )


def _features(
    tracer: Tracer, origin: Floats, rays: Rays, depth: Singles, surface: NDArray[np.int16]
) -> NDArray[np.int16]:
    """Surface numbers, with the squares of a board told apart."""
    feature: NDArray[np.int16] = surface * np.int16(2)
    for number, face in enumerate(tracer.surfaces):
        if face.board is None:
            continue
        rows, cols = np.nonzero(surface == number)
        at = depth[rows, cols]
        points = tuple(np.float32(start) + at * ray[rows, cols] for start, ray in zip(origin, rays, strict=True))
        u, v = surface_coordinates(face, (points[0], points[1], points[2]))
        feature[rows, cols] += board_parity(face.board, u, v)
    return feature


def _edges(feature: NDArray[np.int16]) -> NDArray[np.bool_]:
    """Pixels whose feature differs from a neighbour's, eight neighbours each."""
    edge = np.zeros(feature.shape, bool)
    for rows, cols in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(rows, None), slice(max(cols, 0), feature.shape[1] + min(cols, 0)))
        b = (slice(None, feature.shape[0] - rows), slice(max(-cols, 0), feature.shape[1] - max(cols, 0)))
        differs = feature[a] != feature[b]
        edge[a] |= differs
        edge[b] |= differs
    return edge


def _supersample(
    tracer: Tracer, lens: Lens, world_from_camera: Floats, pixels: NDArray[np.intp], parts: list[Window]
) -> Singles:
    """Mean radiance (N, 3) over a regular grid of samples in each pixel."""
    offsets = (np.arange(EDGE_SAMPLES, dtype=np.float32) + np.float32(0.5)) / EDGE_SAMPLES - np.float32(0.5)
    right, down = (grid.reshape(-1, 1) for grid in np.meshgrid(offsets, offsets))
    near = [field.ravel()[pixels] for field in (lens.x, lens.x_right, lens.x_down, lens.y, lens.y_right, lens.y_down)]
    x = near[0] + right * near[1] + down * near[2]
    y = near[3] + right * near[4] + down * near[5]
    rays = _turn(world_from_camera[:3, :3], x, y)
    rows, cols = np.divmod(pixels, lens.shape[1])
    lists: list[Part] = []
    for part in parts:
        if part is None:
            lists.append(None)
            continue
        tall, wide = part
        (top, bottom, _), (left, right_end, _) = tall.indices(lens.shape[0]), wide.indices(lens.shape[1])
        inside = (rows >= top) & (rows < bottom) & (cols >= left) & (cols < right_end)
        chosen = np.flatnonzero(inside)
        lists.append((slice(None), chosen) if chosen.size else None)
    origin = world_from_camera[:3, 3]
    depth, surface = tracer.cast(origin, rays, lists)
    flat: Rays = (rays[0].ravel(), rays[1].ravel(), rays[2].ravel())
    radiance = shade(tracer, origin, flat, depth.ravel(), surface.ravel(), lens.pixel_rad)
    return np.asarray(radiance.reshape(EDGE_SAMPLES**2, pixels.size, 3).mean(axis=0), np.float32)


def _blur(image: Singles, sigma_px: float) -> Singles:
    """Gaussian blur, separable, borders repeated."""
    if sigma_px <= 0:
        return np.array(image)
    radius = max(1, int(np.ceil(3 * sigma_px)))
    weights = np.exp(-0.5 * (np.arange(radius + 1) / sigma_px) ** 2)
    weights = (weights / (weights[0] + 2 * weights[1:].sum())).astype(np.float32)
    for axis in (0, 1):
        spans = [(radius, radius) if a == axis else (0, 0) for a in range(3)]
        padded = np.pad(image, spans, mode="edge")
        length = image.shape[axis]

        def shifted(by: int, padded: Singles = padded, axis: int = axis, length: int = length) -> Singles:
            piece = slice(radius + by, radius + by + length)
            return padded[piece] if axis == 0 else padded[:, piece]

        image = weights[0] * shifted(0)
        for by in range(1, radius + 1):
            image += weights[by] * (shifted(-by) + shifted(by))
    return image
