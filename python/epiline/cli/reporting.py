"""From results to report pages: which sections, and what stands at their head."""

from __future__ import annotations

import platform
import sys
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from epiline._core import RangeCurve, StereoCalibration, __version__, simd_level
from epiline.report import (
    CalibrationSection,
    FrameRecorder,
    Provenance,
    RangeCurveSection,
    RejectedView,
    RunReport,
    TruthRow,
    write_report,
)

if TYPE_CHECKING:
    from epiline.targets import Observations
    from epiline.verdict import Verdict


def provenance() -> Provenance:
    """What was run, when and where."""
    return Provenance(
        command=" ".join(["epiline", *sys.argv[1:]]),
        started=datetime.now(),
        version=__version__,
        simd_level=simd_level(),
        machine=f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
    )


def calibration_section(
    calibration: StereoCalibration,
    observations: Observations,
    verdict: Verdict,
    truth: tuple[TruthRow, ...] = (),
) -> CalibrationSection:
    """The calibration with its views, coverage and verdict."""
    board = observations.board
    return CalibrationSection(
        calibration=calibration,
        board=f"{board.columns}x{board.rows} inner corners, {1e3 * board.square_m:g} mm",
        view_names=[str(view.name_left) for view in observations.views if view.accepted],
        left_px=observations.left_px,
        right_px=observations.right_px,
        rejected=[RejectedView(name=f"{v.name_left} / {v.name_right}", reason=v.reason) for v in observations.rejected],
        truth=truth,
        verdict=verdict,
    )


def write_calibration_report(
    path: Path, calibration: StereoCalibration, observations: Observations, verdict: Verdict
) -> None:
    """A page about a calibration."""
    section = calibration_section(calibration, observations, verdict)
    write_report(RunReport(title="Calibration", provenance=provenance(), calibration=section), path)


def write_run_report(path: Path, frames: FrameRecorder, rig: object, parameters: Mapping[str, object]) -> None:
    """A page about a run, with its rig if that is one that can be calibrated."""
    section = CalibrationSection(calibration=rig) if isinstance(rig, StereoCalibration) else None
    report = RunReport(
        title="Run",
        provenance=provenance(),
        calibration=section,
        frames=frames.frames,
        summaries=frames.summaries,
        thumbnails=frames.thumbnails,
        parameters=parameters,
    )
    write_report(report, path)


def write_curve_report(
    path: Path, curve: RangeCurve, disparity_px: NDArray[np.float64], distance_m: NDArray[np.float64]
) -> None:
    """A page about a fitted range curve."""
    section = RangeCurveSection(curve=curve, disparity_px=disparity_px, distance_m=distance_m)
    write_report(RunReport(title="Range curve", provenance=provenance(), range_curve=section), path)
