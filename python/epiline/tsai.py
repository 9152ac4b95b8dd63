"""Tsai's calibration of one camera (1987), coplanar or not, as the paper and Willson's code name things.

World coordinates are millimetres, right-handed; image x runs right, y down. With ``(xc, yc, zc) = R @ world + T``::

    Xu = f xc / zc                Yu = f yc / zc                undistorted, mm on the sensor
    Xu = Xd (1 + kappa1 r**2)     Yu = Yd (1 + kappa1 r**2)     r**2 = Xd**2 + Yd**2
    Xf = sx Xd / dpx + Cx         Yf = Yd / dpy + Cy            pixels
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from epiline._core import tsai_calibrate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from epiline._typing import Floats

__all__ = ["Calibration", "Sensor", "calibrate"]


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
    R: Floats = field(repr=False, compare=False)
    sse_px2: float
    """Sum of squared distances between the points and their prediction, px²."""
    condition: float
    """Condition number of the column-scaled system of stage 1; a few for a good set of points."""
    coplanar: bool
    """Whether the points were taken as coplanar; sx is then the sensor's."""
    sigma: dict[str, float] = field(repr=False)
    """Standard deviations by parameter name after a full optimisation (zero: held fixed); else empty."""

    @property
    def T(self) -> Floats:
        """(3,) float64: Tx, Ty, Tz."""
        return np.array([self.Tx, self.Ty, self.Tz])


def calibrate(world_mm: ArrayLike, pixels: ArrayLike, *, sensor: Sensor, full: bool = True) -> Calibration:
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
    found = tsai_calibrate(
        world_mm,
        pixels,
        cx=sensor.cx,
        cy=sensor.cy,
        sx=sensor.sx,
        dpx_mm=sensor.dpx_mm,
        dpy_mm=sensor.dpy_mm,
        full=full,
    )
    return Calibration(**found)
