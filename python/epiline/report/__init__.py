"""The HTML report: one self-contained page with the figures of a calibration, a run, or a fitted range curve.

Build a `RunReport` from results (a `FrameRecorder` thins a long run), then `write_report` it.
"""

from epiline.report.model import (
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
)
from epiline.report.recorder import FrameRecorder
from epiline.report.render import render_html, write_report

__all__ = [
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
    "render_html",
    "write_report",
]
