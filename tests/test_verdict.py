"""A verdict agrees with what is true: of synthetic rigs, and of the photographs that a calibration did not see."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.sources import open_source
from epiline.targets import Corners, Observations, View
from epiline.verdict import expected_misalignment_px, judge, vertical_sigma_px
from epiline.verdict.coverage import coverage_of
from epiline.verdict.lens import misfit
from epiline.verdict.residuals import view_errors
from epiline.verdict.rig import Rig

SIZE = (640, 480)
BOARD = ep.Chessboard(columns=9, rows=6, square_m=0.025)


@pytest.fixture(scope="module")
def truth() -> ep.StereoCalibration:
    left = ep.CameraModel([[534, 0, 342], [0, 533, 235], [0, 0, 1]], [-0.28, 0.09, 1e-3, -3e-4], width=640, height=480)
    right = ep.CameraModel([[537, 0, 327], [0, 536, 250], [0, 0, 1]], [-0.29, 0.1, -5e-4, 4e-4], width=640, height=480)
    turn = cv2.Rodrigues(np.array([0.006, 0.008, -0.004]))[0]
    return ep.StereoCalibration(left, right, turn, [-0.0832, 9e-4, -2e-4])


def photographed(
    truth: ep.StereoCalibration,
    rng: np.random.Generator,
    count: int,
    *,
    tilt: float | tuple[float, float, float] = 0.5,
    spread: float = 1.0,
    depth_m: tuple[float, float] = (0.3, 0.5),
    noise_px: float = 0.15,
) -> Observations:
    """Boards before a known rig, each corner off by Gaussian noise."""
    middle = BOARD.points_m - BOARD.points_m.mean(axis=0)
    ids = np.arange(len(middle))
    views: list[View] = []
    while len(views) < count:
        turn = cv2.Rodrigues(rng.uniform(-1, 1, 3) * tilt)[0]
        z = rng.uniform(*depth_m)
        place = [rng.uniform(-0.28, 0.28) * z * spread + 0.04, rng.uniform(-0.2, 0.2) * z * spread, z]
        in_left = middle @ turn.T + place
        seen = truth.left.project(in_left), truth.right.project(in_left @ truth.rotation.T + truth.translation_m)
        if all(((px > 2) & (px < np.array(SIZE) - 3)).all() for px in seen):
            left, right = (Corners(px + rng.normal(0, noise_px, px.shape), ids) for px in seen)
            views.append(View(f"left {len(views)}", f"right {len(views)}", left, right, True, ""))
    return Observations(BOARD, SIZE, tuple(views))


def true_misalignment_px(truth: ep.StereoCalibration, found: ep.StereoCalibration) -> float:
    """Mean vertical disparity over the picture, at the boards' distance and ten times it, of points without noise."""
    x, y = np.meshgrid(np.arange(20.0, 640, 40), np.arange(20.0, 480, 40))
    left_px = np.stack([x.ravel(), y.ravel()], axis=1)
    distance_m = float(np.median([np.linalg.norm(view.translation_m) for view in found.views]))
    errors = []
    for depth_m in (distance_m, 10 * distance_m):
        right_px = Rig.of(truth).right_from_left_px(left_px, depth_m)
        seen = ((right_px > 0) & (right_px < np.array(SIZE) - 1)).all(axis=1)
        errors.append(np.abs(Rig.of(found).vertical_px(left_px[seen], right_px[seen])))
    # Where a poor lens folds over, there is no row at all.
    every = np.concatenate(errors)
    return float(every[np.isfinite(every)].mean())


CASES: dict[str, dict[str, Any]] = {
    "sixteen": {"count": 16},
    "eight": {"count": 8},
    "three": {"count": 3},
    "four": {"count": 4},
    "hardly tilted": {"count": 12, "tilt": 0.15},
    "only the middle": {"count": 12, "spread": 0.15, "depth_m": (0.45, 0.6)},
    "small and far": {"count": 12, "depth_m": (1.0, 1.3)},
}


def test_no_rig_that_is_called_good_is_not(truth: ep.StereoCalibration) -> None:
    """Over all kinds of views: 'good' means 0.25 px or better, everywhere in the picture, near and far."""
    rng = np.random.default_rng(7)
    grades: dict[str, list[float]] = {"good": [], "usable": [], "do not use": []}
    for options in CASES.values():
        for _ in range(3):
            views = photographed(truth, rng, **options)
            try:
                found = ep.calibrate(views)
            except ep.Error:
                continue
            grades[judge(found, views).grade].append(true_misalignment_px(truth, found))
    assert len(grades["good"]) >= 4
    # Uncertainty is a width, not a bound: one in ten may be worse than it says, but not by much.
    assert np.quantile(grades["good"], 0.9) <= 0.25
    assert max(grades["good"]) <= 0.4
    assert np.quantile(grades["usable"], 0.8) <= 0.6
    assert np.median(grades["good"]) < np.median(grades["usable"]) < np.median(grades["do not use"])


@pytest.mark.parametrize("case", ["sixteen", "eight", "four", "only the middle"])
def test_the_expected_misalignment_is_the_true_one(truth: ep.StereoCalibration, case: str) -> None:
    rng = np.random.default_rng(11)
    true_px, expected_px = [], []
    for _ in range(12):
        found = ep.calibrate(photographed(truth, rng, **CASES[case]), held_out=False)
        true_px.append(true_misalignment_px(truth, found))
        expected_px.append(expected_misalignment_px(found))
    assert np.mean(true_px) == pytest.approx(np.mean(expected_px), rel=0.3)


def test_the_sigma_map_is_what_repeated_calibrations_scatter_by(truth: ep.StereoCalibration) -> None:
    """Monte Carlo: the same boards, fresh noise."""
    rng = np.random.default_rng(5)
    ideal = photographed(truth, rng, 12, noise_px=0.0)
    depth_m, columns, rows = 2.0, 5, 4
    x = (np.arange(columns) + 0.5) * 640 / columns - 0.5
    y = (np.arange(rows) + 0.5) * 480 / rows - 0.5
    left_px = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    right_px = Rig.of(truth).right_from_left_px(left_px, depth_m)

    def noisy(seen: Corners | None) -> Corners:
        assert seen is not None
        return replace(seen, px=seen.px + rng.normal(0, 0.15, seen.px.shape))

    scatter, sigma = [], []
    for _ in range(60):
        views = tuple(replace(view, left=noisy(view.left), right=noisy(view.right)) for view in ideal.views)
        found = ep.calibrate(replace(ideal, views=views), held_out=False)
        scatter.append(Rig.of(found).vertical_px(left_px, right_px))
        sigma.append(vertical_sigma_px(found, depth_m, columns=columns, rows=rows).ravel())
    measured = np.sqrt(np.square(scatter).mean(axis=0))
    predicted = np.sqrt(np.square(sigma).mean(axis=0))
    # The scatter of 60 draws is itself known to 9 %.
    np.testing.assert_allclose(predicted, measured, rtol=0.3)


def test_what_is_missing_is_asked_for(truth: ep.StereoCalibration) -> None:
    rng = np.random.default_rng(2)

    def advice(**options: Any) -> str:
        views = photographed(truth, rng, **options)
        return "; ".join(judge(ep.calibrate(views, held_out=False), views).photograph_next)

    full = advice(count=40)
    assert "turn the board" not in full
    assert "tip the board" not in full
    assert "more pairs" not in full
    assert "turn the board" in advice(count=12, tilt=0.15)
    assert "tip the board" in advice(count=12, tilt=0.15)
    only_tipped, only_turned = advice(count=20, tilt=(0.6, 0.1, 0.3)), advice(count=20, tilt=(0.1, 0.6, 0.3))
    assert "turn the board" in only_tipped
    assert "tip the board" not in only_tipped
    assert "tip the board" in only_turned
    assert "turn the board" not in only_turned
    assert "take 4 more pairs" in advice(count=4)
    middle = advice(count=12, spread=0.15, depth_m=(0.45, 0.5))
    assert "top left of both pictures" in middle
    assert "nearer and farther" in middle


def test_areas_are_named_as_a_person_sees_them(truth: ep.StereoCalibration) -> None:
    views = photographed(truth, np.random.default_rng(3), 10)
    found = ep.calibrate(views, held_out=False)
    ids = np.arange(54)
    spots = np.stack(np.meshgrid(np.linspace(5, 635, 9), np.linspace(5, 300, 6)), -1).reshape(-1, 2)
    view = View("left", "right", Corners(spots, ids), Corners(spots, ids), True, "")
    coverage = coverage_of(found, replace(views, views=(view,)))
    assert coverage.missing_areas == tuple(f"bottom {at} of both pictures" for at in ("left", "middle", "right"))
    assert coverage.share[0] == pytest.approx(54 / 81, abs=0.02)


def wide(lens: str) -> ep.StereoCalibration:
    """A rig of 110 degrees, whose lens no polynomial of k1 and k2 follows."""
    coefficients = {"kannala-brandt": [-0.02, 0.01, -0.004, 0.001], "brown-conrady": [-0.05, 0.01, 1e-3, -3e-4, 0.0]}
    cameras = [
        ep.CameraModel([[f, 0, cx], [0, f, 238], [0, 0, 1]], coefficients[lens], width=640, height=480, lens=lens)  # type: ignore[arg-type]
        for f, cx in ((300, 322), (302, 316))
    ]
    return ep.StereoCalibration(*cameras, np.eye(3), [-0.08, 0, 0])


def test_a_lens_that_its_model_does_not_follow_is_said() -> None:
    """And which model does: by residuals that go with the radius, and by views that the fit did not see."""
    rng = np.random.default_rng(0)
    # The boards come to the border of the picture, at 55 degrees.
    options = {"count": 12, "depth_m": (0.12, 0.2), "spread": 3.2, "noise_px": 0.1}
    fisheye = photographed(wide("kannala-brandt"), rng, **options)
    found = ep.calibrate(fisheye)
    bad = misfit(found, fisheye)
    assert bad is not None
    assert abs(bad.worst_px) > 0.1
    verdict = judge(found, fisheye)
    assert verdict.grade != "good"
    (reason,) = [reason for reason in verdict.reasons if "does not follow" in reason and "px from its centre" in reason]
    assert "'brown4' does not follow" in reason
    assert "calibrate with model" in reason
    named = reason.split("calibrate with model '")[1].split("'")[0]
    better = ep.calibrate(fisheye, model=named)  # type: ignore[arg-type]
    assert better.epipolar_error_px < 0.8 * found.epipolar_error_px
    assert misfit(better, fisheye) is None
    # The same boards through a lens that the model is made for: nothing to say.
    plain = photographed(wide("brown-conrady"), rng, **options)
    assert misfit(ep.calibrate(plain), plain) is None


@pytest.mark.parametrize("name", ["opencv_bouguet", "boofcv_Bumblebee2_Chess"])
def test_on_real_photographs_the_rest_of_the_folder_agrees(data: Path, name: str) -> None:
    """Parts of a folder judged by the rest of it: what is called usable or good aligns the photographs left over."""
    columns, rows, square_m = (9, 6, 0.025) if "opencv" in name else (6, 4, 0.03)
    source = open_source(str(data / "calib" / name))
    left, right = ([getattr(pair, side) for pair in source.pairs] for side in ("left", "right"))  # type: ignore[attr-defined]
    every = ep.find_boards(left, right, ep.Chessboard(columns=columns, rows=rows, square_m=square_m))
    rng = np.random.default_rng(0)
    judged: list[tuple[str, float, int]] = []
    for count in (2, 3, 5, 8):
        for _ in range(4):
            order = rng.permutation(len(every))
            train, rest = ([every.accepted[i] for i in part] for part in (order[:count], order[count:]))
            views = replace(every, views=tuple(train))
            try:
                found = ep.calibrate(views)
            except ep.Error:
                judged.append(("do not use", np.inf, count))
                continue
            test = replace(every, views=tuple(rest))
            off_px = Rig.of(found).vertical_px(np.concatenate(test.left_px), np.concatenate(test.right_px))
            judged.append((judge(found, views).grade, float(np.abs(off_px).mean()), count))
    assert all(off_px <= 0.25 for grade, off_px, _ in judged if grade == "good")
    assert all(off_px <= 0.6 for grade, off_px, _ in judged if grade == "usable")
    assert all(grade == "do not use" for grade, _, count in judged if count == 2)
    assert any(grade != "do not use" for grade, _, count in judged if count == 8)


def test_one_view_repeated_is_no_calibration(data: Path) -> None:
    folder = data / "calib" / "opencv_bouguet"
    views = ep.find_boards([folder / "left03.jpg"] * 9, [folder / "right03.jpg"] * 9, BOARD)
    assert len(views) == 1
    assert views.rejected[0].reason == "the same view as left03.jpg / right03.jpg"
    with pytest.raises(ValueError, match="board views: 1 given"):
        ep.calibrate(views)


def test_errors_are_seen_minus_predicted(truth: ep.StereoCalibration) -> None:
    views = photographed(truth, np.random.default_rng(8), 9)
    found = ep.calibrate(views, held_out=False)
    errors = view_errors(found, views)
    squares = [np.square(e.left_off_px).sum(axis=1).mean() for e in errors]
    np.testing.assert_allclose(np.sqrt(squares), [view.left_rms_px for view in found.views], rtol=1e-6)
    assert view_errors(truth, views) == []
    # A corner seen 5 px to the right and 4 px up of where it is, in each camera.
    view = views.views[3]
    assert view.left is not None
    assert view.right is not None
    sides = []
    for seen in (view.left, view.right):
        px = seen.px.copy()
        px[11] += (5.0, -4.0)
        sides.append(replace(seen, px=px))
    moved = replace(views, views=(*views.views[:3], replace(view, left=sides[0], right=sides[1]), *views.views[4:]))
    off = view_errors(ep.calibrate(moved, held_out=False), moved)[3]
    for error in (off.left_off_px[11], off.right_off_px[11]):
        np.testing.assert_allclose(error, [5.0, -4.0], atol=0.6)
