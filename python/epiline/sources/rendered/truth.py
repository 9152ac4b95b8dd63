"""What a perfect system would answer: depth, range, disparity, occlusion, obstacles, nearest ranges."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epiline._core import RectifiedGeometry
from epiline.sources.rendered.camera import BrownCamera, Floats, RigTruth
from epiline.sources.rendered.raycast import Tracer
from epiline.sources.rendered.scene import Scene

# x, y, width, height, pixels.
Box: TypeAlias = tuple[int, int, int, int]

# A surface seen in a box is taken as one as long as its ranges lie within this share of its nearest one.
SURFACE_DEPTH_SHARE = 0.05


@dataclass(frozen=True)
class ObstacleTruth:
    """One obstacle as the left view sees it.

    Attributes
    ----------
    name, object_id : str, int
        Which solid of the scene.
    range_m, depth_m : float
        Nearest supported Euclidean range, and the nearest supported Z (rule of :func:`nearest_supported`).
    bearing_rad : float
        Of its visible pixels' median column; positive to the right of the optical axis.
    box : (x, y, width, height)
        The visible pixels' extent.
    pixels : int
        How many are visible.
    """

    name: str
    object_id: int
    range_m: float
    depth_m: float
    bearing_rad: float
    box: Box
    pixels: int


@dataclass(frozen=True)
class ViewTruth:
    """Exact geometry of one view of a scene, at the centre of every pixel.

    Attributes
    ----------
    depth_m : (H, W) float64
        Z along the view's optical axis, metres.
    object_id : (H, W) int16
        Index into ``scene.names``.
    directions : (H, W, 3) float64
        Rays of the view's frame, z = 1: a point is ``depth_m · direction``.
    world_from_view : (4, 4) float64
        Pose of the view.
    scene : Scene
        What is seen.
    """

    depth_m: Floats
    object_id: NDArray[np.int16]
    directions: Floats
    world_from_view: Floats
    scene: Scene

    @cached_property
    def range_m(self) -> Floats:
        """(H, W) Euclidean distance from the camera, metres."""
        return np.asarray(self.depth_m * np.linalg.norm(self.directions, axis=-1), float)

    @cached_property
    def points_world_m(self) -> Floats:
        """(H, W, 3) points in the world."""
        points = self.directions * self.depth_m[..., None]
        return np.asarray(points @ self.world_from_view[:3, :3].T + self.world_from_view[:3, 3], float)

    def disparity_px(self, focal_px: float, baseline_m: float, doffs_px: float = 0.0) -> Floats:
        """(H, W) disparity of an aligned view, pixels: eq. 2 solved for d."""
        return focal_px * baseline_m / self.depth_m - doffs_px

    def obstacles(self, *, within: Box | None = None, min_pixels: int = 8) -> list[ObstacleTruth]:
        """The obstacles of which at least `min_pixels` are visible, in all of the view or in a box; nearest first."""
        x, y, width, height = within or (0, 0, self.depth_m.shape[1], self.depth_m.shape[0])
        window = (slice(max(y, 0), y + height), slice(max(x, 0), x + width))
        ids, ranges, depths = self.object_id[window], self.range_m[window], self.depth_m[window]
        found = []
        for object_id in self.scene.obstacle_ids:
            rows, cols = np.nonzero(ids == object_id)
            if rows.size < max(min_pixels, 1):
                continue
            column = float(np.median(self.directions[window][rows, cols, 0]))
            found.append(
                ObstacleTruth(
                    name=self.scene.names[object_id],
                    object_id=object_id,
                    range_m=nearest_supported(ranges[rows, cols], min_pixels),
                    depth_m=nearest_supported(depths[rows, cols], min_pixels),
                    bearing_rad=float(np.arctan(column)),
                    box=(
                        int(cols.min()) + max(x, 0),
                        int(rows.min()) + max(y, 0),
                        int(np.ptp(cols)) + 1,
                        int(np.ptp(rows)) + 1,
                    ),
                    pixels=int(rows.size),
                )
            )
        return sorted(found, key=lambda obstacle: obstacle.range_m)

    def nearest_range_m(self, box: Box, *, min_pixels: int = 8) -> float:
        """Nearest supported range of anything in a box of the view, metres."""
        x, y, width, height = box
        return nearest_supported(self.range_m[max(y, 0) : y + height, max(x, 0) : x + width], min_pixels)


def true_view(scene: Scene | Tracer, world_from_view: Floats, directions: Floats) -> ViewTruth:
    """Casts a view's rays (H, W, 3), z = 1, in double precision."""
    tracer = scene if isinstance(scene, Tracer) else Tracer(scene)
    turned = directions @ world_from_view[:3, :3].T
    parts = tracer.windows(world_from_view, directions[..., 0], directions[..., 1])
    rays = (turned[..., 0], turned[..., 1], turned[..., 2])
    depth, surface = tracer.cast(world_from_view[:3, 3], rays, parts)
    return ViewTruth(depth, tracer.object_of[surface], directions, world_from_view, tracer.scene)


def true_raw(scene: Scene | Tracer, world_from_camera: Floats, camera: BrownCamera) -> ViewTruth:
    """Truth at the pixels of a raw, distorted image."""
    return true_view(scene, world_from_camera, camera.pixel_rays)


def true_depth(
    scene: Scene | Tracer,
    world_from_left: Floats,
    *,
    focal_px: float,
    cx_px: float,
    cy_px: float,
    width: int,
    height: int,
    aligned_from_left: ArrayLike | None = None,
) -> ViewTruth:
    """Truth at the pixels of the aligned left image of any rectification.

    Parameters
    ----------
    scene : Scene or Tracer
        The world.
    world_from_left : (4, 4) float64
        Pose of the raw left camera; the aligned one shares its centre.
    focal_px, cx_px, cy_px, width, height
        The rectified geometry.
    aligned_from_left : (3, 3), optional
        Rotates left-camera directions into the aligned frame; identity if not given.

    Returns
    -------
    ViewTruth
        Depth along the *aligned* optical axis.
    """
    rotation = np.eye(3) if aligned_from_left is None else np.asarray(aligned_from_left, float)
    cols, rows = np.meshgrid(np.arange(width), np.arange(height))
    directions = np.stack([(cols - cx_px) / focal_px, (rows - cy_px) / focal_px, np.ones(cols.shape)], axis=-1)
    world_from_aligned = world_from_left.copy()
    world_from_aligned[:3, :3] = world_from_left[:3, :3] @ rotation.T
    return true_view(scene, world_from_aligned, directions)


def true_aligned(scene: Scene | Tracer, world_from_left: Floats, geometry: RectifiedGeometry) -> ViewTruth:
    """Truth at the pixels of the aligned left image of a rectified pair: :func:`true_depth` of its geometry."""
    return true_depth(
        scene,
        world_from_left,
        focal_px=geometry.focal_px,
        cx_px=geometry.cx_px,
        cy_px=geometry.cy_px,
        width=geometry.width,
        height=geometry.height,
        aligned_from_left=geometry.aligned_from_left,
    )


def seen_by_right(view: ViewTruth, rig: RigTruth, world_from_left: Floats) -> NDArray[np.bool_]:
    """(H, W): which points of a left view the right camera sees: inside its image, and nothing in front."""
    world_from_right = world_from_left @ rig.left_from_right
    origin = world_from_right[:3, 3]
    toward = view.points_world_m - origin
    reached, _ = Tracer(view.scene).cast(origin, (toward[..., 0], toward[..., 1], toward[..., 2]))
    pixels = rig.right.project(toward @ world_from_right[:3, :3])
    with np.errstate(invalid="ignore"):
        inside = (
            (pixels[..., 0] >= -0.5)
            & (pixels[..., 0] <= rig.right.width - 0.5)
            & (pixels[..., 1] >= -0.5)
            & (pixels[..., 1] <= rig.right.height - 0.5)
        )
    # The ray's parameter is 1 at the point itself.
    return np.asarray(inside & (reached > 1 - 1e-6), bool)


def nearest_supported(values: ArrayLike, min_pixels: int) -> float:
    """The nearest distance that enough pixels agree on; NaN if none.

    The smallest `v` such that at least `min_pixels` finite values lie in ``[v, 1.05 v]``. It is the same rule for
    true and for measured images: a few stray pixels in front of a surface do not count in either.
    """
    finite = np.sort(np.asarray(values, float).ravel())
    finite = finite[np.isfinite(finite)]
    if min_pixels < 1:
        raise ValueError(f"min_pixels is {min_pixels}: at least 1")
    if finite.size < min_pixels:
        return float("nan")
    first, last = finite[: finite.size - min_pixels + 1], finite[min_pixels - 1 :]
    supported = np.flatnonzero(last <= first * (1 + SURFACE_DEPTH_SHARE))
    return float(first[supported[0]]) if supported.size else float("nan")


def column_nearest(values: ArrayLike, box: Box, *, min_pixels: int = 3) -> Floats:
    """:func:`nearest_supported` of each column of a box of an image (H, W)."""
    x, y, width, height = box
    window = np.asarray(values, float)[max(y, 0) : y + height, max(x, 0) : x + width]
    columns: Iterable[Floats] = window.T
    return np.array([nearest_supported(column, min_pixels) for column in columns])
