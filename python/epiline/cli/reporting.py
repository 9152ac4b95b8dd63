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
    BoardPose,
    CalibrationErrors,
    CalibrationSection,
    FrameRecorder,
    Provenance,
    RangeCurveSection,
    RejectedView,
    RunReport,
    TruthRow,
    UncertaintyMap,
    write_report,
)

if TYPE_CHECKING:
    from epiline.targets import Observations
    from epiline.verdict import Verdict
    from epiline.verdict.residuals import ViewErrors


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
    from epiline.verdict.residuals import view_errors

    board = observations.board
    errors = view_errors(calibration, observations)
    return CalibrationSection(
        calibration=calibration,
        board=board.description,
        view_names=[view.name for view in observations.calibration_views],
        left_px=observations.left_px,
        right_px=observations.right_px,
        rejected=[RejectedView(name=v.name, reason=v.reason) for v in observations.rejected],
        truth=truth,
        verdict=verdict,
        errors=_all_errors(errors) if errors else None,
        poses=_poses(calibration, observations),
        uncertainty=_uncertainty(calibration),
    )


def _all_errors(views: list[ViewErrors]) -> CalibrationErrors:
    return CalibrationErrors(
        left_off_px=np.concatenate([view.left_off_px for view in views]),
        right_off_px=np.concatenate([view.right_off_px for view in views]),
        vertical_px=np.concatenate([view.vertical_px for view in views]),
        raw_vertical_px=np.concatenate([view.raw_vertical_px for view in views]),
        row_px=np.concatenate([view.left_px[:, 1] for view in views]),
    )


def _poses(calibration: StereoCalibration, observations: Observations) -> list[BoardPose]:
    """The outline of the board's corners in each view."""
    low, high = observations.board.points_m.min(axis=0), observations.board.points_m.max(axis=0)
    outline_m = np.array([(low[0], low[1], 0), (high[0], low[1], 0), (high[0], high[1], 0), (low[0], high[1], 0)])
    names = [view.name_left for view in observations.accepted]
    return [
        BoardPose(name=name, outline_m=outline_m @ view.rotation.T + view.translation_m)
        for name, view in zip(names, calibration.views, strict=False)
    ]


def _uncertainty(calibration: StereoCalibration) -> list[UncertaintyMap]:
    """At the boards' usual distance and ten times it."""
    from epiline.verdict import vertical_sigma_px

    if not calibration.views:
        return []
    distance_m = float(np.median([np.linalg.norm(view.translation_m) for view in calibration.views]))
    return [
        UncertaintyMap(depth_m=depth_m, sigma_px=vertical_sigma_px(calibration, depth_m))
        for depth_m in (distance_m, 10 * distance_m)
    ]


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
