"""The report's view from above: drawn where things are, and the run's chart of tracks."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from epiline.report.model import FrameSummary
from epiline.report.run_view import run_view
from epiline.report.top_view import top_view

SCAN = SimpleNamespace(
    angle_rad=np.array([-0.2, -0.1, 0.0, 0.1, 0.2], np.float32),
    seen=np.array([2, 0, 1, 1, 0], np.uint8),
    nearest_m=np.array([4, np.nan, np.nan, np.nan, np.nan], np.float32),
    free_from_m=np.array([1, np.nan, 1, 1, 1], np.float32),
    free_to_m=np.array([4, np.nan, 10, 10, 3], np.float32),
    max_range_m=10.0,
)


def track(**changes: object) -> SimpleNamespace:
    given = {"id": 7, "position_m": (1.0, 5.0), "velocity_mps": (0.0, -2.0), "confirmed": True, "misses": 0}
    return SimpleNamespace(**given | changes)


def test_free_stretches_are_outlines_and_obstacles_dots_at_their_place() -> None:
    page = str(top_view(SCAN, [track()], title="From above"))
    free = re.search(r'class="free" d="([^"]*)"', page)
    assert free is not None
    # One run of one direction, and one of three: four points there and back, six there and back.
    assert free[1].count("M") == 2
    assert free[1].count(" ") == 1 * 2 + 1 + 3 * 2 + 5
    hits = re.findall(r"M([\d.]+) ([\d.]+)h0", page)
    assert len(hits) == 1
    side, margin = 420.0, 22.0
    scale = (side - 2 * margin) / 10
    half = float(page.split('viewBox="0 0 ')[1].split()[0]) / 2
    assert float(hits[0][0]) == pytest.approx(half + scale * 4 * np.sin(0.2), abs=0.1)
    assert float(hits[0][1]) == pytest.approx(side - margin - scale * 4 * np.cos(0.2), abs=0.1)
    # The track is to the right and comes nearer by 2 m in the next second.
    assert f'cx="{half + scale:.1f}" cy="{side - margin - 5 * scale:.1f}"' in page
    assert f"l0.0 {2 * scale:.1f}" in page


@pytest.mark.parametrize("changes", [{"confirmed": False}, {"misses": 1}])
def test_tracks_not_confirmed_or_not_seen_are_left_out(changes: dict[str, object]) -> None:
    assert "circle" not in str(top_view(SCAN, [track(**changes)], title="From above"))


def test_an_empty_scan_is_drawn_without_directions() -> None:
    nothing = np.empty(0, np.float32)
    empty = SimpleNamespace(
        **vars(SCAN) | dict.fromkeys(("angle_rad", "nearest_m", "free_from_m", "free_to_m"), nothing)
    )
    page = str(top_view(empty, [], title="From above"))
    assert "free" not in page
    assert "unknown" not in page


def test_a_run_shows_the_tracks_seen_longest() -> None:
    summary = FrameSummary(
        index=0,
        name="a",
        region_range_m={},
        region_truth_m={},
        obstacles=0,
        nearest_m=np.nan,
        nearest_sigma_m=np.nan,
        nearest_region="",
        alignment_px=np.nan,
        valid_share=1.0,
        stage_ms={},
        total_ms=np.nan,
    )
    seen = [{0: 5.0}, {0: 4.9, 1: 9.0}, {0: 4.8, **dict.fromkeys(range(1, 9), 9.0)}]
    summaries = [replace(summary, index=i, track_range_m=ranges) for i, ranges in enumerate(seen)]
    view = run_view(SimpleNamespace(thumbnails=(), calibration=None, range_curve=None), [], summaries)  # type: ignore[arg-type]
    chart = str(view.tracks)
    assert "track 0" in chart
    assert "track 1" in chart
    assert view.tracks_left_out == 9 - 6
    unmoved = [replace(summary, index=i) for i in range(3)]
    assert run_view(SimpleNamespace(thumbnails=(), calibration=None, range_curve=None), [], unmoved).tracks is None  # type: ignore[arg-type]
