"""The two verbs of the public interface that combine classes of the core."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

from epiline._core import DisparityMap, Error, StereoCalibration, StereoMatcher, calibrate_points

if TYPE_CHECKING:
    from epiline._typing import Image
    from epiline.targets import Observations
    from epiline.targets.screening import LensModel

# A fit this poor is looked at for a mistake in how the photographs were handled.
_SUSPICIOUS_RMS_PX = 2.0


def calibrate(
    observations: Observations,
    *,
    method: Literal["bundle", "tsai"] = "bundle",
    model: LensModel = "brown4",
    loss: Literal["huber", "squared"] = "huber",
    held_out: bool | int = True,
    fix: Sequence[str] = (),
    share: Sequence[str] = (),
    square_pixels: bool = False,
    warp: bool = False,
    initial: StereoCalibration | None = None,
) -> StereoCalibration:
    """Calibrates both cameras and the pose between them from a board's corners.

    Views and corners that only one camera saw inform that camera. ``views`` and ``outliers`` of the result count
    ``observations.calibration_views``: the accepted pairs first.

    Parameters
    ----------
    observations : Observations
        What :func:`epiline.find_boards` found.
    method : {"bundle", "tsai"}
        Bundle adjustment of both cameras and all boards together, or Tsai's two-stage method (1987).
    model : {"brown4", "brown5", "rational", "thin-prism", "fisheye", "auto"}
        Lens: Brown–Conrady's k1 k2 p1 p2; with k3; with k4 k5 k6, for 80 degrees and more; with s1 s2 s3 s4; Kannala
        and Brandt's k1 k2 k3 k4. "auto" takes the simplest whose held-out error is within 5 % of the smallest.
    loss : {"huber", "squared"}
        Huber's loss forgives corners a little off and leaves out, in ``outliers``, those beyond 4.5 sigma; the squared
        loss is what other systems minimise.
    held_out : bool or int
        Into how many parts the views are divided, each measured by a fit of the others: fills ``epipolar_error_px``.
        True stands for 2, False for none.
    fix : sequence of str
        Parameters to hold, by their names in ``sigma``; without ``left_`` or ``right_`` of both cameras; "lens" for all
        coefficients. They keep the value of `initial`, or else the image centre and no distortion.
    share : sequence of str
        Parameters that are the same in both cameras, such as "fx" or "lens".
    square_pixels : bool
        One focal length for x and y in each camera.
    warp : bool
        Also solve for the board's bend, two parabolas along its sides: fills ``board_warp_m``.
    initial : StereoCalibration, optional
        Where to start, and what fixed parameters are.

    Returns
    -------
    StereoCalibration

    Raises
    ------
    ValueError
        Fewer views or corners than the method needs, or a parameter that the model does not have.
    epiline.Error
        The views do not determine the cameras, with the reason: swapped, mirrored or upside-down photographs are
        recognised by the rig that comes out with the mistake undone.
    """
    views, points_m = observations.calibration_views, observations.board.points_m
    try:
        calibration = calibrate_points(
            [view.left_px for view in views],
            [view.right_px for view in views],
            [points_m[view.ids] for view in views],
            observations.image_size,
            method=method,
            model=model,
            loss=loss,
            held_out=held_out,
            fix=list(fix),
            share=list(share),
            square_pixels=square_pixels,
            warp=warp,
            initial=initial,
        )
    except Error as error:
        if cause := _mistake(observations, float("inf")):
            raise Error(cause) from error
        raise
    if calibration.rms_px > _SUSPICIOUS_RMS_PX and (cause := _mistake(observations, calibration.rms_px)):
        raise Error(cause)
    return calibration


def _mistake(observations: Observations, rms_px: float) -> str:
    from epiline.targets.mistakes import explain

    return explain(observations, rms_px)


def match(left: Image, right: Image, **parameters: Any) -> DisparityMap:
    """Disparity of an aligned pair, left image as reference.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        Rectified images; three channels are blue, green, red.
    **parameters
        Of :class:`epiline.StereoMatcher`, `regions` among them. For a stream make one matcher and call it: it keeps its
        buffers.

    Returns
    -------
    DisparityMap

    Raises
    ------
    ValueError
        The images differ in size or type, or a parameter is outside its range.

    Notes
    -----
    Sum of absolute differences, equation 5 of the 2011 paper, unless `method` or `preset` says otherwise.
    """
    return StereoMatcher(**parameters)(left, right)
