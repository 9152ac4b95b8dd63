"""From two cameras to obstacle ranges, live, on a CPU.

The path of the data, and where each step is documented::

    find_boards -> calibrate -> Rectifier -> match -> to_range -> profile, find_obstacles
                                 `------------- Pipeline.process -------------'

Importing epiline loads NumPy and the compiled core; OpenCV and the rest load where boards, files or pages are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from epiline._align import align
from epiline._core import (
    AlignmentError,
    CameraModel,
    CameraOverGround,
    Detection,
    DisparityMap,
    Drift,
    Error,
    FrameResult,
    GaussianLowPass,
    GroundEstimator,
    GroundPlane,
    Mounting,
    Obstacle,
    Outlier,
    PairAlignment,
    Pipeline,
    RangeCurve,
    RangeImage,
    RectifiedGeometry,
    RectifiedPair,
    Rectifier,
    Region,
    RegionProfile,
    RobotFromCamera,
    Scan,
    Scanner,
    Slab,
    StereoCalibration,
    StereoMatcher,
    Track,
    Tracker,
    ViewResidual,
    __version__,
    alignment_error,
    calibrate_points,
    equalize,
    find_obstacles,
    fit_range_curve,
    gaussian_low_pass,
    grey,
    measure_drift,
    paper_regions,
    profile,
    realign,
    scan,
    simd_level,
    to_range,
    useful_depth_m,
    xsobel,
)
from epiline._operations import calibrate, match
from epiline.targets.boards import Charuco, Chessboard

if TYPE_CHECKING:
    from epiline import tsai
    from epiline._regions import RegionSet, read_region_sets, read_regions
    from epiline.evaluation import Evaluation, evaluate
    from epiline.report import write_profile
    from epiline.sources import open_source
    from epiline.targets import Observations, find_boards

__all__ = [
    "AlignmentError",
    "CameraModel",
    "CameraOverGround",
    "Charuco",
    "Chessboard",
    "Detection",
    "DisparityMap",
    "Drift",
    "Error",
    "Evaluation",
    "FrameResult",
    "GaussianLowPass",
    "GroundEstimator",
    "GroundPlane",
    "Mounting",
    "Observations",
    "Obstacle",
    "Outlier",
    "PairAlignment",
    "Pipeline",
    "RangeCurve",
    "RangeImage",
    "RectifiedGeometry",
    "RectifiedPair",
    "Rectifier",
    "Region",
    "RegionProfile",
    "RegionSet",
    "RobotFromCamera",
    "Scan",
    "Scanner",
    "Slab",
    "StereoCalibration",
    "StereoMatcher",
    "Track",
    "Tracker",
    "ViewResidual",
    "__version__",
    "align",
    "alignment_error",
    "calibrate",
    "calibrate_points",
    "equalize",
    "evaluate",
    "find_boards",
    "find_obstacles",
    "fit_range_curve",
    "gaussian_low_pass",
    "grey",
    "match",
    "measure_drift",
    "open_source",
    "paper_regions",
    "profile",
    "read_region_sets",
    "read_regions",
    "realign",
    "scan",
    "simd_level",
    "to_range",
    "tsai",
    "useful_depth_m",
    "write_profile",
    "xsobel",
]

_LOADED_ON_USE = {
    "Evaluation": "epiline.evaluation",
    "Observations": "epiline.targets",
    "evaluate": "epiline.evaluation",
    "find_boards": "epiline.targets",
    "open_source": "epiline.sources",
    "RegionSet": "epiline._regions",
    "read_region_sets": "epiline._regions",
    "read_regions": "epiline._regions",
    "write_profile": "epiline.report",
}


def __getattr__(name: str) -> Any:
    """Loads what needs more than NumPy when it is first asked for."""
    import importlib

    if name == "tsai":
        return importlib.import_module("epiline.tsai")
    if name in _LOADED_ON_USE:
        return getattr(importlib.import_module(_LOADED_ON_USE[name]), name)
    raise AttributeError(f"module 'epiline' has no attribute '{name}'")


def __dir__() -> list[str]:
    return sorted(__all__)
