"""The compiled core of epiline. Arrays in, arrays out; the GIL is released while it works.

Images are `(H, W)` or `(H, W, 3)` uint8; three channels are blue, green, red, as OpenCV reads them.
"""

from collections.abc import Sequence
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from epiline._typing import Floats, Image, Path

__all__ = [
    "AlignmentError",
    "CameraModel",
    "CameraOverGround",
    "Detection",
    "DisparityMap",
    "Drift",
    "Error",
    "FrameResult",
    "GaussianLowPass",
    "GroundEstimator",
    "GroundPlane",
    "Mounting",
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
    "align_candidates",
    "alignment_error",
    "assignment",
    "brown_from_tsai",
    "calibrate_points",
    "default_disparities",
    "equalize",
    "find_obstacles",
    "fit_range_curve",
    "gaussian_low_pass",
    "grey",
    "measure_drift",
    "paper_regions",
    "profile",
    "realign",
    "scan",
    "simd_level",
    "to_range",
    "tsai_calibrate",
    "useful_depth_m",
    "xsobel",
]

__version__: str

class Error(Exception):
    """The data do not determine an answer, or a file's content is not what its format demands."""

def simd_level() -> Literal["avx512", "avx2", "neon", "scalar"]: ...

# ---- preprocess --------------------------------------------------------------------------------

def grey(image: Image) -> Image: ...
def equalize(image: Image) -> Image: ...
def xsobel(image: Image, *, cap: int = 31) -> Image: ...
def gaussian_low_pass(
    image: NDArray[np.float32], *, sigma: float, method: Literal["auto", "frequency"] = "auto"
) -> NDArray[np.float32]: ...

@final
class GaussianLowPass:
    """The filter of gaussian_low_pass for many images of one size: weights and buffers are kept."""

    def __new__(
        cls, width: int, height: int, *, sigma: float, method: Literal["auto", "frequency"] = "auto"
    ) -> GaussianLowPass: ...
    def __call__(
        self, image: NDArray[np.float32], *, out: NDArray[np.float32] | None = None
    ) -> NDArray[np.float32]: ...
    @property
    def is_spatial(self) -> bool: ...

# ---- camera ------------------------------------------------------------------------------------

@final
class CameraModel:
    def __new__(
        cls,
        camera_matrix: ArrayLike,
        distortion: ArrayLike,
        *,
        width: int,
        height: int,
        lens: Literal["brown-conrady", "rational", "thin-prism", "kannala-brandt", "tsai"] | None = None,
    ) -> CameraModel: ...
    @property
    def camera_matrix(self) -> Floats: ...
    @property
    def distortion(self) -> Floats: ...
    @property
    def lens(self) -> Literal["brown-conrady", "rational", "thin-prism", "kannala-brandt", "tsai"]: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    def project(self, points_m: ArrayLike) -> Floats: ...
    def directions(self, pixels: ArrayLike) -> Floats: ...
    def undistort(self, pixels: ArrayLike) -> Floats: ...

@final
class ViewResidual:
    @property
    def left_rms_px(self) -> float: ...
    @property
    def right_rms_px(self) -> float: ...
    @property
    def rotation(self) -> Floats: ...
    @property
    def translation_m(self) -> Floats: ...

@final
class Outlier:
    @property
    def view(self) -> int: ...
    @property
    def side(self) -> Literal["left", "right"]: ...
    @property
    def corner(self) -> int: ...
    @property
    def residual_px(self) -> float: ...
    @property
    def reason(self) -> str: ...

@final
class StereoCalibration:
    def __new__(
        cls, left: CameraModel, right: CameraModel, rotation: ArrayLike, translation_m: ArrayLike
    ) -> StereoCalibration: ...
    @property
    def left(self) -> CameraModel: ...
    @property
    def right(self) -> CameraModel: ...
    @property
    def rotation(self) -> Floats: ...
    @property
    def translation_m(self) -> Floats: ...
    @property
    def baseline_m(self) -> float: ...
    @property
    def image_size(self) -> tuple[int, int]: ...
    @property
    def rms_px(self) -> float: ...
    @property
    def epipolar_error_px(self) -> float: ...
    @property
    def covariance(self) -> Floats | None: ...
    @property
    def sigma(self) -> dict[str, float]: ...
    @property
    def views(self) -> list[ViewResidual]: ...
    @property
    def outliers(self) -> list[Outlier]: ...
    @property
    def board_warp_m(self) -> Floats | None: ...
    @property
    def board_warp_sigma_m(self) -> Floats | None: ...
    def range_sigma(self, z_m: float) -> float: ...
    def save(
        self,
        path: Path | tuple[Path, Path],
        *,
        format: Literal["epiline", "opencv", "ros", "kalibr", "mrcal", "middlebury", "kitti", "kitti-grey"]
        | None = None,
    ) -> None: ...
    @staticmethod
    def load(
        path: Path | tuple[Path, Path],
        *,
        format: Literal[
            "epiline",
            "opencv",
            "ros",
            "kalibr",
            "mrcal",
            "boofcv",
            "middlebury",
            "kitti",
            "kitti-grey",
            "kitti-raw",
        ]
        | None = None,
        image_size: tuple[int, int] | None = None,
        unit_m: float = 1.0,
        cameras: tuple[int, int] | None = None,
    ) -> StereoCalibration: ...
    @staticmethod
    def describes_aligned_pictures(path: Path) -> bool: ...

# ---- calibration -------------------------------------------------------------------------------

def calibrate_points(
    left_px: Sequence[ArrayLike],
    right_px: Sequence[ArrayLike],
    board_m: Sequence[ArrayLike],
    image_size: tuple[int, int],
    *,
    method: Literal["bundle", "tsai"] = "bundle",
    model: Literal["brown4", "brown5", "rational", "thin-prism", "fisheye", "auto"] = "brown4",
    loss: Literal["huber", "squared"] = "huber",
    held_out: bool | int = ...,
    fix: Sequence[str] = ...,
    share: Sequence[str] = ...,
    square_pixels: bool = False,
    warp: bool = False,
    initial: StereoCalibration | None = None,
) -> StereoCalibration: ...
def tsai_calibrate(
    world_mm: ArrayLike,
    pixels: ArrayLike,
    *,
    cx: float,
    cy: float,
    sx: float,
    dpx_mm: float,
    dpy_mm: float,
    full: bool,
    start: Sequence[float] | None = None,
) -> dict[str, Any]: ...
def brown_from_tsai(kappa1: float, largest_radius: float) -> tuple[float, float, float]: ...

# ---- rectification -----------------------------------------------------------------------------

@final
class RectifiedGeometry:
    def __new__(
        cls,
        *,
        width: int,
        height: int,
        focal_px: float,
        cx_px: float,
        cy_px: float,
        baseline_m: float,
        doffs_px: float = 0.0,
    ) -> RectifiedGeometry: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def focal_px(self) -> float: ...
    @property
    def cx_px(self) -> float: ...
    @property
    def cy_px(self) -> float: ...
    @property
    def doffs_px(self) -> float: ...
    @property
    def baseline_m(self) -> float: ...
    @property
    def projection(self) -> Literal["pinhole", "cylindrical"]: ...
    @property
    def Q(self) -> Floats: ...
    @property
    def aligned_from_left(self) -> Floats: ...
    def points(self, pixels: ArrayLike) -> Floats: ...
    def depth_m(self, disparity_px: float) -> float: ...
    def disparity_px(self, depth_m: float) -> float: ...

@final
class RectifiedPair:
    @property
    def left(self) -> Image: ...
    @property
    def right(self) -> Image: ...
    @property
    def left_valid(self) -> NDArray[np.bool_]: ...
    @property
    def right_valid(self) -> NDArray[np.bool_]: ...
    @property
    def geometry(self) -> RectifiedGeometry: ...

@final
class Rectifier:
    def __new__(
        cls,
        calibration: StereoCalibration,
        *,
        size: tuple[int, int] | None = None,
        alpha: float | None = None,
        fov_deg: float | None = None,
        focal_px: float | None = None,
        projection: Literal["pinhole", "cylindrical"] = "pinhole",
    ) -> Rectifier: ...
    @property
    def geometry(self) -> RectifiedGeometry: ...
    def __call__(self, left: Image, right: Image) -> RectifiedPair: ...

@final
class Drift:
    @property
    def values(self) -> dict[str, float]: ...
    @property
    def sigma(self) -> dict[str, float]: ...
    @property
    def axis(self) -> Literal["pitch", "yaw", "roll", "zoom"] | None: ...
    @property
    def frames(self) -> int: ...
    @property
    def matches(self) -> int: ...

def measure_drift(
    geometry: RectifiedGeometry,
    residuals: Sequence[AlignmentError],
    *,
    calibration: StereoCalibration | None = None,
    reference: Drift | None = None,
) -> Drift: ...
def realign(calibration: StereoCalibration, drift: Drift) -> StereoCalibration: ...

@final
class PairAlignment:
    @property
    def left(self) -> Image: ...
    @property
    def right(self) -> Image: ...
    @property
    def left_valid(self) -> NDArray[np.bool_]: ...
    @property
    def right_valid(self) -> NDArray[np.bool_]: ...
    @property
    def homographies(self) -> list[Floats]: ...
    @property
    def rotations(self) -> list[Floats]: ...
    @property
    def lens(self) -> list[CameraModel] | None: ...
    @property
    def epipolar_error_px(self) -> float: ...
    @property
    def sigma_px(self) -> float: ...
    @property
    def matches(self) -> int: ...
    @property
    def left_px(self) -> Floats: ...
    @property
    def right_px(self) -> Floats: ...
    @property
    def trusted(self) -> bool: ...
    @property
    def reason(self) -> str: ...

def align_candidates(
    left: Image,
    right: Image,
    left_px: ArrayLike,
    right_px: ArrayLike,
    lens: tuple[CameraModel, CameraModel] | None = None,
) -> PairAlignment: ...

@final
class AlignmentError:
    @property
    def median_px(self) -> float: ...
    @property
    def signed_median_px(self) -> float: ...
    @property
    def spread_px(self) -> float: ...
    @property
    def matches(self) -> int: ...
    @property
    def left_px(self) -> Floats: ...
    @property
    def right_px(self) -> Floats: ...

def alignment_error(
    left: Image,
    right: Image,
    *,
    num_disparities: int = 192,
    max_offset_px: int = 8,
    left_valid: NDArray[np.bool_] | None = None,
    right_valid: NDArray[np.bool_] | None = None,
) -> AlignmentError: ...

# ---- matching ----------------------------------------------------------------------------------

@final
class DisparityMap:
    def __new__(
        cls,
        raw: NDArray[np.uint16],
        validity: NDArray[np.uint8],
        *,
        min_disparity: int = 0,
        num_disparities: int = 64,
    ) -> DisparityMap: ...
    @property
    def values(self) -> NDArray[np.float32]: ...
    @property
    def raw(self) -> NDArray[np.uint16]: ...
    @property
    def validity(self) -> NDArray[np.uint8]: ...
    @property
    def min_disparity(self) -> int: ...
    @property
    def num_disparities(self) -> int: ...
    @property
    def density(self) -> float: ...
    @property
    def confidence(self) -> NDArray[np.float32]: ...
    @property
    def shape(self) -> tuple[int, int]: ...
    def to_opencv(self) -> NDArray[np.int16]: ...

@final
class StereoMatcher:
    def __new__(
        cls,
        *,
        preset: Literal["fast", "balanced", "accurate"] | None = None,
        method: Literal["sad", "sad5", "census", "bt", "sgm"] = "sad",
        num_disparities: int = 64,
        block_size: int = ...,
        min_disparity: int = 0,
        threads: int | None = None,
        prefilter: Literal["xsobel", "none"] | None = ...,
        prefilter_cap: int = ...,
        uniqueness_ratio: int = 0,
        texture_threshold: int = 0,
        left_right_max_diff: int | None = None,
        speckle_size: int = 0,
        speckle_range: int = 2,
        subpixel: bool | Literal["v", "parabola"] = True,
        coarse_weight: int = 0,
        fill: bool = False,
        smooth: bool = False,
        paths: int = 4,
        p1: int = 48,
        p2: int = 127,
        saturation_threshold: int = 0,
        regions: Sequence[Region | tuple[int, int, int, int]] | None = None,
        geometry: RectifiedGeometry | None = None,
    ) -> StereoMatcher: ...
    @property
    def parameters(self) -> dict[str, Any]: ...
    def __call__(
        self,
        left: Image,
        right: Image,
        *,
        left_valid: NDArray[np.bool_] | None = None,
        right_valid: NDArray[np.bool_] | None = None,
        regions: Sequence[Region | tuple[int, int, int, int]] | None = None,
        geometry: RectifiedGeometry | None = None,
        out: DisparityMap | None = None,
    ) -> DisparityMap: ...

# ---- range -------------------------------------------------------------------------------------

@final
class RangeImage:
    @property
    def depth_m(self) -> NDArray[np.float32]: ...
    @property
    def range_m(self) -> NDArray[np.float32]: ...
    @property
    def sigma_m(self) -> NDArray[np.float32]: ...
    @property
    def validity(self) -> NDArray[np.uint8]: ...
    def points(self, color: Image | None = None) -> NDArray[np.float32]: ...

def to_range(
    disparity: DisparityMap,
    geometry: RectifiedGeometry,
    *,
    disparity_sigma_px: float | None = None,
) -> RangeImage: ...
def useful_depth_m(geometry: RectifiedGeometry, share: float, *, disparity_sigma_px: float = 0.25) -> float: ...

@final
class RangeCurve:
    @property
    def a(self) -> float: ...
    @property
    def b(self) -> float: ...
    @property
    def c(self) -> float: ...
    @property
    def d(self) -> float: ...
    @property
    def standard_errors(self) -> Floats: ...
    @property
    def covariance(self) -> Floats: ...
    @property
    def rmse_m(self) -> float: ...
    @property
    def r_squared(self) -> float: ...
    @property
    def span_px(self) -> tuple[float, float]: ...
    @property
    def samples(self) -> int: ...
    @property
    def outliers(self) -> NDArray[np.int64]: ...
    def predict(self, disparity_px: ArrayLike) -> Floats: ...
    def predict_interval(self, disparity_px: ArrayLike, *, confidence: float = 0.95) -> tuple[Floats, Floats]: ...

def fit_range_curve(disparity_px: ArrayLike, distance_m: ArrayLike, *, robust: bool = False) -> RangeCurve: ...

# ---- regions and obstacles ---------------------------------------------------------------------

@final
class CameraOverGround:
    """How the left aligned camera stands over level ground."""

    def __new__(cls, height_m: float, *, pitch_rad: float = 0.0, roll_rad: float = 0.0) -> CameraOverGround: ...
    @property
    def height_m(self) -> float: ...
    @property
    def pitch_rad(self) -> float: ...
    @property
    def roll_rad(self) -> float: ...

@final
class Slab:
    """A part of space ahead of the rig: a layer over the ground between two ranges, of some width or any."""

    def __new__(
        cls,
        *,
        height_m: tuple[float, float],
        range_m: tuple[float, float],
        lateral_m: tuple[float, float] | None = None,
    ) -> Slab: ...
    @property
    def height_m(self) -> tuple[float, float]: ...
    @property
    def range_m(self) -> tuple[float, float]: ...
    @property
    def lateral_m(self) -> tuple[float, float]: ...

@final
class Region:
    def __new__(
        cls,
        name: str,
        *,
        x: int,
        y: int,
        width: int,
        height: int,
        disparities: tuple[int, int] | None = None,
        range_m: tuple[float, float] | None = None,
    ) -> Region: ...
    @staticmethod
    def from_shares(
        name: str, *, x: float, y: float, width: float, height: float, image_size: tuple[int, int]
    ) -> Region: ...
    @staticmethod
    def in_space(name: str, slab: Slab, camera: CameraOverGround, geometry: RectifiedGeometry) -> Region: ...
    @property
    def slab(self) -> Slab | None: ...
    @property
    def camera(self) -> CameraOverGround | None: ...
    @property
    def name(self) -> str: ...
    @property
    def x(self) -> int: ...
    @property
    def y(self) -> int: ...
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def disparities(self) -> tuple[int, int] | None: ...
    @property
    def range_m(self) -> tuple[float, float] | None: ...

def paper_regions(width: int, height: int) -> list[Region]: ...

@final
class RegionProfile:
    """Per column arrays have `region.width` entries; columns without support are NaN."""

    @property
    def region(self) -> Region: ...
    @property
    def nearest_px(self) -> NDArray[np.float32]: ...
    @property
    def median_px(self) -> NDArray[np.float32]: ...
    @property
    def spread_px(self) -> NDArray[np.float32]: ...
    @property
    def minimum_px(self) -> NDArray[np.float32]: ...
    @property
    def maximum_px(self) -> NDArray[np.float32]: ...
    @property
    def count(self) -> NDArray[np.uint32]: ...
    @property
    def unknown(self) -> NDArray[np.uint32]: ...
    @property
    def unknown_share(self) -> NDArray[np.float32]: ...
    @property
    def nearest_range_m(self) -> NDArray[np.float32] | None: ...
    @property
    def histogram(self) -> NDArray[np.uint32]: ...
    @property
    def valid_share(self) -> float: ...
    @property
    def minimum(self) -> float: ...
    @property
    def maximum(self) -> float: ...
    @property
    def total(self) -> float: ...
    @property
    def range_m(self) -> float: ...
    @property
    def sigma_m(self) -> float: ...
    @property
    def nearest_disparity_px(self) -> float: ...
    @property
    def nearest_at(self) -> tuple[int, int] | None: ...
    @property
    def support(self) -> int: ...

def profile(
    disparity: DisparityMap,
    regions: Sequence[Region],
    *,
    geometry: RectifiedGeometry | None = None,
    min_support: int = 3,
    disparity_sigma_px: float = 0.25,
) -> list[RegionProfile]: ...

@final
class Mounting:
    def __new__(
        cls,
        camera_height_m: float,
        *,
        pitch_rad: float = 0.0,
        roll_rad: float = 0.0,
        camera_height_sigma_m: float = 0.05,
        pitch_sigma_rad: float = 0.03,
        roll_sigma_rad: float = 0.02,
    ) -> Mounting: ...

@final
class GroundPlane:
    @property
    def camera_height_m(self) -> float: ...
    @property
    def pitch_rad(self) -> float: ...
    @property
    def roll_rad(self) -> float: ...
    @property
    def camera_height_sigma_m(self) -> float: ...
    @property
    def pitch_sigma_rad(self) -> float: ...
    @property
    def roll_sigma_rad(self) -> float: ...
    @property
    def support_share(self) -> float: ...
    @property
    def camera(self) -> CameraOverGround: ...
    @property
    def profile_m(self) -> Floats: ...
    @property
    def down(self) -> Floats: ...
    def disparity_px(self, x: float, y: float) -> float | None: ...
    def height_m(self, x: float, y: float, disparity_px: float) -> float: ...

@final
class GroundEstimator:
    def __new__(
        cls,
        *,
        camera_height_m: tuple[float, float] = ...,
        pitch_rad: tuple[float, float] = ...,
        max_roll_rad: float = 0.35,
        mounting: Mounting | None = None,
        disparity_sigma_px: float = 0.25,
    ) -> GroundEstimator: ...
    def __call__(self, disparity: DisparityMap, geometry: RectifiedGeometry) -> GroundPlane | None: ...
    @property
    def reason(self) -> str | None: ...
    def reset(self) -> None: ...

@final
class Obstacle:
    @property
    def id(self) -> int: ...
    @property
    def region(self) -> str: ...
    @property
    def regions(self) -> list[str]: ...
    @property
    def box(self) -> tuple[int, int, int, int]: ...
    @property
    def range_m(self) -> float: ...
    @property
    def depth_m(self) -> float: ...
    @property
    def sigma_m(self) -> float: ...
    @property
    def bearing_rad(self) -> float: ...
    @property
    def width_m(self) -> float: ...
    @property
    def height_m(self) -> float: ...
    @property
    def height_above_ground_m(self) -> float | None: ...
    @property
    def support(self) -> int: ...

def find_obstacles(
    disparity: DisparityMap,
    geometry: RectifiedGeometry,
    *,
    regions: Sequence[Region] | None = None,
    method: Literal["u-disparity", "paper"] = "u-disparity",
    low_pass_sigma: float = 3.0,
    brighter_px: float = 1.0,
    ground: GroundPlane | Literal["auto"] | None = "auto",
    max_range_m: float | None = None,
    min_support: int = 8,
    min_height_m: float = 0.3,
    step_m: float = 0.05,
    headroom_m: float = 2.0,
    disparity_sigma_px: float = 0.25,
) -> list[Obstacle]: ...

# ---- tracking ----------------------------------------------------------------------------------

@final
class Detection:
    def __new__(
        cls,
        range_m: float,
        bearing_rad: float,
        sigma_m: float,
        *,
        depth_m: float | None = None,
        width_m: float = 0.0,
        height_m: float = 0.0,
        support: int = 1,
        box: tuple[int, int, int, int] = ...,
    ) -> Detection: ...
    @property
    def range_m(self) -> float: ...
    @property
    def bearing_rad(self) -> float: ...
    @property
    def sigma_m(self) -> float: ...

@final
class Track:
    @property
    def id(self) -> int: ...
    @property
    def position_m(self) -> tuple[float, float]: ...
    @property
    def velocity_mps(self) -> tuple[float, float]: ...
    @property
    def covariance(self) -> NDArray[np.float64]: ...
    @property
    def range_m(self) -> float: ...
    @property
    def sigma_m(self) -> float: ...
    @property
    def bearing_rad(self) -> float: ...
    @property
    def age_s(self) -> float: ...
    @property
    def hits(self) -> int: ...
    @property
    def misses(self) -> int: ...
    @property
    def confirmed(self) -> bool: ...
    @property
    def obstacle(self) -> int | None: ...
    @property
    def box(self) -> tuple[int, int, int, int]: ...
    @property
    def width_m(self) -> float: ...
    @property
    def height_m(self) -> float: ...
    @property
    def surprise(self) -> float: ...

@final
class Tracker:
    def __new__(
        cls,
        *,
        velocity_walk_mps: float = 2.0,
        initial_velocity_mps: float = 5.0,
        bearing_sigma_rad: float = 0.005,
        extent_share: float = 0.1,
        gate_probability: float = 0.99,
        confirm_hits: int = 3,
        confirm_window: int = 5,
        max_misses: int = 5,
        max_gap_s: float = 1.0,
        scene_stands_still: bool = False,
    ) -> Tracker: ...
    def update(
        self,
        obstacles: Sequence[Obstacle | Detection],
        stamp_nanos: int,
        *,
        ego_motion: tuple[float, float, float] | None = None,
    ) -> list[Track]: ...
    @property
    def continuity(self) -> Literal["started", "advanced", "repeated", "backward", "gap"] | None: ...
    def reset(self) -> None: ...

def assignment(costs: NDArray[np.float64], miss_cost: float) -> list[int | None]: ...

# ---- scan --------------------------------------------------------------------------------------

@final
class RobotFromCamera:
    def __new__(
        cls,
        height_m: float,
        *,
        x_m: float = 0.0,
        y_m: float = 0.0,
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        yaw_rad: float = 0.0,
    ) -> RobotFromCamera: ...
    @staticmethod
    def from_matrix(robot_from_camera: ArrayLike) -> RobotFromCamera: ...
    @property
    def robot_from_camera(self) -> NDArray[np.float64]: ...

@final
class Scan:
    @property
    def angle_rad(self) -> NDArray[np.float32]: ...
    @property
    def seen(self) -> NDArray[np.uint8]: ...
    @property
    def nearest_m(self) -> NDArray[np.float32]: ...
    @property
    def sigma_m(self) -> NDArray[np.float32]: ...
    @property
    def free_from_m(self) -> NDArray[np.float32]: ...
    @property
    def free_to_m(self) -> NDArray[np.float32]: ...
    @property
    def origin_m(self) -> tuple[float, float]: ...
    @property
    def max_range_m(self) -> float: ...
    @property
    def blind_m(self) -> float: ...
    def obstacle_points_m(self) -> NDArray[np.float32]: ...
    def to_laser_scan(self, *, range_min_m: float = 0.0) -> dict[str, Any]: ...
    def to_clearing_scan(self) -> dict[str, Any]: ...
    def __len__(self) -> int: ...

@final
class Scanner:
    def __new__(
        cls,
        *,
        min_support: int = 8,
        step_m: float = 0.05,
        headroom_m: float = 2.0,
        max_range_m: float = 10.0,
        gap_guard_px: float = 4.0,
        disparity_sigma_px: float = 0.25,
    ) -> Scanner: ...
    def __call__(
        self,
        disparity: DisparityMap,
        geometry: RectifiedGeometry,
        *,
        ground: GroundPlane | None = None,
        mounting: RobotFromCamera | None = None,
    ) -> Scan: ...

def scan(
    disparity: DisparityMap,
    geometry: RectifiedGeometry,
    *,
    ground: GroundPlane | None = None,
    mounting: RobotFromCamera | None = None,
    min_support: int = 8,
    step_m: float = 0.05,
    headroom_m: float = 2.0,
    max_range_m: float = 10.0,
    gap_guard_px: float = 4.0,
    disparity_sigma_px: float = 0.25,
) -> Scan: ...

# ---- pipeline ----------------------------------------------------------------------------------

def default_disparities(width: int) -> int: ...

@final
class FrameResult:
    @property
    def pair(self) -> RectifiedPair: ...
    @property
    def disparity(self) -> DisparityMap: ...
    @property
    def range(self) -> RangeImage: ...
    @property
    def profiles(self) -> list[RegionProfile]: ...
    @property
    def ground(self) -> GroundPlane | None: ...
    @property
    def ground_reason(self) -> str | None: ...
    @property
    def obstacles(self) -> list[Obstacle]: ...
    @property
    def tracks(self) -> list[Track]: ...
    @property
    def scan(self) -> Scan | None: ...
    @property
    def alignment(self) -> AlignmentError | None: ...
    @property
    def drift(self) -> Drift | None: ...
    @property
    def stage_ms(self) -> dict[str, float]: ...

@final
class Pipeline:
    def __new__(
        cls,
        rig: StereoCalibration | RectifiedGeometry,
        *,
        matcher: StereoMatcher | None = None,
        regions: Sequence[Region] | None = None,
        equalize: bool = False,
        alignment: bool = True,
        disparity_sigma_px: float = 0.25,
        max_range_m: float | None = None,
        min_support: int = 8,
        min_height_m: float = 0.3,
        ground: bool = True,
        mounting: Mounting | None = None,
        step_m: float = 0.05,
        headroom_m: float = 2.0,
        method: Literal["u-disparity", "paper"] = "u-disparity",
        only_regions: bool = False,
        tracker: Tracker | None = None,
        scanner: Scanner | None = None,
        robot_from_camera: RobotFromCamera | None = None,
    ) -> Pipeline: ...
    @property
    def geometry(self) -> RectifiedGeometry: ...
    @property
    def regions(self) -> list[Region]: ...
    @property
    def matcher_parameters(self) -> dict[str, Any]: ...
    def process(self, left: Image, right: Image, *, stamp_nanos: int = 0) -> FrameResult: ...
    def set_drift_reference(self) -> None: ...
    def realign(self) -> StereoCalibration: ...
