"""Drawings of a calibration: residual vectors, uncertainty over the picture, where the boards were."""

import math
from collections.abc import Sequence
from html import escape

import numpy as np
from markupsafe import Markup

from epiline.report.charts import Axis, Points, histogram, line_chart, nice_step
from epiline.report.model import BoardPose, CalibrationErrors
from epiline.report.numbers import number, quantity
from epiline.report.protocols import Floats
from epiline.report.svg import svg

# Longest arrow that a typical residual gets, as a share of the picture's width.
_ARROW_SHARE = 0.035
_STEPS = 6
_MAX_ARROWS = 2500


def residual_figure(seen_px: Floats, off_px: Floats, image_size: tuple[int, int], *, title: str) -> Markup:
    """An arrow at every corner along its residual, magnified.

    `seen_px` and `off_px` (seen minus predicted) are (N, 2), pixels. The magnification is stated in the drawing.
    """
    width, height = image_size
    at, off = seen_px + 0.5, off_px
    lengths = np.linalg.norm(off, axis=1)
    typical = float(np.quantile(lengths, 0.95)) or 1.0
    # A round magnification: a person can divide by it.
    gain = nice_step(2 * _ARROW_SHARE * width / typical, 2)
    step = max(1, len(at) // _MAX_ARROWS)
    tips = at + gain * off
    lines = "".join(
        f"M{x:.1f} {y:.1f}L{u:.1f} {v:.1f}" for (x, y), (u, v) in zip(at[::step], tips[::step], strict=True)
    )
    dots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in at[::step])
    body = (
        f'<rect class="frame" width="{width}" height="{height}"/><path class="arrow" d="{lines}"/>'
        f'<path class="corner c0" stroke-width="{0.006 * width:.1f}" d="{dots}"/>'
        + _scale(width, height, f"{gain:g} x: {_round(0.1 * width / gain)} px", gain * _round(0.1 * width / gain))
    )
    return svg(title, width, height, body, "coverage")


def uncertainty_figure(sigma_px: Floats, image_size: tuple[int, int], *, title: str) -> Markup:
    """A (rows, columns) map over the picture, each cell with its value in pixels; cells that are NaN stay empty.

    Shades go by the figures of the verdict: the deepest is six tenths of a pixel, beyond which a rig is no use.
    """
    width, height = image_size
    rows, columns = sigma_px.shape
    cell_width, cell_height = width / columns, height / rows
    body = [f'<rect class="frame" width="{width}" height="{height}"/>']
    for (row, column), value in np.ndenumerate(sigma_px):
        if not math.isfinite(value):
            continue
        shade = min(_STEPS, 1 + int(value / 0.1))
        x, y = column * cell_width, row * cell_height
        body.append(
            f'<rect class="heat h{shade}" x="{x:.1f}" y="{y:.1f}" width="{cell_width:.1f}" height="{cell_height:.1f}"/>'
            f'<text class="heat" text-anchor="middle" style="font-size:{0.3 * cell_width:.1f}px" '
            f'x="{x + cell_width / 2:.1f}" y="{y + cell_height / 2 + 0.1 * cell_width:.1f}">{number(value, 2)}</text>'
        )
    return svg(title, width, height, "".join(body), "coverage")


def vertical_chart(errors: CalibrationErrors) -> Markup:
    """Vertical disparity of all corners after rectification: how far from its row each one is."""
    after = np.asarray(errors.vertical_px, np.float64)
    limit = max(float(np.quantile(np.abs(after), 0.99)) * 1.5, 0.1)
    return histogram(
        title="Vertical disparity of the corners after rectification",
        x_label="vertical disparity, px",
        groups=[("after rectification", after, "c0")],
        limits=(-limit, limit),
    )


def before_after_chart(errors: CalibrationErrors) -> Markup:
    """Each corner's vertical disparity against its row: as photographed and after rectification."""
    rows = np.asarray(errors.row_px, np.float64)
    before, after = (np.asarray(v, np.float64) for v in (errors.raw_vertical_px, errors.vertical_px))
    step = max(1, len(rows) // 700)
    low, high = float(min(before.min(), after.min(), 0.0)), float(max(before.max(), after.max(), 0.0))
    air = 0.06 * max(high - low, 1.0)
    return line_chart(
        title="Vertical disparity of the corners before and after rectification",
        x=Axis(label="row in the left photograph, px", limits=(0.0, float(rows.max()) * 1.02 + 1.0)),
        y=Axis(label="vertical disparity, px", limits=(low - air, high + air)),
        points=[
            Points(name="as photographed", x=rows[::step], y=before[::step], tone="c1"),
            Points(name="after rectification", x=rows[::step], y=after[::step], tone="c0"),
        ],
    )


def pose_figure(poses: Sequence[BoardPose], baseline_m: Floats, *, title: str, width: float = 436.0) -> Markup:
    """Both cameras and every board, seen from above and a little from behind.

    Poses are in the left camera's frame; `baseline_m` is the right camera's centre there, (3,) metres.
    """
    farthest = max((float(pose.outline_m[:, 2].max()) for pose in poses), default=1.0)
    size = 0.16 * farthest
    cameras = [_frustum(np.zeros(3), size), _frustum(np.asarray(baseline_m, np.float64), size)]
    everything = [*cameras, *(pose.outline_m for pose in poses)]
    flat = [_seen_from_above(points) for points in everything]
    corners = np.concatenate(flat)
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 26.0
    scale = (width - 2 * margin) / max(float((high - low)[0]), 0.8 * float((high - low)[1]), 1e-9)
    height = float((high - low)[1]) * scale + 2 * margin
    across = margin + (width - 2 * margin - float((high - low)[0]) * scale) / 2

    def path(points: Floats, *, closed: bool) -> str:
        at = (points - low) * scale + (across, margin)
        return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in at) + ("Z" if closed else "")

    body = []
    order = np.argsort([-float(pose.outline_m[:, 2].mean()) for pose in poses])
    for i in order:
        tip = f"{poses[i].name}: {quantity(float(np.linalg.norm(poses[i].outline_m.mean(axis=0))), 'm', 2)}"
        body.append(
            f'<path class="board c{i % 6}" d="{path(flat[2 + i], closed=True)}"><title>{escape(tip)}</title></path>'
        )
    body += [f'<path class="camera" d="{path(points, closed=False)}"/>' for points in flat[:2]]
    for name, points in zip(("left", "right"), flat[:2], strict=True):
        x, y = (points[0] - low) * scale + (across, margin + 16)
        anchor = "end" if name == "left" else "start"
        body.append(f'<text class="label" text-anchor="{anchor}" x="{x:.1f}" y="{y:.1f}">{name}</text>')
    metres = _round(0.25 * width / scale)
    body.append(
        _bar(12.0, height - 8.0, metres * scale, quantity(metres, "m", max(0, -math.floor(math.log10(metres)))))
    )
    return svg(title, width, height, "".join(body), "chart poses")


def _frustum(centre: Floats, size: float) -> Floats:
    """A camera as one line: from its centre to the corners of its picture and around."""
    a, b, c, d = (
        centre + size * np.array([x, y, 1.0]) for x, y in ((-0.5, -0.4), (0.5, -0.4), (0.5, 0.4), (-0.5, 0.4))
    )
    return np.array([centre, a, b, centre, c, d, centre, a, d, c, b])


def _seen_from_above(points: Floats) -> Floats:
    """(N, 2) drawing coordinates of (N, 3) points: x to the right, depth up, and height a little."""
    raised = math.radians(35)
    return np.stack([points[:, 0], math.sin(raised) * points[:, 1] - math.cos(raised) * points[:, 2]], axis=1)


def _round(value: float) -> float:
    """The round number next to it."""
    return nice_step(2 * value, 2)


def _scale(width: float, height: float, text: str, length: float) -> str:
    size = 0.026 * width
    return (
        f'<path class="scale-bar" d="M{0.02 * width:.1f} {height - 0.02 * width:.1f}h{length:.1f}"/>'
        f'<text class="scale-bar" style="font-size:{size:.1f}px" x="{0.02 * width:.1f}" '
        f'y="{height - 0.035 * width:.1f}">{escape(text)}</text>'
    )


def _bar(x: float, y: float, length: float, text: str) -> str:
    return (
        f'<path class="scale-bar" d="M{x:.1f} {y:.1f}h{length:.1f}"/>'
        f'<text class="tick" x="{x + length + 6:.1f}" y="{y + 3.5:.1f}">{escape(text)}</text>'
    )
