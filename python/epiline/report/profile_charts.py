"""A region as the 2011 paper draws it: value against column. Columns without an answer are gaps."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from epiline.report.charts import WIDTH, Axis, Band, Line, SecondAxis, limits_of, line_chart
from epiline.report.protocols import Floats, ProfileLike

NEAREST, MEDIAN, EXTREMES = "nearest supported", "median", "min to max"


def columns_of(profile: ProfileLike) -> Floats:
    """Columns of the image that the region covers, px."""
    region = profile.region
    return np.arange(region.x, region.x + region.width, dtype=np.float64)


def column_axis(columns: Floats) -> Axis:
    """The horizontal axis of every profile."""
    return Axis(label="column, px", limits=(float(columns[0]) - 0.5, float(columns[-1]) + 0.5), ticks=7)


def value_axis(profile: ProfileLike, include: tuple[float, ...] = ()) -> Axis:
    """Disparity: from the lowest median to the highest supported value, or wider to include given ones."""
    nearest, median = (np.asarray(values, np.float64) for values in (profile.nearest_px, profile.median_px))
    return Axis(label="disparity, px", limits=limits_of(nearest, median, include=include))


def range_axis(*shown_m: Floats) -> Axis:
    """Range from zero; the far background of a few columns would press everything near onto the axis."""
    return Axis(label="range, m", limits=limits_of(*shown_m, include=(0.0,), upper_share=0.95))


def value_chart(
    profile: ProfileLike,
    *,
    axis: Axis,
    second: SecondAxis | None = None,
    truth_px: Floats | None = None,
    width: float = WIDTH,
) -> Markup:
    """Nearest supported value and median of each column, between its extremes."""
    columns = columns_of(profile)
    nearest, median, low, high = (
        np.asarray(values, np.float64)
        for values in (profile.nearest_px, profile.median_px, profile.minimum_px, profile.maximum_px)
    )
    lines = [
        Line(name=MEDIAN, x=columns, y=median, tone="c3"),
        Line(name=NEAREST, x=columns, y=nearest, tone="c0", keep="max"),
    ]
    if truth_px is not None:
        lines.append(Line(name="truth", x=columns, y=np.asarray(truth_px, np.float64), tone="truth", keep="max"))
    return line_chart(
        title=f"Region {profile.region.name}: pixel value against column",
        x=column_axis(columns),
        y=axis,
        bands=[Band(name=EXTREMES, x=columns, low=low, high=high, tone="c0")],
        lines=lines,
        second=second,
        empty="no column has enough support",
        width=width,
    )


def range_chart(profile: ProfileLike, *, truth_m: Floats | None = None, width: float = WIDTH) -> Markup | None:
    """Range of each column's nearest supported value; None without geometry."""
    if profile.nearest_range_m is None:
        return None
    columns, ranges_m = columns_of(profile), np.asarray(profile.nearest_range_m, np.float64)
    lines = [Line(name=NEAREST, x=columns, y=ranges_m, tone="c2", keep="min")]
    shown = [ranges_m]
    if truth_m is not None:
        known = np.asarray(truth_m, np.float64)
        lines.append(Line(name="truth", x=columns, y=known, tone="truth", keep="min"))
        shown.append(known)
    return line_chart(
        title=f"Region {profile.region.name}: range against column",
        x=column_axis(columns),
        y=range_axis(*shown),
        lines=lines,
        empty="no column has enough support",
        width=width,
    )
