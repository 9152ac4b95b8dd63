"""The cameras of the rendered rig: a pinhole with Brown–Conrady distortion, and the pose of the right one."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

_NEWTON_STEPS = 12


@dataclass(frozen=True)
class BrownCamera:
    """A lens: ``fx, fy, cx, cy`` in pixels, ``distortion`` as k1 k2 p1 p2 (Brown 1971, OpenCV's order), image size.

    The frame is the optical one: z forward, x right, y down. (0, 0) is the centre of the top-left pixel.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float]
    width: int
    height: int

    @property
    def camera_matrix(self) -> Floats:
        """The 3x3 matrix K."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def project(self, points_m: ArrayLike) -> Floats:
        """Pixels (..., 2) of points (..., 3) in the camera's frame, metres; NaN for points not in front."""
        points = np.asarray(points_m, float)
        depth = np.where(points[..., 2] > 0, points[..., 2], np.nan)
        x, y = self._distort(points[..., 0] / depth, points[..., 1] / depth)
        return np.stack([self.fx * x + self.cx, self.fy * y + self.cy], axis=-1)

    def rays(self, pixels: ArrayLike) -> Floats:
        """Directions (..., 3) with z = 1 that project onto pixels (..., 2): Newton's method on the distortion."""
        pixels = np.asarray(pixels, float)
        xd = (pixels[..., 0] - self.cx) / self.fx
        yd = (pixels[..., 1] - self.cy) / self.fy
        x, y = xd.copy(), yd.copy()
        k1, k2, p1, p2 = self.distortion
        for _ in range(_NEWTON_STEPS):
            r2 = x * x + y * y
            radial = 1 + r2 * (k1 + r2 * k2)
            slope = 2 * (k1 + 2 * k2 * r2)
            ex, ey = self._distort(x, y)
            ex -= xd
            ey -= yd
            jxx = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
            jyy = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
            jxy = slope * x * y + 2 * p1 * x + 2 * p2 * y
            det = jxx * jyy - jxy * jxy
            step_x = (jyy * ex - jxy * ey) / det
            step_y = (jxx * ey - jxy * ex) / det
            x -= step_x
            y -= step_y
            if max(np.abs(step_x).max(initial=0.0), np.abs(step_y).max(initial=0.0)) < 1e-14:
                break
        return np.stack([x, y, np.ones_like(x)], axis=-1)

    @cached_property
    def pixel_rays(self) -> Floats:
        """Directions (H, W, 3) with z = 1 of every pixel's centre, computed once."""
        cols, rows = np.meshgrid(np.arange(self.width), np.arange(self.height))
        return self.rays(np.stack([cols, rows], axis=-1))

    def _distort(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        k1, k2, p1, p2 = self.distortion
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * k2)
        xd: Floats = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        yd: Floats = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return xd, yd


@dataclass(frozen=True)
class RigTruth:
    """What a calibration should find: both cameras and ``p_right = rotation · p_left + translation_m``."""

    left: BrownCamera
    right: BrownCamera
    rotation: Floats
    translation_m: Floats

    @property
    def baseline_m(self) -> float:
        """Distance between the cameras."""
        return float(np.linalg.norm(self.translation_m))

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of both images, pixels."""
        return self.left.width, self.left.height

    @property
    def left_from_right(self) -> Floats:
        """Pose (4, 4) of the right camera in the left one's frame."""
        pose = np.eye(4)
        pose[:3, :3] = self.rotation.T
        pose[:3, 3] = -self.rotation.T @ self.translation_m
        return pose

    def right_from_left(self, points_m: ArrayLike) -> Floats:
        """Points (..., 3) of the left camera's frame in the right camera's."""
        return np.asarray(np.asarray(points_m, float) @ self.rotation.T + self.translation_m, float)


def default_rig(width: int, height: int) -> RigTruth:
    """Two ordinary cameras, nearly parallel, 118.7 mm apart: no number is round, no two are equal."""
    scale = width / 640

    def camera(fx: float, fy: float, dx: float, dy: float, lens: tuple[float, float, float, float]) -> BrownCamera:
        cx, cy = (width - 1) / 2 + dx * scale, (height - 1) / 2 + dy * scale
        return BrownCamera(fx * scale, fy * scale, cx, cy, lens, width, height)

    direction = np.array([-1.0, 0.0107, -0.0083])
    return RigTruth(
        left=camera(518.3, 518.9, 3.1, -2.1, (-0.281, 0.092, 5.2e-4, -3.1e-4)),
        right=camera(521.7, 522.1, -2.7, 3.6, (-0.274, 0.086, -4.1e-4, 2.6e-4)),
        rotation=rotation_xyz(*np.deg2rad([0.6, -0.9, 0.4])),
        translation_m=0.1187 * direction / np.linalg.norm(direction),
    )


def rotation_xyz(x_rad: float, y_rad: float, z_rad: float) -> Floats:
    """The rotation about x, then y, then z (all fixed axes)."""
    (cx, cy, cz), (sx, sy, sz) = np.cos([x_rad, y_rad, z_rad]), np.sin([x_rad, y_rad, z_rad])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x, float)


def world_from_optical(position_m: ArrayLike, yaw_rad: float, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> Floats:
    """Pose (4, 4) of a camera in the world (x forward, y left, z up).

    Yaw turns left, pitch looks down, roll leans right; all zero looks along the world's x axis.
    """
    body_from_optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose = np.eye(4)
    pose[:3, :3] = rotation_xyz(roll_rad, pitch_rad, yaw_rad) @ body_from_optical
    pose[:3, 3] = np.asarray(position_m, float)
    return pose
