"""What a report is made of. Build a `RunReport`; `write_report` turns it into a page.

Every section is optional: a calibration alone, one pair, a run of frames, or a fitted curve make a page each.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime

from epiline.report.protocols import (
    AlignmentLike,
    CalibrationLike,
    DisparityLike,
    Floats,
    FrameResultLike,
    GeometryLike,
    Image,
    ObstacleLike,
    ProfileLike,
    RangeCurveLike,
    ScanLike,
    TrackLike,
    VerdictLike,
)


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """What was run, when and where."""

    command: str
    started: datetime
    version: str
    simd_level: str
    machine: str


@dataclass(frozen=True, kw_only=True)
class RejectedView:
    """A pair of photographs that was not used, and why."""

    name: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class TruthRow:
    """One recovered quantity beside its true value, in the same `unit`."""

    name: str
    recovered: float
    truth: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class CalibrationErrors:
    """What is left of the corners of the views used; one entry per corner, all views together.

    `left_off_px` and `right_off_px` are (N, 2), seen minus predicted, beside the section's corners in their order;
    `vertical_px` and `raw_vertical_px` are (N,) vertical disparities after rectification and as photographed;
    `row_px` (N,) is where in the left photograph.
    """

    left_off_px: Floats
    right_off_px: Floats
    vertical_px: Floats
    raw_vertical_px: Floats
    row_px: Floats


@dataclass(frozen=True, kw_only=True)
class BoardPose:
    """Where a board was: the (4, 3) corners of its outline in the left camera's frame, metres."""

    name: str
    outline_m: Floats


@dataclass(frozen=True, kw_only=True)
class UncertaintyMap:
    """Standard deviation of the vertical disparity over the left picture, (rows, columns), px, for one depth."""

    depth_m: float
    sigma_px: Floats


@dataclass(frozen=True, kw_only=True)
class CalibrationSection:
    """A calibration and what it was made from.

    `view_names`, `left_px` and `right_px` have one entry per view used, in the order of `calibration.views`; the
    points are (N, 2) corner positions in the raw photographs, px. All three may be empty (a rig read from a file).
    """

    calibration: CalibrationLike
    board: str = ""
    view_names: Sequence[str] = ()
    left_px: Sequence[Floats] = ()
    right_px: Sequence[Floats] = ()
    rejected: Sequence[RejectedView] = ()
    truth: Sequence[TruthRow] = ()
    verdict: VerdictLike | None = None
    errors: CalibrationErrors | None = None
    poses: Sequence[BoardPose] = ()
    uncertainty: Sequence[UncertaintyMap] = ()


@dataclass(frozen=True, kw_only=True)
class RawPair:
    """The photographs before rectification, and the vertical residual measured between them, if it was."""

    left: Image
    right: Image
    alignment: AlignmentLike | None = None


@dataclass(frozen=True, kw_only=True)
class FrameTruth:
    """What is known to be true of a frame (rendered scenes, ground truth).

    `column_disparity_px` and `column_range_m` hold, per region name, (region.width,) arrays, NaN where unknown.
    """

    region_range_m: Mapping[str, float] = field(default_factory=dict)
    column_disparity_px: Mapping[str, Floats] = field(default_factory=dict)
    column_range_m: Mapping[str, Floats] = field(default_factory=dict)
    obstacle_range_m: Mapping[int, float] = field(default_factory=dict)
    """True range of what each found obstacle stands for, by obstacle id."""
    missed: Sequence[str] = ()
    """Obstacles that are there and were not found, described."""


@dataclass(frozen=True, kw_only=True)
class FrameSection:
    """Everything about one frame; images are (H, W) or (H, W, 3) uint8 BGR and already aligned."""

    index: int
    name: str
    left: Image
    right: Image
    disparity: DisparityLike
    geometry: GeometryLike | None = None
    profiles: Sequence[ProfileLike] = ()
    obstacles: Sequence[ObstacleLike] = ()
    tracks: Sequence[TrackLike] = ()
    scan: ScanLike | None = None
    alignment: AlignmentLike | None = None
    stage_ms: Mapping[str, float] = field(default_factory=dict)
    """Milliseconds by stage. A `total` entry is the whole frame, not a stage; without one the stages are added."""
    before: RawPair | None = None
    truth: FrameTruth | None = None

    @classmethod
    def from_result(
        cls,
        result: FrameResultLike,
        *,
        index: int,
        name: str,
        before: RawPair | None = None,
        truth: FrameTruth | None = None,
    ) -> "FrameSection":
        """The section of what `Pipeline.process` returned."""
        return cls(
            index=index,
            name=name,
            left=result.pair.left,
            right=result.pair.right,
            disparity=result.disparity,
            geometry=result.pair.geometry,
            profiles=result.profiles,
            obstacles=result.obstacles,
            tracks=result.tracks,
            scan=result.scan,
            alignment=result.alignment,
            stage_ms=result.stage_ms,
            before=before,
            truth=truth,
        )


@dataclass(frozen=True, kw_only=True)
class FrameSummary:
    """The figures of one frame that the tables and the summary need; small, kept for every frame."""

    index: int
    name: str
    region_range_m: Mapping[str, float]
    region_truth_m: Mapping[str, float]
    obstacles: int
    nearest_m: float
    """Range of the nearest obstacle; NaN if there is none."""
    nearest_sigma_m: float
    nearest_region: str
    alignment_px: float
    """Magnitude of the median vertical residual; NaN if not measured."""
    valid_share: float
    stage_ms: Mapping[str, float]
    total_ms: float
    """NaN if no stage was timed."""
    track_range_m: Mapping[int, float] = field(default_factory=dict)
    """Ranges of the confirmed tracks that were seen in this frame, by id."""


@dataclass(frozen=True, kw_only=True)
class Thumbnail:
    """A small picture of a frame, encoded as JPEG."""

    index: int
    jpeg: bytes
    width: int
    height: int


@dataclass(frozen=True, kw_only=True)
class RangeCurveSection:
    """Eq. 6 fitted to measured pairs, and the pairs."""

    curve: RangeCurveLike
    disparity_px: Floats
    distance_m: Floats
    source: str = ""


@dataclass(frozen=True, kw_only=True)
class RunReport:
    """A page. `frames` get their figures, `summaries` a row each; `FrameRecorder` makes both from a long run."""

    title: str
    provenance: Provenance
    subtitle: str = ""
    calibration: CalibrationSection | None = None
    frames: Sequence[FrameSection] = ()
    summaries: Sequence[FrameSummary] = ()
    thumbnails: Sequence[Thumbnail] = ()
    range_curve: RangeCurveSection | None = None
    parameters: Mapping[str, object] = field(default_factory=dict)
    notes: Sequence[str] = ()
