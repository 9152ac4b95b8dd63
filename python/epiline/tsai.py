"""Tsai's calibration of one camera (1987), coplanar or not, as the paper and Willson's code name things.

World coordinates are millimetres, right-handed; image x runs right, y down. With ``(xc, yc, zc) = R @ world + T``::

    Xu = f xc / zc                Yu = f yc / zc                undistorted, mm on the sensor
    Xu = Xd (1 + kappa1 r**2)     Yu = Yd (1 + kappa1 r**2)     r**2 = Xd**2 + Yd**2
    Xf = sx Xd / dpx + Cx         Yf = Yd / dpy + Cy            pixels
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from epiline._core import CameraModel, Error, brown_from_tsai, tsai_calibrate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from epiline._typing import Floats

__all__ = ["Calibration", "Sensor", "calibrate", "from_opencv"]

# Beyond this a lens is not described by kappa1.
_LARGEST_MISFIT_PX = 1.0


@dataclass(frozen=True)
class Sensor:
    """What the data sheet says of a sensor and its frame grabber.

    Parameters
    ----------
    ncx : float
        Sensor elements per row.
    nfx : float
        Pixels per row of the image; equal to `ncx` for a digital camera.
    dx_mm, dy_mm : float
        Pitch of the sensor elements, millimetres. Only f and kappa1 depend on them.
    cx, cy : float
        Principal point, pixels; the image centre if nothing better is known.
    sx : float
        Horizontal scale factor; 1 for a digital camera.
    """

    ncx: float
    nfx: float
    dx_mm: float
    dy_mm: float
    cx: float
    cy: float
    sx: float = 1.0

    @property
    def dpx_mm(self) -> float:
        """Effective width of an image pixel, mm."""
        return self.dx_mm * self.ncx / self.nfx

    @property
    def dpy_mm(self) -> float:
        """Effective height of an image pixel, mm."""
        return self.dy_mm


@dataclass(frozen=True)
class Calibration:
    """A camera in Tsai's model: mm, pixels and radians, ``R = Rz @ Ry @ Rx``."""

    f: float
    kappa1: float
    Cx: float
    Cy: float
    sx: float
    Tx: float
    Ty: float
    Tz: float
    Rx: float
    Ry: float
    Rz: float
    sensor: Sensor
    """What was known of the sensor; Cx, Cy and sx above are what the points said of it."""
    R: Floats = field(repr=False, compare=False)
    sse_px2: float
    """Sum of squared distances between the points and their prediction, px²."""
    condition: float
    """Condition number of the column-scaled system of stage 1; a few for a good set of points."""
    coplanar: bool
    """Whether the points were taken as coplanar; sx is then the sensor's."""
    skew_rad: float
    """How far the image's axes are from a right angle, as stage 1 sees it; NaN of coplanar points. Not in the model."""
    sigma: dict[str, float] = field(repr=False)
    """Standard deviations by parameter name after a full optimisation (zero: held fixed); else empty."""

    @property
    def T(self) -> Floats:
        """(3,) float64: Tx, Ty, Tz."""
        return np.array([self.Tx, self.Ty, self.Tz])

    @property
    def pixel_size_mm(self) -> tuple[float, float]:
        """Width and height of a pixel on the sensor, sx applied."""
        return self.sensor.dpx_mm / self.sx, self.sensor.dpy_mm

    def camera_model(self, image_size: tuple[int, int], *, lens: Literal["tsai", "brown-conrady"]) -> CameraModel:
        """The camera in pixels: with Tsai's lens exactly, or with OpenCV's k1, k2, k3 that come nearest.

        ``p_camera = R @ p_world + T`` holds for both, in millimetres.

        Parameters
        ----------
        image_size : (width, height)
            Pixels: out to its farthest corner the two lenses agree in the sense of least squares.
        lens : {"tsai", "brown-conrady"}

        Raises
        ------
        epiline.Error
            The lens folds over inside the picture.
        """
        width_mm, height_mm = self.pixel_size_mm
        matrix = np.array([[self.f / width_mm, 0, self.Cx], [0, self.f / height_mm, self.Cy], [0, 0, 1]])
        kappa1 = self.kappa1 * self.f**2
        distortion = [kappa1]
        if lens == "brown-conrady":
            k1, k2, k3 = brown_from_tsai(kappa1, _largest_radius(matrix, image_size))
            distortion = [k1, k2, 0.0, 0.0, k3]
        return CameraModel(matrix, distortion, width=image_size[0], height=image_size[1], lens=lens)


def from_opencv(camera: CameraModel, *, sensor: Sensor) -> tuple[float, float, float, float, float]:
    """Tsai's f, kappa1, Cx, Cy, sx of a camera in OpenCV's model.

    Parameters
    ----------
    camera : CameraModel
        Brown–Conrady, without tangential distortion.
    sensor : Sensor
        Its pitch; principal point and sx come from the camera.

    Returns
    -------
    f, kappa1, Cx, Cy, sx : float
        mm, 1/mm², pixels, pixels, 1. kappa1 is the least-squares one over the picture.

    Raises
    ------
    ValueError
        Another lens, or one with tangential distortion.
    epiline.Error
        One coefficient is off by more than a pixel somewhere in the picture.
    """
    if camera.lens != "brown-conrady" or np.any(camera.distortion[2:4]):
        raise ValueError(f"lens = {camera.lens!r}: expected brown-conrady with p1 = p2 = 0")
    matrix = camera.camera_matrix
    fx, fy = float(matrix[0, 0]), float(matrix[1, 1])
    distorted = np.linspace(0.0, _largest_radius(matrix, (camera.width, camera.height)), 65)[1:]
    ideal = camera.undistort(np.column_stack([matrix[0, 2] + fx * distorted, np.full(64, matrix[1, 2])]))
    undistorted = (ideal[:, 0] - matrix[0, 2]) / fx
    # u = d + kappa1 d³ is linear in kappa1.
    cubes = distorted**3
    kappa1 = float(cubes @ (undistorted - distorted) / (cubes @ cubes))
    off_px = fy * float(np.abs(undistorted - distorted - kappa1 * cubes).max())
    if not off_px <= _LARGEST_MISFIT_PX:
        raise Error(f"Tsai calibration: kappa1 alone misses this lens by {off_px:.1f} px at the picture's border")
    f = fy * sensor.dpy_mm
    return f, kappa1 / f**2, float(matrix[0, 2]), float(matrix[1, 2]), fx / fy * sensor.dpx_mm / sensor.dpy_mm


def _largest_radius(matrix: Floats, image_size: tuple[int, int]) -> float:
    """Distance of the farthest corner of the picture from the principal point, in focal lengths."""
    farthest = [max(matrix[i, 2], image_size[i] - 1 - matrix[i, 2]) / matrix[i, i] for i in (0, 1)]
    return float(np.hypot(*farthest))


def calibrate(
    world_mm: ArrayLike,
    pixels: ArrayLike,
    *,
    sensor: Sensor,
    full: bool = True,
    start: Calibration | None = None,
) -> Calibration:
    """Calibrates one camera from points whose world position is known.

    Parameters
    ----------
    world_mm : (N, 3) array_like
        World points, millimetres; at least 5 in a plane or 7 in space, and 11 for `full`.
    pixels : (N, 2) array_like
        Where the camera saw them.
    sensor : Sensor
        What is known of the sensor.
    full : bool
        After the two stages, minimise the squared pixel distances over f, kappa1, R, T, over Cx and Cy unless f would
        become uncertain by more than 10 % with them, and over sx unless the points are coplanar.
    start : Calibration, optional
        Camera to start the full optimisation from, instead of the two stages: within 20 % in every parameter is near
        enough. Its Cx, Cy and sx count, not the sensor's.

    Returns
    -------
    Calibration

    Raises
    ------
    ValueError
        Numbers that are not finite, lists of different length, too few points.
    epiline.Error
        The points do not determine the camera: a plane parallel to the image, points on a line, a left-handed world.

    Notes
    -----
    R. Y. Tsai, "A versatile camera calibration technique for high-accuracy 3D machine vision metrology using
    off-the-shelf TV cameras and lenses", IEEE J. Robotics and Automation RA-3(4), 1987. A world origin that makes
    the first stage ill-conditioned (Ty near zero) is moved and moved back.
    """
    if start is not None and not full:
        raise ValueError("start: is of a full optimisation only; leave it out, or full=False")
    first = None
    if start is not None:
        first = [start.f, start.kappa1, start.Tx, start.Ty, start.Tz, start.Rx, start.Ry, start.Rz]
    found = tsai_calibrate(
        world_mm,
        pixels,
        cx=sensor.cx if start is None else start.Cx,
        cy=sensor.cy if start is None else start.Cy,
        sx=sensor.sx if start is None else start.sx,
        dpx_mm=sensor.dpx_mm,
        dpy_mm=sensor.dpy_mm,
        full=full,
        start=first,
    )
    return Calibration(sensor=sensor, **found)
