"""A pair of cameras as numbers that can be varied: what the covariance of a calibration means in pixels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from epiline._core import CameraModel, StereoCalibration

Floats = NDArray[np.float64]

_INTRINSICS = ("fx", "fy", "cx", "cy")
# OpenCV's order of the distortion coefficients, and that of its fisheye's.
_DISTORTION = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")
_FISHEYE = ("k1", "k2", "k3", "k4")
# Step of a derivative, in standard deviations of the parameter: small enough to be straight, far above rounding.
_STEP_SIGMAS = 0.1


@dataclass(frozen=True)
class Rig:
    """Two cameras and the pose between them; alignment as docs/conventions.md defines it."""

    left: CameraModel
    right: CameraModel
    rotation: Floats
    translation_m: Floats

    @staticmethod
    def of(calibration: StereoCalibration) -> Rig:
        return Rig(calibration.left, calibration.right, calibration.rotation, calibration.translation_m)

    def vertical_px(self, left_px: Floats, right_px: Floats) -> Floats:
        """(N,) vertical disparity of points seen at (N, 2) `left_px` and `right_px`, pixels of the aligned pair."""
        left, right = self._aligned()
        rows = [
            rays[:, 1] / rays[:, 2]
            for rays in (_rays(self.left, left_px) @ left.T, _rays(self.right, right_px) @ right.T)
        ]
        return np.asarray(self.focal_px * (rows[0] - rows[1]), np.float64)

    @property
    def focal_px(self) -> float:
        """Of the aligned pair."""
        return float(self.left.camera_matrix[1, 1] + self.right.camera_matrix[1, 1]) / 2

    def right_from_left_px(self, left_px: Floats, depth_m: float) -> Floats:
        """(N, 2) where the right camera sees what the left one sees at (N, 2) pixels in this depth."""
        points_m = depth_m * _rays(self.left, left_px)
        return np.asarray(self.right.project(points_m @ self.rotation.T + self.translation_m), np.float64)

    def varied(self, name: str, amount: float) -> Rig:
        """The rig with one parameter of the covariance changed."""
        side, _, rest = name.partition("_")
        if side in ("left", "right"):
            camera = self.left if side == "left" else self.right
            changed = _varied_camera(camera, rest, amount)
            return replace(self, left=changed) if side == "left" else replace(self, right=changed)
        axis = "xyz".index(rest[0])
        if side == "rotation":
            return replace(self, rotation=_rotation(amount * np.eye(3)[axis]) @ self.rotation)
        return replace(self, translation_m=self.translation_m + amount * np.eye(3)[axis])

    def _aligned(self) -> tuple[Floats, Floats]:
        """Rotations into the aligned frame: each camera by half of the turn between them, then the baseline level."""
        half = _rotation(_rotation_vector(self.rotation) / 2)
        centre = -half.T @ self.translation_m
        axis = np.cross(centre, [1.0, 0.0, 0.0])
        length = float(np.linalg.norm(axis))
        level = np.eye(3)
        if length > 0:
            level = _rotation(axis / length * math.atan2(length, float(centre[0])))
        return level @ half, level @ half.T


def vertical_sigma_px(calibration: StereoCalibration, depth_m: float, *, columns: int = 16, rows: int = 12) -> Floats:
    """How far off, vertically, matching points may lie after rectification, for the calibration's own uncertainty.

    First order, ``sqrt(diag(J C Jᵀ))`` with `C` the calibration's covariance and `J` central differences of the
    vertical disparity of a point that both cameras see without error.

    Parameters
    ----------
    calibration : StereoCalibration
    depth_m : float
        Depth of the points, metres.
    columns, rows : int
        Of the grid over the left image.

    Returns
    -------
    (rows, columns) float64
        Pixels, at the centres of the cells; NaN where the right camera does not see the point, and everywhere if
        the covariance is not known.
    """
    width, height = calibration.image_size
    x = (np.arange(columns) + 0.5) * width / columns - 0.5
    y = (np.arange(rows) + 0.5) * height / rows - 0.5
    left_px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    result = np.full(len(left_px), np.nan)
    names = list(calibration.sigma)
    if calibration.covariance is None or not names:
        return result.reshape(rows, columns)
    covariance = np.asarray(calibration.covariance, np.float64)
    sigma = np.sqrt(np.clip(np.diag(covariance), 0.0, None))
    rig = Rig.of(calibration)
    right_px = rig.right_from_left_px(left_px, depth_m)
    seen = ((right_px > -0.5) & (right_px < (width - 0.5, height - 0.5))).all(axis=1)
    left_px, right_px = left_px[seen], right_px[seen]
    slopes = np.zeros((len(left_px), len(names)))
    for i, name in enumerate(names):
        step = _STEP_SIGMAS * sigma[i]
        if step > 0:
            ends = [rig.varied(name, sign * step).vertical_px(left_px, right_px) for sign in (1, -1)]
            slopes[:, i] = (ends[0] - ends[1]) / (2 * step)
    result[seen] = np.sqrt(np.clip(np.einsum("ni,ij,nj->n", slopes, covariance, slopes), 0.0, None))
    return result.reshape(rows, columns)


def _varied_camera(camera: CameraModel, name: str, amount: float) -> CameraModel:
    matrix, distortion = np.array(camera.camera_matrix), np.array(camera.distortion)
    if name in _INTRINSICS:
        matrix[((0, 0), (1, 1), (0, 2), (1, 2))[_INTRINSICS.index(name)]] += amount
    else:
        names = {"kannala-brandt": _FISHEYE, "tsai": ("kappa1",)}.get(camera.lens, _DISTORTION)
        distortion[names.index(name)] += amount
    return CameraModel(matrix, distortion, width=camera.width, height=camera.height, lens=camera.lens)


def _rays(camera: CameraModel, pixels: Floats) -> Floats:
    """(N, 3) directions with z = 1."""
    matrix = camera.camera_matrix
    ideal = np.asarray(camera.undistort(pixels), np.float64)
    x = (ideal[:, 0] - matrix[0, 2]) / matrix[0, 0]
    y = (ideal[:, 1] - matrix[1, 2]) / matrix[1, 1]
    return np.stack([x, y, np.ones(len(ideal))], axis=1)


def _rotation(vector: Floats) -> Floats:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.asarray(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross, np.float64)


def _rotation_vector(rotation: Floats) -> Floats:
    """Its inverse, for turns well below half a circle."""
    odd = np.array([rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]])
    sine = float(np.linalg.norm(odd)) / 2
    angle = math.atan2(sine, (float(np.trace(rotation)) - 1) / 2)
    return odd / 2 if sine < 1e-12 else odd / (2 * sine) * angle
