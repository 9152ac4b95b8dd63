"""The graph of a region as a picture file: SVG with the report's charts, PNG drawn with OpenCV."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from epiline._files import StrPath, write_atomically
from epiline.report.charts import HEIGHT, WIDE, Axis, nice_ticks
from epiline.report.numbers import number
from epiline.report.profile_charts import (
    EXTREMES,
    MEDIAN,
    NEAREST,
    column_axis,
    columns_of,
    range_axis,
    range_chart,
    value_axis,
    value_chart,
)
from epiline.report.protocols import Floats, ProfileLike

Quantity: TypeAlias = Literal["disparity", "range"]
Colour: TypeAlias = tuple[int, int, int]

# The report's colours, written out: a picture has no page around it that would define them.
_STYLE = """
text { font: 11px system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; fill: #59636e; }
text.tick { font-size: 10.5px; } text.legend { fill: #14181d; } text.empty { font-size: 13px; }
.grid { stroke: #e7ebee; fill: none; } .axis, .tickmark { stroke: #8a949e; fill: none; }
.line { fill: none; stroke-width: 1.7; stroke-linejoin: round; stroke-linecap: round; }
.line.c0 { stroke: #1769d2; } .line.c2 { stroke: #0d8a5f; } .line.c3 { stroke: #8792a0; stroke-width: 1.1; }
.band.c0 { fill: #1769d2; opacity: 0.17; }
"""
_BLUE, _GREEN, _GREY, _PALE = (210, 105, 23), (95, 138, 13), (160, 146, 135), (247, 229, 214)
_INK, _SOFT, _RULE = (29, 24, 20), (110, 99, 89), (238, 235, 231)

_SIZE = (960, 360)
_LEFT, _TOP, _RIGHT, _BOTTOM = 78, 40, 22, 56


def write_profile(profile: ProfileLike, path: StrPath, *, quantity: Quantity = "disparity") -> None:
    """Draws a region's value against column, as the 2011 paper does.

    Parameters
    ----------
    profile : RegionProfile
        The region. Columns without a supported value are gaps.
    path : path-like
        Ends in ``.svg``, or ``.png``.
    quantity : {"disparity", "range"}
        What is drawn: disparity, px (nearest supported, median, extremes), or the range of the nearest, m.

    Raises
    ------
    ValueError
        Another suffix or quantity; or ranges of a profile that was read without geometry.
    OSError
        The file cannot be written.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in (".svg", ".png"):
        raise ValueError(f"{path}: '{suffix}' is no format of a profile; use .svg or .png")
    if quantity not in ("disparity", "range"):
        raise ValueError(f"quantity = {quantity!r}: must be 'disparity' or 'range'")
    if quantity == "range" and profile.nearest_range_m is None:
        raise ValueError(f"quantity = 'range': region '{profile.region.name}' was read without geometry")
    write_atomically(path, _svg(profile, quantity) if suffix == ".svg" else _png(profile, quantity))


def _svg(profile: ProfileLike, quantity: Quantity) -> bytes:
    chart = (
        range_chart(profile, width=WIDE)
        if quantity == "range"
        else value_chart(profile, axis=value_axis(profile), width=WIDE)
    )
    head, rest = str(chart).split(">", 1)
    size = f'xmlns="http://www.w3.org/2000/svg" width="{WIDE:g}" height="{HEIGHT:g}"'
    ground = f'<style>{_STYLE}</style><rect width="{WIDE:g}" height="{HEIGHT:g}" fill="#ffffff"/>'
    return f"{head} {size}>{ground}{rest}\n".encode()


def _png(profile: ProfileLike, quantity: Quantity) -> bytes:
    columns = columns_of(profile)
    if quantity == "range":
        ranges_m = np.asarray(profile.nearest_range_m, np.float64)
        plot = _Plot(column_axis(columns), range_axis(ranges_m))
        legend = [(NEAREST, _GREEN)]
        plot.line(columns, ranges_m, _GREEN)
        title = f"Region {profile.region.name}: range against column"
    else:
        nearest, median, low, high = (
            np.asarray(values, np.float64)
            for values in (profile.nearest_px, profile.median_px, profile.minimum_px, profile.maximum_px)
        )
        plot = _Plot(column_axis(columns), value_axis(profile))
        legend = [(NEAREST, _BLUE), (MEDIAN, _GREY), (EXTREMES, _PALE)]
        plot.bars(columns, low, high, _PALE)
        plot.line(columns, median, _GREY)
        plot.line(columns, nearest, _BLUE)
        title = f"Region {profile.region.name}: pixel value against column"
    done, encoded = cv2.imencode(".png", plot.finished(title, legend))
    assert done, "OpenCV encodes every uint8 image as PNG"
    return encoded.tobytes()


class _Plot:
    """A white picture with axes; what is drawn ends at its frame."""

    def __init__(self, x: Axis, y: Axis) -> None:
        self.x, self.y = x, y
        self.width, self.height = _SIZE[0] - _LEFT - _RIGHT, _SIZE[1] - _TOP - _BOTTOM
        self.area = np.full((self.height, self.width, 3), 255, np.uint8)
        for tick in nice_ticks(y.limits, y.ticks):
            row = int(self._down(np.array([tick]))[0])
            cv2.line(self.area, (0, row), (self.width, row), _RULE)

    def _across(self, values: Floats) -> NDArray[np.int32]:
        low, high = self.x.limits
        return np.rint((values - low) / (high - low) * (self.width - 1)).astype(np.int32)

    def _down(self, values: Floats) -> NDArray[np.int32]:
        low, high = self.y.limits
        share = np.clip((high - values) / (high - low), -3.0, 4.0)
        return np.rint(share * (self.height - 1)).astype(np.int32)

    def line(self, x: Floats, y: Floats, colour: Colour) -> None:
        """Joins neighbouring columns that both have a value; a value alone is a dot."""
        known = np.isfinite(y)
        points = np.stack([self._across(x), self._down(np.where(known, y, 0.0))], axis=1)
        for run in np.split(np.arange(x.size), np.flatnonzero(np.diff(known)) + 1):
            if known[run[0]]:
                cv2.polylines(self.area, [points[run].reshape(-1, 1, 2)], False, colour, 2, cv2.LINE_AA)

    def bars(self, x: Floats, low: Floats, high: Floats, colour: Colour) -> None:
        """From `low` to `high`, as wide as a column."""
        half = 0.5 * (x[1] - x[0]) if x.size > 1 else 0.5
        known = np.isfinite(low) & np.isfinite(high)
        corners = (self._across(x[known] - half), self._down(high[known]), self._across(x[known] + half))
        for left, top, right, bottom in zip(*corners, self._down(low[known]), strict=True):
            cv2.rectangle(self.area, (int(left), int(top)), (int(right), int(bottom)), colour, cv2.FILLED)

    def finished(self, title: str, legend: list[tuple[str, Colour]]) -> NDArray[np.uint8]:
        """The picture with title, legend and labelled axes."""
        picture = np.full((_SIZE[1], _SIZE[0], 3), 255, np.uint8)
        bottom = _TOP + self.height
        picture[_TOP:bottom, _LEFT : _LEFT + self.width] = self.area
        cv2.line(picture, (_LEFT, bottom), (_LEFT + self.width, bottom), _SOFT)
        for axis, horizontal in ((self.x, True), (self.y, False)):
            ticks = nice_ticks(axis.limits, axis.ticks)
            step = ticks[1] - ticks[0] if len(ticks) > 1 else 1.0
            digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
            for tick in ticks:
                text = number(tick, digits).replace("\u2212", "-").replace("\u202f", " ")
                if horizontal:
                    at = _LEFT + int(self._across(np.array([tick]))[0])
                    cv2.line(picture, (at, bottom), (at, bottom + 5), _SOFT)
                    _write(picture, text, (at, bottom + 20), centred=True)
                else:
                    at = _TOP + int(self._down(np.array([tick]))[0])
                    _write(picture, text, (_LEFT - 8 - _width(text), at + 4))
        _write(picture, self.x.label, (_LEFT + self.width // 2, _SIZE[1] - 10), centred=True)
        turned = np.full((22, self.height, 3), 255, np.uint8)
        _write(turned, self.y.label, (self.height // 2, 15), centred=True)
        picture[_TOP:bottom, 4:26] = cv2.rotate(turned, cv2.ROTATE_90_COUNTERCLOCKWISE)
        _write(picture, title, (_LEFT, 24), _INK)
        right = _SIZE[0] - _RIGHT
        for name, colour in reversed(legend):
            right -= _width(name)
            _write(picture, name, (right, 24), _INK)
            cv2.line(picture, (right - 26, 20), (right - 8, 20), colour, 4)
            right -= 44
        return picture


def _width(text: str) -> int:
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.45, 1)
    return int(width)


def _write(
    picture: NDArray[np.uint8], text: str, at: tuple[int, int], colour: Colour = _SOFT, *, centred: bool = False
) -> None:
    # OpenCV's letters are ASCII.
    plain = text.encode("ascii", "replace").decode()
    x = at[0] - _width(plain) // 2 if centred else at[0]
    cv2.putText(picture, plain, (x, at[1]), cv2.FONT_HERSHEY_SIMPLEX, 0.45, colour, 1, cv2.LINE_AA)
