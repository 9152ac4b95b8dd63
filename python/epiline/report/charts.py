"""Charts as inline SVG: lines, bars, histograms. Colours come from the page's style sheet, so light and dark both work.

Every function returns well-formed markup with an accessible title. Values that are not finite are gaps.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal, TypeAlias

import numpy as np
from markupsafe import Markup

from epiline.report.numbers import number, significant
from epiline.report.protocols import Floats
from epiline.report.svg import svg

WIDTH, WIDE, HEIGHT = 436.0, 900.0, 204.0
_TOP, _BOTTOM, _LEFT = 26.0, 40.0, 56.0
_RIGHT, _RIGHT_WITH_AXIS = 14.0, 46.0
_CHARACTER = 6.1
"""Width of a legend character at the style sheet's 11 px, for layout."""

MAX_POINTS = 400
"""Points of a line; more columns than the plot has pixels cannot be seen, only downloaded."""

Limits: TypeAlias = tuple[float, float]
Keep: TypeAlias = Literal["max", "min", "median"]


_CHOICES: dict[Keep, Callable[[Floats], float]] = {
    "max": lambda values: float(values.max()),
    "min": lambda values: float(values.min()),
    "median": lambda values: float(np.median(values)),
}


@dataclass(frozen=True, kw_only=True)
class Axis:
    """An axis: label with its unit, limits, and how many ticks to aim for."""

    label: str
    limits: Limits
    ticks: int = 5


@dataclass(frozen=True, kw_only=True)
class SecondAxis:
    """A second reading of the vertical axis: ticks as (value on the first axis, label)."""

    label: str
    ticks: Sequence[tuple[float, str]]


@dataclass(frozen=True, kw_only=True)
class Line:
    """A curve; `tone` is `c0` … `c5` or `truth` (dashed). `keep` says what represents points that share a pixel."""

    name: str
    x: Floats
    y: Floats
    tone: str
    keep: Keep = "median"


@dataclass(frozen=True, kw_only=True)
class Band:
    """The area between two curves."""

    name: str
    x: Floats
    low: Floats
    high: Floats
    tone: str


@dataclass(frozen=True, kw_only=True)
class Points:
    """Measured points, drawn as rings."""

    name: str
    x: Floats
    y: Floats
    tone: str


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A labelled amount."""

    label: str
    value: float


def nice_step(span: float, count: int) -> float:
    """The step of 1, 2 or 5 times a power of ten that divides `span` into about `count` parts."""
    raw = span / max(count, 1)
    power = 10.0 ** math.floor(math.log10(raw))
    return power * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(math.log(m * power / raw)))


def nice_ticks(limits: Limits, count: int = 5) -> list[float]:
    """Round values within the limits, ascending."""
    low, high = limits
    step = nice_step(high - low, count)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [i * step for i in range(first, last + 1)]


def limits_of(*arrays: Floats, include: Sequence[float] = (), upper_share: float = 1.0) -> Limits:
    """Limits that hold the finite values of all arrays and `include`, with a little air above.

    `upper_share` below 1 takes that quantile of the values as the top: a few wild values are cut, not shown.
    """
    finite = [array[np.isfinite(array)] for array in arrays]
    values = np.concatenate([*finite, np.asarray(include, np.float64)])
    if values.size == 0:
        return 0.0, 1.0
    low, high = float(values.min()), float(np.quantile(values, upper_share, method="higher"))
    high = max([high, *include])
    if not high > low:
        return (low, low + 1.0) if include else (low - 0.5, low + 0.5)
    return low, high + 0.1 * (high - low)


def line_chart(
    *,
    title: str,
    x: Axis,
    y: Axis,
    lines: Sequence[Line] = (),
    bands: Sequence[Band] = (),
    points: Sequence[Points] = (),
    second: SecondAxis | None = None,
    empty: str = "nothing to draw",
    width: float = WIDTH,
) -> Markup:
    """Curves over a common pair of axes. Parts beyond the limits are cut at the frame.

    `width` is in units of the 11 px text. `empty` is written across the plot if nothing has a finite value.
    """
    frame = _Frame(x, y, second, width)
    body = []
    for band in bands:
        path = _band_path(band, frame)
        if path:
            body.append(f'<path class="band {band.tone}" d="{path}"/>')
    for line in lines:
        path = _line_path(line, frame)
        if path:
            body.append(f'<path class="line {line.tone}" d="{path}"/>')
    for cloud in points:
        rings = _rings(cloud, frame)
        if rings:
            body.append(f'<g class="points {cloud.tone}">{rings}</g>')
    legend = [(band.name, f"band {band.tone}") for band in bands]
    legend += [(line.name, f"line {line.tone}") for line in lines]
    legend += [(cloud.name, f"points {cloud.tone}") for cloud in points]
    if not body:
        return frame.svg(title, [], _centred(frame, empty))
    return frame.svg(title, legend, "".join(body))


def histogram(
    *, title: str, x_label: str, groups: Sequence[tuple[str, Floats, str]], limits: Limits, bins: int = 60
) -> Markup:
    """Distributions over the same bins, each as a share of its own values.

    `groups` are (name, values, tone); values beyond the limits count in the outermost bins, so nothing is hidden.
    """
    edges = np.linspace(limits[0], limits[1], bins + 1)
    shares = []
    for _, values, _ in groups:
        inside = np.clip(values[np.isfinite(values)], limits[0], limits[1])
        shares.append(100.0 * np.histogram(inside, edges)[0] / max(inside.size, 1))
    top = max((float(share.max()) for share in shares), default=0.0)
    frame = _Frame(Axis(label=x_label, limits=limits), Axis(label="matches, %", limits=(0.0, max(top * 1.08, 1.0))))
    body, legend = [], []
    for (name, _, tone), share in zip(groups, shares, strict=True):
        steps_x, steps_y = np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(share, 2), [0.0]])
        outline = _path(frame.across(steps_x), frame.down(steps_y))
        body.append(f'<path class="area {tone}" d="{outline}"/>')
        legend.append((name, f"area {tone}"))
    if limits[0] < 0.0 < limits[1]:
        zero = float(frame.across(np.zeros(1))[0])
        body.append(f'<path class="zero" d="M{zero:.1f} 0V{frame.height:.1f}"/>')
    return frame.svg(title, legend, "".join(body))


def column_chart(
    *,
    title: str,
    labels: Sequence[str],
    groups: Sequence[tuple[str, Sequence[float], str]],
    x_label: str,
    y_label: str,
    level: tuple[str, float] | None = None,
) -> Markup:
    """Upright bars side by side, numbered from 1; `labels` show when pointed at. `level` is a dashed line across."""
    count = len(labels)
    values = np.array([v for _, group, _ in groups for v in group] + ([level[1]] if level else []), np.float64)
    y = Axis(label=y_label, limits=(0.0, limits_of(values, include=(0.0,))[1]), ticks=4)
    frame = _Frame(Axis(label=x_label, limits=(0.5, count + 0.5), ticks=0), y)
    pitch = frame.width / max(count, 1)
    bar_width = min(26.0, 0.72 * pitch / max(len(groups), 1))
    body = []
    for g, (name, group, tone) in enumerate(groups):
        for i, (label, value) in enumerate(zip(labels, group, strict=True)):
            if not math.isfinite(value):
                continue
            left = (i + 0.5) * pitch + (g - len(groups) / 2) * bar_width
            top = float(frame.down(np.array([value]))[0])
            tip = f"{label}: {name} {significant(value)}"
            body.append(
                f'<rect class="bar {tone}" x="{left:.1f}" y="{top:.1f}" width="{bar_width - 1:.1f}" '
                f'height="{max(frame.height - top, 0.0):.1f}"><title>{escape(tip)}</title></rect>'
            )
    legend = [(name, f"bar {tone}") for name, _, tone in groups]
    if level is not None and math.isfinite(level[1]):
        height = float(frame.down(np.array([level[1]]))[0])
        body.append(f'<path class="line truth" d="M0 {height:.1f}H{frame.width:.1f}"/>')
        legend.append((level[0], "line truth"))
    every = max(1, math.ceil(count * 16 / frame.width))
    numbers = "".join(
        f'<text class="tick" text-anchor="middle" x="{frame.left + (i + 0.5) * pitch:.1f}" '
        f'y="{frame.top + frame.height + 14:.1f}">{i + 1}</text>'
        for i in range(0, count, every)
    )
    return frame.svg(title, legend, "".join(body), numbers)


def bar_chart(*, title: str, bars: Sequence[Bar], unit: str, digits: int = 2) -> Markup:
    """Horizontal bars from a common zero, each with its value and its share of the whole."""
    row, label_width, value_width = 24.0, 118.0, 112.0
    total = sum(bar.value for bar in bars)
    longest = max((bar.value for bar in bars), default=0.0) or 1.0
    room = WIDTH - label_width - value_width
    body = []
    for i, bar in enumerate(bars):
        y = i * row
        share = f" · {100.0 * bar.value / total:.0f} %" if total > 0.0 else ""
        length = room * bar.value / longest
        body.append(
            f'<text class="bar-label" text-anchor="end" x="{label_width - 8:.1f}" y="{y + 16:.1f}">{escape(bar.label)}'
            f'</text><rect class="bar c0" x="{label_width:.1f}" y="{y + 4:.1f}" width="{max(length, 1.0):.1f}" '
            f'height="{row - 8:.1f}" rx="2"/><text class="bar-value" x="{label_width + length + 7:.1f}" '
            f'y="{y + 16:.1f}">{number(bar.value, digits)} {escape(unit)}{share}</text>'
        )
    return svg(title, WIDTH, max(len(bars), 1) * row, "".join(body), "chart bars")


class _Frame:
    """The plot area of a chart, and its axes around it. Plot coordinates start at its own top left corner."""

    def __init__(self, x: Axis, y: Axis, second: SecondAxis | None = None, chart_width: float = WIDTH) -> None:
        self.x, self.y, self.second, self.chart_width = x, y, second, chart_width
        self.left, self.top = _LEFT, _TOP
        self.width = chart_width - _LEFT - (_RIGHT if second is None else _RIGHT_WITH_AXIS)
        self.height = HEIGHT - _TOP - _BOTTOM

    def across(self, values: Floats) -> Floats:
        low, high = self.x.limits
        return (values - low) / (high - low) * self.width

    def down(self, values: Floats) -> Floats:
        low, high = self.y.limits
        # Far beyond the frame is as good as anywhere beyond it, and keeps the numbers short.
        return np.clip((high - values) / (high - low), -3.0, 4.0) * self.height

    def svg(self, title: str, legend: Sequence[tuple[str, str]], body: str, extra: str = "") -> Markup:
        # A nested svg cuts what leaves the plot, without an id that would have to be unique on the page.
        plot = (
            f'<svg x="{self.left:.1f}" y="{self.top:.1f}" width="{self.width:.1f}" height="{self.height:.1f}" '
            f'viewBox="0 0 {self.width:.1f} {self.height:.1f}">{body}</svg>'
        )
        return svg(title, self.chart_width, HEIGHT, self._axes() + plot + extra + self._legend(legend), "chart")

    def _axes(self) -> str:
        left, top, right, bottom = self.left, self.top, self.left + self.width, self.top + self.height
        parts = []
        for value, text in _labelled(self.y):
            y = top + float(self.down(np.array([value]))[0])
            parts.append(f'<path class="grid" d="M{left:.1f} {y:.1f}H{right:.1f}"/>')
            parts.append(f'<text class="tick" text-anchor="end" x="{left - 6:.1f}" y="{y + 3.5:.1f}">{text}</text>')
        for value, text in _labelled(self.x):
            x = left + float(self.across(np.array([value]))[0])
            parts.append(f'<path class="tickmark" d="M{x:.1f} {bottom:.1f}v4"/>')
            parts.append(f'<text class="tick" text-anchor="middle" x="{x:.1f}" y="{bottom + 15:.1f}">{text}</text>')
        parts.append(f'<path class="axis" d="M{left:.1f} {bottom:.1f}H{right:.1f}"/>')
        middle_x, middle_y = (left + right) / 2, (top + bottom) / 2
        parts.append(_label(self.x.label, middle_x, HEIGHT - 6))
        parts.append(_label(self.y.label, 12, middle_y, turned=-90))
        if self.second is not None:
            for value, text in self.second.ticks:
                y = top + float(self.down(np.array([value]))[0])
                parts.append(f'<path class="tickmark" d="M{right:.1f} {y:.1f}h4"/>')
                parts.append(f'<text class="tick" x="{right + 7:.1f}" y="{y + 3.5:.1f}">{escape(text)}</text>')
            parts.append(_label(self.second.label, self.chart_width - 6, middle_y, turned=-90))
        return "".join(parts)

    def _legend(self, entries: Sequence[tuple[str, str]]) -> str:
        parts, x = [], self.left
        for name, style in entries:
            kind = style.split()[0]
            mark = {
                "line": f'<path class="{style}" d="M{x:.1f} 11h16"/>',
                "points": f'<g class="{style}"><circle cx="{x + 8:.1f}" cy="11" r="3"/></g>',
            }.get(kind, f'<rect class="{style}" x="{x:.1f}" y="6" width="16" height="9"/>')
            parts.append(f'{mark}<text class="legend" x="{x + 21:.1f}" y="14.5">{escape(name)}</text>')
            x += 21 + _CHARACTER * len(name) + 14
        return "".join(parts)


def _label(text: str, x: float, y: float, *, turned: int = 0) -> str:
    turn = f' transform="rotate({turned} {x:.1f} {y:.1f})"' if turned else ""
    return f'<text class="label" text-anchor="middle" x="{x:.1f}" y="{y:.1f}"{turn}>{escape(text)}</text>'


def _labelled(axis: Axis) -> list[tuple[float, str]]:
    if axis.ticks < 1:
        return []
    ticks = nice_ticks(axis.limits, axis.ticks)
    step = nice_step(axis.limits[1] - axis.limits[0], axis.ticks)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return [(tick, number(tick, digits)) for tick in ticks]


def _centred(frame: _Frame, text: str) -> str:
    place = f'x="{frame.width / 2:.1f}" y="{frame.height / 2:.1f}"'
    return f'<text class="empty" text-anchor="middle" {place}>{escape(text)}</text>'


def _thinned(x: Floats, y: Floats, keep: Keep) -> tuple[Floats, Floats]:
    """At most `MAX_POINTS` points: each group of neighbours by its mean x and its largest, smallest or median y."""
    group = math.ceil(x.size / MAX_POINTS)
    if group <= 1:
        return x, y
    choose = _CHOICES[keep]
    xs, ys = [], []
    for start in range(0, x.size, group):
        part = y[start : start + group]
        finite = part[np.isfinite(part)]
        xs.append(float(x[start : start + group].mean()))
        ys.append(choose(finite) if finite.size else math.nan)
    return np.array(xs), np.array(ys)


def _runs(finite: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> list[tuple[int, int]]:
    """Begin and end of each unbroken stretch of True."""
    padded = np.concatenate([[False], finite, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _path(xs: Floats, ys: Floats) -> str:
    return "M" + " ".join(f"{x:.1f} {y:.1f}" for x, y in zip(xs, ys, strict=True))


def _line_path(line: Line, frame: _Frame) -> str:
    x, y = _thinned(np.asarray(line.x, np.float64), np.asarray(line.y, np.float64), line.keep)
    across, down = frame.across(x), frame.down(y)
    # A single column between gaps is a dot: a line of no length with round ends.
    return "".join(
        _path(across[a:b], down[a:b]) + ("h0" if b - a == 1 else "") for a, b in _runs(np.isfinite(across + down))
    )


def _band_path(band: Band, frame: _Frame) -> str:
    given = np.asarray(band.x, np.float64)
    x, low = _thinned(given, np.asarray(band.low, np.float64), "min")
    _, high = _thinned(given, np.asarray(band.high, np.float64), "max")
    across, upper, lower = frame.across(x), frame.down(high), frame.down(low)
    return "".join(
        _path(np.concatenate([across[a:b], across[a:b][::-1]]), np.concatenate([upper[a:b], lower[a:b][::-1]])) + "Z"
        for a, b in _runs(np.isfinite(across + upper + lower))
    )


def _rings(cloud: Points, frame: _Frame) -> str:
    across, down = frame.across(np.asarray(cloud.x, np.float64)), frame.down(np.asarray(cloud.y, np.float64))
    return "".join(
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3"/>'
        for x, y in zip(across, down, strict=True)
        if math.isfinite(x) and math.isfinite(y)
    )
