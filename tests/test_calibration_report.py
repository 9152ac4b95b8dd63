"""The drawings of a calibration hold what they claim to show."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

import epiline as ep
from epiline.cli.reporting import calibration_section
from epiline.report import BoardPose, Provenance, RunReport, render_html
from epiline.report.calibration_figures import pose_figure, residual_figure, uncertainty_figure
from epiline.sources.rendered import RenderedRig
from epiline.verdict import Verdict, judge

HOSTILE = '<script>alert("x")</script>&'


def paths(drawing: str, style: str) -> list[list[float]]:
    """Numbers of every path of a style."""
    found = [e for e in ET.fromstring(drawing).iter() if style in e.get("class", "").split()]
    return [[float(n) for n in re.findall(r"-?\d+\.?\d*", e.get("d", ""))] for e in found]


def test_an_arrow_is_its_residual_magnified_as_stated() -> None:
    seen = np.array([[100.0, 50.0], [300.0, 200.0], [10.0, 10.0]])
    off = np.array([[0.2, 0.0], [-0.1, 0.1], [0.0, -0.2]])
    drawing = str(residual_figure(seen, off, (640, 480), title="residuals"))
    (numbers,) = paths(drawing, "arrow")
    ends = np.array(numbers).reshape(-1, 2, 2)
    np.testing.assert_allclose(ends[:, 0], seen + 0.5, atol=0.06)
    stated = re.search(r">([\d.]+) x: ([\d.]+) px<", drawing)
    assert stated is not None
    gain, length_px = float(stated[1]), float(stated[2])
    np.testing.assert_allclose(ends[:, 1] - ends[:, 0], gain * off, atol=0.11)
    (bar,) = paths(drawing, "scale-bar")[:1]
    assert bar[2] == pytest.approx(gain * length_px, abs=0.1)


def test_the_map_shows_every_known_cell() -> None:
    sigma = np.array([[0.02, np.nan, 0.31], [0.7, 0.15, 9.0]])
    drawing = str(uncertainty_figure(sigma, (640, 480), title="map"))
    cells = [e for e in ET.fromstring(drawing).iter() if e.get("class", "").startswith("heat h")]
    assert [e.get("class") for e in cells] == ["heat h1", "heat h4", "heat h6", "heat h2", "heat h6"]
    assert re.findall(r">(\d+\.\d\d)<", drawing) == ["0.02", "0.31", "0.70", "0.15", "9.00"]


def test_boards_stand_where_they_stood() -> None:
    square = np.array([[0, 0, 1], [0.2, 0, 1], [0.2, 0.2, 1], [0, 0.2, 1]], np.float64)
    poses = [BoardPose(name=HOSTILE, outline_m=square), BoardPose(name="far", outline_m=square + np.array([0.5, 0, 2]))]
    drawing = str(pose_figure(poses, np.array([0.1, 0.0, 0.0]), title="poses"))
    far, near = (np.array(p).reshape(-1, 2) for p in paths(drawing, "board"))
    left, right = (np.array(p).reshape(-1, 2) for p in paths(drawing, "camera"))
    # Farther is higher up, right is right, and the scale is one.
    assert far[:, 1].max() < near[:, 1].min() < left[0, 1]
    assert right[0, 0] > left[0, 0]
    scale = (near[1, 0] - near[0, 0]) / 0.2
    assert right[0, 0] - left[0, 0] == pytest.approx(0.1 * scale, abs=0.2)
    assert far[0, 0] - near[0, 0] == pytest.approx(0.5 * scale, abs=0.2)
    assert "<script>" not in drawing


def test_the_page_of_a_calibration(tmp_path: Path) -> None:
    rig = RenderedRig(seed=3, size=(320, 240))
    pairs = [(view.left, view.right) for view in rig.board_views(9, 6, 0.04, 8)]
    left, right = (list(side) for side in zip(*pairs, strict=True))
    views = ep.find_boards([*left, None], [*right, right[0]], ep.Chessboard(columns=9, rows=6, square_m=0.04))
    calibration = ep.calibrate(views)
    verdict = judge(calibration, views)
    section = calibration_section(calibration, views, Verdict(verdict.grade, (HOSTILE,), (HOSTILE, "come nearer")))
    provenance = Provenance(command="c", started=datetime(2026, 1, 1), version="0", simd_level="s", machine="m")
    page = render_html(RunReport(title="t", provenance=provenance, calibration=section))
    for heading in (
        "Photograph next",
        "Residual vectors",
        "Epipolar error before and after",
        "Uncertainty over the picture",
        "Where the boards were",
        "Views not used",
    ):
        assert heading in page
    assert "come nearer" in page
    assert "there is no such photograph" in page
    assert "<script>" not in page
    for drawing in re.findall(r"<svg.*?</svg>(?!.{0,200}</svg>)", page, re.S):
        if drawing.count("<svg") == drawing.count("</svg>"):
            ET.fromstring(drawing)
