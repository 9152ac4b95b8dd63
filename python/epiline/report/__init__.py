"""The HTML report: one self-contained page with the figures of a calibration, a run, or a fitted range curve.

Build a `RunReport` from results (a `FrameRecorder` thins a long run), then `write_report` it.
"""

from epiline.report.model import (
    BoardPose,
    CalibrationErrors,
    CalibrationSection,
    FrameSection,
    FrameSummary,
    FrameTruth,
    Provenance,
    RangeCurveSection,
    RawPair,
    RejectedView,
    RunReport,
    Thumbnail,
    TruthRow,
    UncertaintyMap,
)
from epiline.report.profile_pictures import write_profile
from epiline.report.recorder import FrameRecorder
from epiline.report.render import render_html, write_report

__all__ = [
    "BoardPose",
    "CalibrationErrors",
    "CalibrationSection",
    "FrameRecorder",
    "FrameSection",
    "FrameSummary",
    "FrameTruth",
    "Provenance",
    "RangeCurveSection",
    "RawPair",
    "RejectedView",
    "RunReport",
    "Thumbnail",
    "TruthRow",
    "UncertaintyMap",
    "render_html",
    "write_profile",
    "write_report",
]
