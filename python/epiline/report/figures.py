"""Pictures with drawings on them. Photographs and maps are embedded once per page; lines and labels are vectors on top.

Drawings use the coordinates of the full-size image, whatever size the embedded picture has.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import cv2
import numpy as np
from markupsafe import Markup

from epiline._pictures import Limits, Palette, colour_palette, disparity_levels, grey_palette
from epiline.report.charts import nice_step, nice_ticks
from epiline.report.encode import data_uri, jpeg, palette_png, reduced
from epiline.report.numbers import number, quantity
from epiline.report.protocols import (
    AlignmentLike,
    DisparityLike,
    Floats,
    GeometryLike,
    Image,
    ObstacleLike,
    RegionLike,
)
from epiline.report.reasons import REASONS, first_reason
from epiline.report.svg import svg

SCAN_LINES = 9
_SCAN_TONES = 4
_ROUND_MANTISSAS = ((1, 2, 5), (3, 4), (1.5, 2.5, 7), (3.5, 6, 8), (1.2, 1.4, 1.6, 1.8, 2.2, 2.7, 4.5))
"""Leading figures of depths on a scale, the roundest group first."""

_CENTRE = 0.5
"""From a pixel position, where (0, 0) is the centre of the first pixel, to the drawing's, where it is its corner."""

_GAP_SHARE = 0.012
"""Gap between the two views of a pair, as a share of one width."""


@dataclass(frozen=True, kw_only=True)
class Picture:
    """An image to be embedded once under `key` (unique on the page) and drawn on many times."""

    key: str
    uri: str
    width: int
    height: int
    is_map: bool = False

    @property
    def definition(self) -> Markup:
        """Where the picture's bytes are, once."""
        style = ' class="map"' if self.is_map else ""
        return Markup(
            f'<image id="{escape(self.key)}"{style} width="{self.width}" height="{self.height}" '
            f'preserveAspectRatio="none" href="{self.uri}"/>'
        )

    def placed(self, x: float = 0.0, style: str = "") -> str:
        """A use of the picture."""
        shift = f' x="{x:.1f}"' if x else ""
        kind = f' class="{style}"' if style else ""
        return f'<use{kind} href="#{escape(self.key)}"{shift}/>'


@dataclass(frozen=True, kw_only=True)
class ScanLine:
    """A row drawn across both views; the points are where the same scene point was found, if it was."""

    y: float
    left: tuple[float, float] | None = None
    right: tuple[float, float] | None = None


def photograph(key: str, image: Image, *, max_pixels: int) -> Picture:
    """A photograph, as JPEG."""
    height, width = image.shape[:2]
    uri = data_uri(jpeg(reduced(image, max_pixels)), "image/jpeg")
    return Picture(key=key, uri=uri, width=width, height=height)


def grey_map(key: str, disparity: DisparityLike, limits_px: Limits, *, max_pixels: int) -> Picture:
    """The disparity in grey, nearer is brighter, invalid black."""
    return _level_map(key, disparity, limits_px, grey_palette(), max_pixels)


def colour_map(key: str, disparity: DisparityLike, limits_px: Limits, *, max_pixels: int) -> Picture:
    """The disparity in colour, far blue to near red, invalid dark."""
    return _level_map(key, disparity, limits_px, colour_palette(), max_pixels)


def reason_map(key: str, disparity: DisparityLike, *, max_pixels: int) -> Picture:
    """Unmeasured pixels in the colour of their first reason; measured ones transparent."""
    indices = reduced(first_reason(disparity.validity), max_pixels, interpolation=cv2.INTER_NEAREST)
    palette = np.array([(0, 0, 0), *(reason.bgr for reason in REASONS)], np.uint8)
    alpha = np.array([0] + [255] * len(REASONS), np.uint8)
    height, width = disparity.validity.shape
    uri = data_uri(palette_png(indices, palette, alpha=alpha), "image/png")
    return Picture(key=key, uri=uri, width=width, height=height, is_map=True)


def definitions(pictures: Sequence[Picture]) -> Markup:
    """The pictures' bytes, not shown by themselves."""
    body = "".join(picture.definition for picture in pictures)
    return Markup(f'<svg class="definitions" width="0" height="0" aria-hidden="true"><defs>{body}</defs></svg>')


def plain_figure(picture: Picture, *, title: str, under: Picture | None = None) -> Markup:
    """A picture alone, or over a dimmed one."""
    below = under.placed(style="dimmed") if under is not None else ""
    return _figure(title, picture.width, picture.height, below + picture.placed())


def scan_lines(alignment: AlignmentLike | None, height: int, *, count: int = SCAN_LINES) -> list[ScanLine]:
    """Rows to draw across a pair, through matched points where there are any.

    Each of `count` bands of rows is represented by the match whose vertical residual has the median size, so that
    the picture is neither better nor worse than the measurement; a band without matches by its middle row.
    """
    empty = np.empty((0, 2))
    left, right = (empty, empty) if alignment is None else (alignment.left_px, alignment.right_px)
    left, right = (np.asarray(points, np.float64).reshape(-1, 2) for points in (left, right))
    residual = np.abs(left[:, 1] - right[:, 1])
    band = np.clip(np.floor(left[:, 1] * count / height), 0, count - 1)
    lines = []
    for i in range(count):
        group = np.flatnonzero(band == i)
        if group.size == 0:
            lines.append(ScanLine(y=(i + 0.5) * height / count))
            continue
        chosen = group[np.argsort(residual[group], kind="stable")[(group.size - 1) // 2]]
        (lx, ly), (rx, ry) = left[chosen].tolist(), right[chosen].tolist()
        lines.append(ScanLine(y=ly, left=(lx, ly), right=(rx, ry)))
    return lines


def pair_figure(left: Picture, right: Picture, lines: Sequence[ScanLine], *, title: str, dashed: bool) -> Markup:
    """Both views side by side with scan-lines running across, rings where the same point was found in each."""
    gap = max(2.0, _GAP_SHARE * left.width)
    shift = left.width + gap
    full = shift + right.width
    ring = 0.008 * left.width
    body = [left.placed(), right.placed(shift)]
    for i, line in enumerate(lines):
        tone = f"scan s{i % _SCAN_TONES}"
        style = f"{tone} dashed" if dashed else tone
        body.append(f'<path class="{style}" d="M0 {line.y + _CENTRE:.1f}H{full:.1f}"/>')
        for point, origin in ((line.left, 0.0), (line.right, shift)):
            if point is not None:
                x, y = origin + point[0] + _CENTRE, point[1] + _CENTRE
                body.append(f'<circle class="{tone}" cx="{x:.1f}" cy="{y:.1f}" r="{ring:.1f}"/>')
    return _figure(title, full, max(left.height, right.height), "".join(body))


def region_figure(picture: Picture, regions: Sequence[RegionLike], *, title: str) -> Markup:
    """The regions as green boxes with their names."""
    size = _text_size(picture)
    labels = _Labels(picture, size)
    body = [picture.placed()]
    for region in regions:
        body.append(_box("region", region.x, region.y, region.width, region.height))
    for region in regions:
        body.append(labels.put(region.name, "region", region.x, region.y, region.width, region.height))
    return _figure(title, picture.width, picture.height, "".join(body))


def obstacle_figure(picture: Picture, obstacles: Sequence[ObstacleLike], *, title: str) -> Markup:
    """The obstacles as boxes with number and range; the nearest stands out."""
    size = _text_size(picture)
    labels = _Labels(picture, size)
    nearest_first = sorted(obstacles, key=lambda o: o.range_m if math.isfinite(o.range_m) else math.inf)
    boxes, texts = [], []
    for place, obstacle in enumerate(nearest_first):
        style = "obstacle nearest" if place == 0 else "obstacle"
        boxes.append(_box(style, *obstacle.box))
        texts.append(labels.put(f"{obstacle.id} · {quantity(obstacle.range_m, 'm')}", style, *obstacle.box))
    # The nearest comes last, on top of the others.
    return _figure(title, picture.width, picture.height, picture.placed() + "".join(boxes[::-1] + texts[::-1]))


def colour_bar(limits_px: Limits, geometry: GeometryLike | None, *, grey: bool) -> Markup:
    """The scale of a disparity picture: metres of depth above (if the geometry is known), pixels below.

    Colours are linear in disparity; depth is `Z = focal_px·baseline_m / (disparity + doffs)`.
    """
    width, left, right, bar_top, bar_height, height = 436.0, 14.0, 34.0, 24.0, 12.0, 58.0
    room = width - left - right
    low, high = limits_px
    palette = (grey_palette() if grey else colour_palette())[1:]
    strip = palette_png(np.arange(palette.shape[0], dtype=np.uint8)[None], palette)

    def across(disparity: float) -> float:
        return left + room * (disparity - low) / (high - low)

    parts = [
        f'<image x="{left:.1f}" y="{bar_top:.1f}" width="{room:.1f}" height="{bar_height:.1f}" '
        f'preserveAspectRatio="none" href="{data_uri(strip, "image/png")}"/>'
    ]
    if geometry is not None:
        for disparity, text in _metre_ticks(limits_px, geometry):
            x = across(disparity)
            parts.append(f'<path class="tickmark" d="M{x:.1f} {bar_top - 4:.1f}v4"/>')
            place = f'x="{x:.1f}" y="{bar_top - 8:.1f}"'
            parts.append(f'<text class="tick strong" text-anchor="middle" {place}>{text}</text>')
    digits = max(0, -math.floor(math.log10(nice_step(high - low, 6)) + 1e-9))
    for disparity in nice_ticks(limits_px, 6):
        x, bottom = across(disparity), bar_top + bar_height
        parts.append(f'<path class="tickmark" d="M{x:.1f} {bottom:.1f}v4"/>')
        text = number(disparity, digits)
        parts.append(f'<text class="tick" text-anchor="middle" x="{x:.1f}" y="{bottom + 16:.1f}">{text}</text>')
    parts.append(f'<text class="tick" text-anchor="end" x="{width:.1f}" y="{bar_top + bar_height + 16:.1f}">px</text>')
    if geometry is not None:
        parts.append(f'<text class="tick strong" text-anchor="end" x="{width:.1f}" y="{bar_top - 8:.1f}">m</text>')
    title = "Scale of the disparity picture, in metres of depth and pixels of disparity"
    return svg(title, width, height, "".join(parts), "chart scale")


def coverage_figure(views_px: Sequence[Floats], image_size: tuple[int, int], *, title: str) -> Markup:
    """All corners of all views over the frame of one camera, thirds marked."""
    width, height = image_size
    thirds = "".join(
        f'<path class="grid" d="M{width * k / 3:.1f} 0V{height}M0 {height * k / 3:.1f}H{width}"/>' for k in (1, 2)
    )
    # A line of no length with round ends is a dot, at a quarter of a circle's markup.
    dots = "".join(
        f'<path class="corner c{i % 6}" stroke-width="{0.011 * width:.1f}" d="'
        + "".join(f"M{x:.0f} {y:.0f}h0" for x, y in np.asarray(points, np.float64).reshape(-1, 2) + _CENTRE)
        + '"/>'
        for i, points in enumerate(views_px)
    )
    frame = f'<rect class="frame" width="{width}" height="{height}"/>'
    return svg(title, width, height, frame + thirds + dots, "coverage")


def _level_map(key: str, disparity: DisparityLike, limits_px: Limits, palette: Palette, max_pixels: int) -> Picture:
    height, width = disparity.values.shape
    levels = reduced(disparity_levels(disparity.values, limits_px), max_pixels, interpolation=cv2.INTER_NEAREST)
    uri = data_uri(palette_png(levels, palette), "image/png")
    return Picture(key=key, uri=uri, width=width, height=height, is_map=True)


def _metre_ticks(limits_px: Limits, geometry: GeometryLike) -> list[tuple[float, str]]:
    """Round depths with the disparity each lies at, far enough apart to be read; infinity where the bar reaches it."""
    low, high = limits_px
    focal_baseline = geometry.focal_px * geometry.baseline_m
    apart = 0.085 * (high - low)
    candidates = [(-geometry.doffs_px, "∞")] if low <= -geometry.doffs_px <= high else []
    # Rounder numbers first: they claim their place, finer ones fill what is left.
    for mantissas in _ROUND_MANTISSAS:
        for power in range(-2, 4):
            for mantissa in mantissas:
                depth_m = mantissa * 10.0**power
                candidates.append((focal_baseline / depth_m - geometry.doffs_px, f"{depth_m:g}"))
    ticks: list[tuple[float, str]] = []
    for disparity, text in candidates:
        if low <= disparity <= high and all(abs(disparity - other) >= apart for other, _ in ticks):
            ticks.append((disparity, text))
    return sorted(ticks)


def _text_size(picture: Picture) -> float:
    return max(6.0, min(0.024 * picture.width, 0.045 * picture.height))


def _box(style: str, x: float, y: float, width: float, height: float) -> str:
    place = f'x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"'
    return f'<rect class="casing" {place}/><rect class="{style}" {place}/>'


class _Labels:
    """Places labels by their boxes so that they do not cover each other where that can be helped."""

    def __init__(self, picture: Picture, size: float) -> None:
        self.picture, self.size = picture, size
        self.taken: list[tuple[float, float, float, float]] = []

    def put(self, text: str, style: str, x: float, y: float, width: float, height: float) -> str:
        text_width = 0.62 * self.size * len(text)
        label_width, label_height = text_width + 0.7 * self.size, 1.35 * self.size
        left = min(max(x, 0.0), max(self.picture.width - label_width, 0.0))
        right = min(max(x + width - label_width, 0.0), max(self.picture.width - label_width, 0.0))
        tops = (y - label_height, y, y + height - label_height, y + height)
        choices = [(a, b) for b in tops for a in (left, right) if 0.0 <= b <= self.picture.height - label_height]
        choices.append((left, min(max(y, 0.0), self.picture.height - label_height)))
        place = next((c for c in choices if self._free(*c, label_width, label_height)), choices[0])
        self.taken.append((*place, label_width, label_height))
        text_x, text_y = place[0] + 0.35 * self.size, place[1] + self.size
        # The length is stated, so that the text fits its box in whatever font the reader has.
        return (
            f'<rect class="tag {style}" x="{place[0]:.1f}" y="{place[1]:.1f}" width="{label_width:.1f}" '
            f'height="{label_height:.1f}" rx="{0.2 * self.size:.1f}"/><text class="tag {style}" '
            f'style="font-size:{self.size:.1f}px" x="{text_x:.1f}" y="{text_y:.1f}" textLength="{text_width:.1f}" '
            f'lengthAdjust="spacingAndGlyphs">{escape(text)}</text>'
        )

    def _free(self, x: float, y: float, width: float, height: float) -> bool:
        return not any(
            x < ox + ow and ox < x + width and y < oy + oh and oy < y + height for ox, oy, ow, oh in self.taken
        )


def _figure(title: str, width: float, height: float, body: str) -> Markup:
    return svg(title, width, height, body, "picture")
