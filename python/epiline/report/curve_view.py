"""The range curve of eq. 6, as the template shows it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from epiline.report.charts import Axis, Band, Line, Points, limits_of, line_chart
from epiline.report.model import RangeCurveSection
from epiline.report.numbers import number, quantity, significant

_SAMPLES = 200


@dataclass(frozen=True, kw_only=True)
class CurveView:
    """Everything the template shows of a fitted curve."""

    source: str
    chart: Markup
    residuals: Markup
    coefficients: Sequence[tuple[str, str]]
    facts: Sequence[tuple[str, str]]


def curve_view(section: RangeCurveSection) -> CurveView:
    """Draws the fit, its 95 % prediction band, and what it leaves of each measured pair."""
    curve = section.curve
    measured_x = np.asarray(section.disparity_px, np.float64)
    measured_y = np.asarray(section.distance_m, np.float64)
    x = np.linspace(*curve.span_px, _SAMPLES)
    y = np.asarray(curve.predict(x), np.float64)
    low, high = (np.asarray(bound, np.float64) for bound in curve.predict_interval(x, confidence=0.95))
    x_axis = Axis(label="disparity, px", limits=_padded(x, measured_x), ticks=7)
    left_over = measured_y - np.asarray(curve.predict(measured_x), np.float64)
    reach = 1.25 * float(np.max(np.abs(left_over[np.isfinite(left_over)]), initial=1e-6))
    return CurveView(
        source=section.source,
        chart=line_chart(
            title="Distance against disparity: measured pairs and the fitted curve",
            x=x_axis,
            y=Axis(label="distance, m", limits=limits_of(y, measured_y, low, high, include=(0.0,))),
            bands=[Band(name="95 % prediction", x=x, low=low, high=high, tone="c0")],
            lines=[Line(name="fit", x=x, y=y, tone="c0")],
            points=[Points(name="measured", x=measured_x, y=measured_y, tone="c1")],
        ),
        residuals=line_chart(
            title="What the fit leaves of each measured distance",
            x=x_axis,
            y=Axis(label="measured − fit, m", limits=(-reach, reach)),
            bands=[Band(name="95 % prediction", x=x, low=low - y, high=high - y, tone="c0")],
            lines=[Line(name="fit", x=x, y=np.zeros_like(x), tone="c0")],
            points=[Points(name="measured", x=measured_x, y=left_over, tone="c1")],
        ),
        coefficients=[
            ("a", f"{significant(curve.a, 6)} m"),
            ("b", f"{significant(curve.b, 6)} 1/px"),
            ("c", f"{significant(curve.c, 6)} m"),
            ("d", f"{significant(curve.d, 6)} 1/px"),
        ],
        facts=[
            ("pairs", str(measured_x.size)),
            ("rmse", quantity(curve.rmse_m, "m", 4)),
            ("R²", number(curve.r_squared, 5)),
            ("valid between", f"{number(curve.span_px[0], 1)} and {quantity(curve.span_px[1], 'px', 1)}"),
        ],
    )


def _padded(*arrays: np.ndarray[tuple[int], np.dtype[np.float64]]) -> tuple[float, float]:
    low, high = min(float(np.nanmin(a)) for a in arrays), max(float(np.nanmax(a)) for a in arrays)
    margin = 0.03 * max(high - low, 1e-6)
    return low - margin, high + margin
