"""The two verbs of the public interface that combine classes of the core."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

from epiline._core import DisparityMap, Error, StereoCalibration, StereoMatcher, calibrate_points

if TYPE_CHECKING:
    from epiline._typing import Image
    from epiline.targets import Observations

# A fit this poor is looked at for a mistake in how the photographs were handled.
_SUSPICIOUS_RMS_PX = 2.0


def calibrate(
    observations: Observations,
    *,
    method: Literal["bundle", "tsai"] = "bundle",
    model: Literal["brown4", "brown5"] = "brown4",
    loss: Literal["huber", "squared"] = "huber",
    held_out: bool = True,
) -> StereoCalibration:
    """Calibrates both cameras and the pose between them from a board's corners.

    Parameters
    ----------
    observations : Observations
        What :func:`epiline.find_boards` found.
    method : {"bundle", "tsai"}
        Bundle adjustment of both cameras and all boards together, or Tsai's two-stage method (1987).
    model : {"brown4", "brown5"}
        Brown–Conrady distortion: k1 k2 p1 p2, or with k3.
    loss : {"huber", "squared"}
        Huber's loss forgives a mis-found corner; the squared loss is what other systems minimise.
    held_out : bool
        Also fit parts of the views and measure the rest: fills ``epipolar_error_px``.

    Returns
    -------
    StereoCalibration

    Raises
    ------
    ValueError
        Fewer views or corners than the method needs.
    epiline.Error
        The views do not determine the cameras, with the reason: swapped, mirrored or upside-down photographs are
        recognised by the rig that comes out with the mistake undone.

    Notes
    -----
    Corners that only one camera saw (``observations.single_views``) do not take part yet.
    """
    try:
        calibration = calibrate_points(
            observations.left_px,
            observations.right_px,
            observations.board_m,
            observations.image_size,
            method=method,
            model=model,
            loss=loss,
            held_out=held_out,
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
