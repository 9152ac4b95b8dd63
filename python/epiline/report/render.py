"""The page: one HTML file that needs nothing else."""

import os
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from epiline._files import write_atomically
from epiline._pictures import disparity_limits
from epiline.report.calibration_view import calibration_view
from epiline.report.curve_view import curve_view
from epiline.report.frame_view import frame_view
from epiline.report.model import FrameSummary, RunReport
from epiline.report.numbers import setting
from epiline.report.recorder import MAX_FRAMES, evenly_chosen, summarize
from epiline.report.run_view import run_view

_FULL_PIXELS, _RUN_PIXELS = 960 * 720, 640 * 480
"""Largest embedded picture: of one or two frames, and of more. Keeps a page of eight frames below 8 MB."""


def render_html(report: RunReport, *, max_frames: int = MAX_FRAMES) -> str:
    """The report as an HTML page without external requests.

    Parameters
    ----------
    report
        What to show. Without `summaries`, they are made from `frames`.
    max_frames
        Frames that get their figures; if there are more, that many are evenly chosen.

    Raises
    ------
    ValueError
        If `max_frames` is below 1, two frames share an index, or arrays of a frame have different sizes.
    """
    _check_frames(report)
    chosen = [report.frames[i] for i in evenly_chosen(len(report.frames), max_frames)]
    summaries: Sequence[FrameSummary] = report.summaries or [summarize(frame) for frame in report.frames]
    limits_px = disparity_limits(frame.disparity.values for frame in chosen)
    max_pixels = _FULL_PIXELS if len(chosen) <= 2 else _RUN_PIXELS
    page = _environment().get_template("report.html.j2")
    return page.render(
        report=report,
        started=report.provenance.started.isoformat(sep=" ", timespec="seconds"),
        run=run_view(report, chosen, summaries),
        calibration=None if report.calibration is None else calibration_view(report.calibration),
        frames=[frame_view(frame, limits_px=limits_px, max_pixels=max_pixels) for frame in chosen],
        parameters=[(name, setting(value)) for name, value in report.parameters.items()],
        curve=None if report.range_curve is None else curve_view(report.range_curve),
    )


def write_report(report: RunReport, path: str | os.PathLike[str], *, max_frames: int = MAX_FRAMES) -> Path:
    """Writes `render_html(report)` to `path`, whole or not at all, and returns the path.

    Raises
    ------
    OSError
        If the file cannot be written; the message names it.
    ValueError
        As `render_html`.
    """
    target = Path(path)
    # File names may hold bytes that are no UTF-8; they show as question marks.
    content = render_html(report, max_frames=max_frames).encode("utf-8", "replace")
    write_atomically(target, content)
    return target


def _check_frames(report: RunReport) -> None:
    seen: set[int] = set()
    for frame in report.frames:
        if frame.index in seen:
            raise ValueError(f"frames: index = {frame.index} occurs twice; every frame needs its own")
        seen.add(frame.index)
        size = frame.disparity.values.shape
        for name, shape in (("validity", frame.disparity.validity.shape), ("left", frame.left.shape[:2])):
            if shape != size:
                raise ValueError(f"frame {frame.index}: {name} is {shape}, disparity.values is {size} (rows, columns)")


def _environment() -> Environment:
    return Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
