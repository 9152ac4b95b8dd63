"""Nearest returns per column and ranges of regions: made by hand, and the anchors' peers on photographs."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.cli import main
from epiline.evaluation import load_scenes
from epiline.evaluation.obstacles.columns import column_methods, nearest_supported_px, score_columns
from epiline.evaluation.obstacles.regions import compare, range_reached
from epiline.evaluation.obstacles.road import compare_road

NAN = float("nan")


def brute_nearest(column: np.ndarray, support: int) -> float:
    """The largest value with `support` values, itself included, in the pixel below it; one by one."""
    values = sorted((float(v) for v in column if np.isfinite(v)), reverse=True)
    for value in values:
        if sum(value - 1 <= other <= value for other in values) >= support:
            return value
    return NAN


@pytest.mark.parametrize("support", [1, 3, 8])
def test_nearest_supported_column_by_column(support: int) -> None:
    rng = np.random.default_rng(2)
    values = np.where(rng.random((30, 50)) < 0.3, NAN, rng.integers(0, 160, (30, 50)) / 16).astype(np.float32)
    values[:, 7] = NAN
    expected = [brute_nearest(column, support) for column in values.T]
    np.testing.assert_array_equal(nearest_supported_px(values, support), np.array(expected, np.float32))


def test_columns_too_near_right_missed_and_unanswered() -> None:
    """A board of 20 px before a wall at 4 px, eight columns asked about."""
    truth = np.full((20, 60), 4.0, np.float32)
    truth[5:15, 30:40] = 20.0
    right = np.where((np.arange(60) >= 30) & (np.arange(60) < 40), 20.0, 4.0).astype(np.float32)
    perfect = score_columns(right, truth)
    assert (perfect.false_near, perfect.missed, perfect.missed_seen, perfect.columns) == (0, 0, 0, 60)
    near, far, none = right.copy(), right.copy(), right.copy()
    near[[10, 20, 50]] += 3
    far[[31, 33]] = 4.0
    none[[31, 33, 50]] = NAN
    assert score_columns(near, truth).false_near == pytest.approx(100 * 3 / 60)
    assert score_columns(near, truth).nothing_there == score_columns(near, truth).false_near
    assert score_columns(near, truth).missed == 0
    assert score_columns(far, truth).missed == pytest.approx(100 * 2 / 60)
    assert score_columns(none, truth).missed == pytest.approx(100 * 3 / 60)
    # Columns 0 to 3 of the wall leave the right image, and of those beside the board it hides 16.
    assert score_columns(none, truth).unknown == pytest.approx(100 * 3 / 56)
    assert score_columns(far, truth).unknown == 0
    assert score_columns(right + 2, truth).false_near == 0
    assert score_columns(right - 2, truth).missed == 0


def test_what_shows_fewer_pixels_than_a_surface_needs_is_there_all_the_same() -> None:
    """A rod of 5 px before a wall: a return from it is false near, but something is there."""
    truth = np.full((20, 60), 4.0, np.float32)
    truth[8:13, 20:40] = 20.0
    score = score_columns(np.full(60, 20.0, np.float32), truth)
    assert score.false_near == 100
    assert score.nothing_there == pytest.approx(100 * 40 / 60)


def test_what_the_right_camera_cannot_see_is_missed_by_one_figure_only() -> None:
    truth = np.full((20, 60), 4.0, np.float32)
    answer = np.where(np.arange(60) < 4, NAN, 4.0).astype(np.float32)
    score = score_columns(answer, truth)
    assert score.missed == pytest.approx(100 * 4 / 60)
    assert score.missed_seen == 0


def a_map(disparity_px: np.ndarray) -> ep.DisparityMap:
    raw = np.round(16 * np.nan_to_num(disparity_px)).astype(np.uint16)
    return ep.DisparityMap(raw, np.where(np.isfinite(disparity_px), 0, 1).astype(np.uint8), num_disparities=128)


def test_the_truth_is_where_enough_of_its_points_are() -> None:
    ranges = np.concatenate([np.linspace(9.8, 10.2, 401), np.full(29, 3.0), [NAN]])
    assert range_reached(ranges, 30) == pytest.approx(9.829)
    assert range_reached(ranges, 1) == 3.0
    assert np.isnan(range_reached(ranges[-1:], 1))


def test_what_stands_on_a_road_is_found_and_what_does_not_is_false() -> None:
    """A car-sized box 12 m ahead on a road 1.6 m below the camera, before nothing."""
    geometry = ep.RectifiedGeometry(width=640, height=240, focal_px=400, cx_px=319.5, cy_px=99.5, baseline_m=0.5)
    fall = (np.arange(240)[:, None] - geometry.cy_px) / geometry.focal_px * np.ones((1, 640))
    with np.errstate(divide="ignore"):
        road = np.where(fall > 0.03, 200.0 * fall / 1.6, NAN)
    box = np.s_[105:153, 280:360]
    truth = road.copy()
    truth[box] = 200 / 12
    right = compare_road(a_map(truth), truth, geometry)
    assert right.asked == right.found == 10
    assert (right.false, right.grounds) == (0, 1)
    assert right.judged >= 1
    # A box that the laser does not see, and one that only the laser sees.
    wrong = compare_road(a_map(truth), road, geometry)
    assert wrong.asked == 0
    assert wrong.false == wrong.judged >= 1
    missed = compare_road(a_map(road), truth, geometry)
    assert (missed.asked, missed.found, missed.judged) == (10, 0, 0)
    # At a wrong depth it is neither found nor real.
    off = truth.copy()
    off[box] = 200 / 8
    displaced = compare_road(a_map(off), truth, geometry)
    assert displaced.found == 0
    assert displaced.false == displaced.judged >= 1
    assert (right + displaced).figures()["found"] == 50


def test_regions_of_a_map_against_its_truth() -> None:
    geometry = ep.RectifiedGeometry(width=320, height=240, focal_px=300, cx_px=159.5, cy_px=119.5, baseline_m=0.5)
    truth = np.full((240, 320), 20.0)
    truth[:, 100:140] = 30.0
    perfect = compare(a_map(truth), truth, geometry)
    assert len(perfect.samples) == 16
    assert perfect.silent == perfect.left_out == 0
    assert np.abs([sample.error for sample in perfect.samples]).max() < 0.02
    assert all(perfect.seen)
    # Half a pixel off everywhere: an error as it is, none once the pair's offset is taken out.
    off = compare(a_map(truth - 0.5), truth, geometry)
    assert off.offset_px == -0.5
    assert np.median([sample.error for sample in off.samples]) > 0.015
    assert np.median(np.abs([sample.error for sample in off.without_offset])) < 0.005
    # Something nearer where the truth is silent cannot be judged, and where the truth speaks it is too near.
    nearer = truth.copy()
    nearer[:, 100:140] = 60.0
    unknown = np.where(nearer == 60, NAN, truth)
    assert compare(a_map(nearer), unknown, geometry).left_out > 0
    assert min(sample.error for sample in compare(a_map(nearer), truth, geometry).samples) < -0.4
    blind = compare(a_map(np.where(truth == 30, NAN, truth)), truth, geometry)
    assert len(blind.seen) == len(blind.samples) == 16
    assert all(seen == (sample.error < 0.05) for seen, sample in zip(blind.seen, blind.samples, strict=True))
    assert 0 < sum(blind.seen) < 16
    nothing = compare(a_map(np.full_like(truth, NAN)), truth, geometry)
    assert (len(nothing.samples), nothing.silent) == (0, 16)


def test_the_peers_are_those_of_the_anchors(data: Path) -> None:
    """StereoBM as its defaults make it, written down a second time."""
    (scene,) = (s for s in load_scenes(data) if s.name == "middlebury2003/cones")
    left, right = (cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (scene.left, scene.right))
    raw = cv2.StereoBM.create(64, 21).compute(left, right)
    values = np.where(raw < 0, NAN, raw / 16)
    minimum, supported = (m for m in column_methods((), 1) if m.name.startswith("StereoBM,"))
    np.testing.assert_array_equal(minimum.returns(scene), [brute_nearest(column, 1) for column in values.T])
    np.testing.assert_array_equal(supported.returns(scene), [brute_nearest(column, 8) for column in values.T])


def test_the_verb_on_photographs(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["evaluate", "--obstacles", str(data), "--scenes", "2003/cones", "kitti2015/000004", "--preset", "fast"]
    assert main([*arguments, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert {row["method"] for row in report["columns"]} >= {"StereoBM, u-disparity", "fast, u-disparity"}
    regions = {f"all 1, {offset}{of}" for offset in ("as it is", "less the offset") for of in ("", ", seen")}
    assert {row["scenes"] for row in report["regions"]} == regions
    assert [(row["method"], row["grounds"]) for row in report["road"]] == [("fast", 1)]
    assert main([*arguments, "--csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert {row["table"] for row in rows} == {"columns", "road", "regions"}
    assert main(arguments) == 0
    assert "nearest return of each column, 1 scenes" in capsys.readouterr().out
    assert main(["evaluate", "--obstacles", str(data), "--scenes", "eth3d"]) == 1
    assert "no scene of Middlebury's or KITTI's kind" in capsys.readouterr().err
