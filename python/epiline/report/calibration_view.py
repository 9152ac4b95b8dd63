"""A calibration, as the template shows it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from epiline.report.calibration_figures import (
    before_after_chart,
    pose_figure,
    residual_figure,
    uncertainty_figure,
    vertical_chart,
)
from epiline.report.charts import column_chart
from epiline.report.figures import coverage_figure
from epiline.report.model import CalibrationSection, RejectedView
from epiline.report.numbers import percent, plus_minus, quantity, relative_error, signed_percent, significant
from epiline.report.protocols import CalibrationLike, CameraLike, Floats, VerdictLike

RANGES_M = (1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, kw_only=True)
class TruthView:
    """A line of the table of recovered against true values."""

    name: str
    recovered: str
    truth: str
    error: str


@dataclass(frozen=True, kw_only=True)
class CalibrationView:
    """Everything the template shows of a calibration."""

    verdict: VerdictLike | None
    facts: Sequence[tuple[str, str]]
    range_sigma: Sequence[tuple[str, str, str]]
    residuals: Markup | None
    coverage: Sequence[tuple[str, Markup]]
    arrows: Sequence[tuple[str, Markup]]
    epipolar: Sequence[tuple[str, Markup]]
    uncertainty: Sequence[tuple[str, Markup]]
    poses: Markup | None
    photograph_next: Sequence[str]
    rejected: Sequence[RejectedView]
    truth: Sequence[TruthView]


def calibration_view(section: CalibrationSection) -> CalibrationView:
    """Draws a calibration."""
    calibration = section.calibration
    return CalibrationView(
        verdict=section.verdict,
        facts=_facts(section),
        range_sigma=_range_sigma(calibration),
        residuals=_residuals(section),
        coverage=_coverage(section),
        arrows=_arrows(section),
        epipolar=_epipolar(section),
        uncertainty=_uncertainty(section),
        poses=_poses(section),
        photograph_next=tuple(getattr(section.verdict, "photograph_next", ())),
        rejected=section.rejected,
        truth=[
            TruthView(
                name=row.name,
                recovered=f"{significant(row.recovered, 6)} {row.unit}".strip(),
                truth=f"{significant(row.truth, 6)} {row.unit}".strip(),
                error=signed_percent(relative_error(row.recovered, row.truth), 3),
            )
            for row in section.truth
        ],
    )


def baseline_sigma_m(calibration: CalibrationLike) -> float:
    """Standard deviation of the baseline, metres; NaN if the covariance is unknown.

    First order: `sqrt(gᵀ C g)` with `g = T / |T|` and `C` the covariance of the translation, which comes last in the
    order of the parameters.
    """
    if calibration.covariance is None:
        return math.nan
    translation_m = np.asarray(calibration.translation_m, np.float64).ravel()
    direction = translation_m / np.linalg.norm(translation_m)
    variance = float(direction @ np.asarray(calibration.covariance, np.float64)[-3:, -3:] @ direction)
    return math.sqrt(variance) if variance > 0.0 else math.nan


def rotation_angle_rad(calibration: CalibrationLike) -> float:
    """The angle by which one camera is turned against the other."""
    cosine = (float(np.trace(np.asarray(calibration.rotation, np.float64))) - 1.0) / 2.0
    return math.acos(min(1.0, max(-1.0, cosine)))


def _facts(section: CalibrationSection) -> list[tuple[str, str]]:
    calibration = section.calibration
    width, height = calibration.image_size
    sigma_mm = 1000.0 * baseline_sigma_m(calibration)
    facts = [
        ("baseline", plus_minus(1000.0 * calibration.baseline_m, sigma_mm, "mm", 2)),
        ("focal length, left", _focal(calibration.left, calibration, "left")),
        ("focal length, right", _focal(calibration.right, calibration, "right")),
        ("turn between the cameras", quantity(math.degrees(rotation_angle_rad(calibration)), "°", 3)),
        ("reprojection error, rms", quantity(calibration.rms_px, "px", 3)),
        ("epipolar error, held-out views", quantity(calibration.epipolar_error_px, "px", 3)),
        ("image size", f"{width} × {height} px"),
    ]
    if calibration.views:
        facts.append(("views used", f"{len(calibration.views)} of {len(calibration.views) + len(section.rejected)}"))
    if section.board:
        facts.append(("board", section.board))
    return facts


def _focal(camera: CameraLike, calibration: CalibrationLike, side: str) -> str:
    fx, fy = float(camera.camera_matrix[0][0]), float(camera.camera_matrix[1][1])
    sigma = calibration.sigma
    return f"{plus_minus(fx, sigma.get(f'{side}_fx'), 'px', 2)} × {plus_minus(fy, sigma.get(f'{side}_fy'), 'px', 2)}"


def _range_sigma(calibration: CalibrationLike) -> list[tuple[str, str, str]]:
    rows = []
    for range_m in RANGES_M:
        sigma_m = float(calibration.range_sigma(range_m))
        if not math.isfinite(sigma_m):
            return []
        sigma = f"±\u00a0{quantity(1000.0 * sigma_m, 'mm', 1)}"
        rows.append((quantity(range_m, "m", 0), sigma, percent(sigma_m / range_m, 2)))
    return rows


def _view_names(section: CalibrationSection) -> list[str]:
    count = len(section.calibration.views)
    return list(section.view_names) if len(section.view_names) == count else [f"view {i + 1}" for i in range(count)]


def _or_nothing(rms_px: float) -> float:
    """No column for a camera that did not see the board."""
    return 0.0 if math.isnan(rms_px) else float(rms_px)


def _residuals(section: CalibrationSection) -> Markup | None:
    views = section.calibration.views
    if not views:
        return None
    return column_chart(
        title="Reprojection error of each view",
        labels=_view_names(section),
        groups=[
            ("left", [_or_nothing(view.left_rms_px) for view in views], "c0"),
            ("right", [_or_nothing(view.right_rms_px) for view in views], "c1"),
        ],
        x_label="view",
        y_label="rms, px",
        level=("all views", float(section.calibration.rms_px)),
    )


def _coverage(section: CalibrationSection) -> list[tuple[str, Markup]]:
    sides = (("left", section.left_px), ("right", section.right_px))
    size = section.calibration.image_size
    return [
        (side, coverage_figure(points, size, title=f"Corners of all views in the {side} camera"))
        for side, points in sides
        if len(points) > 0
    ]


def _arrows(section: CalibrationSection) -> list[tuple[str, Markup]]:
    """Residual vectors of both cameras."""
    errors = section.errors
    if errors is None:
        return []
    size = section.calibration.image_size
    sides = (("left", section.left_px, errors.left_off_px), ("right", section.right_px, errors.right_off_px))
    return [
        (
            f"{side} camera: rms {quantity(_rms(off_px), 'px', 3)}",
            residual_figure(np.concatenate(list(seen_px)), off_px, size, title=f"Residuals of the {side} camera"),
        )
        for side, seen_px, off_px in sides
        if len(off_px)
    ]


def _epipolar(section: CalibrationSection) -> list[tuple[str, Markup]]:
    """Vertical disparity before and after rectification."""
    errors = section.errors
    if errors is None or not len(errors.vertical_px):
        return []
    before, after = (float(np.abs(values).mean()) for values in (errors.raw_vertical_px, errors.vertical_px))
    return [
        (f"mean {quantity(before, 'px', 2)} before, {quantity(after, 'px', 3)} after", before_after_chart(errors)),
        ("the corners of the fit; the held-out error above is of views it did not see", vertical_chart(errors)),
    ]


def _uncertainty(section: CalibrationSection) -> list[tuple[str, Markup]]:
    size = section.calibration.image_size
    return [
        (
            f"at {quantity(one.depth_m, 'm', 2)}",
            uncertainty_figure(one.sigma_px, size, title=f"Uncertainty of the rows at {one.depth_m:.2f} m, px"),
        )
        for one in section.uncertainty
        if np.isfinite(one.sigma_px).any()
    ]


def _poses(section: CalibrationSection) -> Markup | None:
    if not section.poses:
        return None
    calibration = section.calibration
    rotation, translation_m = (np.asarray(v, np.float64) for v in (calibration.rotation, calibration.translation_m))
    right_centre_m = -rotation.T @ translation_m.ravel()
    return pose_figure(section.poses, right_centre_m, title="Both cameras and the boards, from above")


def _rms(off_px: Floats) -> float:
    return float(np.sqrt(np.square(off_px).sum(axis=1).mean()))
