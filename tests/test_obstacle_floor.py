"""Scans and grounds scored: made by hand, and a car's drive in the layout it is recorded in."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep
from epiline.cli import main
from epiline.evaluation.obstacles import FrameTruth, Rules
from epiline.evaluation.obstacles.ground import (
    GroundRun,
    GroundSample,
    car_geometry,
    ground_figures,
    ground_sample,
    is_car_sequence,
)
from epiline.evaluation.obstacles.own_motion import nod_rad
from epiline.evaluation.obstacles.scans import ScanScore, scan_figures, score_scan
from epiline.evaluation.obstacles.truth import NOTHING
from epiline.sources.rendered import world_from_optical

NAN = np.float32("nan")
DIRECTIONS, ROWS = 40, 30
ANGLES = np.linspace(-0.4, 0.4, DIRECTIONS, dtype=np.float32)
BOX, BOX_M, WALL, WALL_M = 6, 2.0, 2, 5.0
AT_BOX = slice(10, 15)


@dataclass
class Said:
    """What a scan says; for `ep.Scan` has no constructor."""

    angle_rad: NDArray[np.float32]
    seen: NDArray[np.uint8]
    nearest_m: NDArray[np.float32]
    sigma_m: NDArray[np.float32]
    free_from_m: NDArray[np.float32]
    free_to_m: NDArray[np.float32]


def world() -> tuple[FrameTruth, NDArray[np.float64], NDArray[np.float64]]:
    """A column per direction: floor, over it a wall at 5 m, before it a box at 2 m in five directions."""
    standing = np.full((ROWS, DIRECTIONS), WALL, np.int16)
    standing[20:] = NOTHING
    distance = np.full((ROWS, DIRECTIONS), WALL_M)
    distance[20:] = np.linspace(4, 1, 10)[:, None]
    standing[10:25, AT_BOX], distance[10:25, AT_BOX] = BOX, BOX_M
    height = np.where(standing == NOTHING, 0.0, 0.5)
    angle = np.broadcast_to(ANGLES.astype(float), distance.shape)
    seen = np.ones(distance.shape, bool)
    names = ("floor", "ceiling", "front wall", "back wall", "left wall", "right wall", "box")
    truth = FrameTruth(distance, distance, distance * angle, height, standing, seen, names, frozenset({BOX}))
    return truth, angle, distance


def said() -> Said:
    """What a perfect scan says of it."""
    nearest = np.full(DIRECTIONS, WALL_M, np.float32)
    nearest[AT_BOX] = BOX_M
    one = np.ones(DIRECTIONS, np.float32)
    return Said(ANGLES, np.full(DIRECTIONS, 2, np.uint8), nearest, 0.02 * one, one, nearest.copy())


def score(scan: Said, truth: FrameTruth | None = None) -> ScanScore:
    known, angle, distance = world()
    return score_scan(cast(ep.Scan, scan), truth or known, angle, distance, Rules())


def test_a_perfect_scan() -> None:
    found = score(said())
    assert (found.directions, found.asked, found.free_claimed) == (40, 40, 40)
    assert (found.missed, found.false_near, found.free_wrong, found.unknown) == (0, 0, 0, 0)
    assert (found.misled, found.ghosts) == (0, 0)


def test_free_behind_an_obstacle_is_wrong_though_the_obstacle_is_unknown() -> None:
    scan = said()
    scan.free_to_m[AT_BOX] = WALL_M
    assert score(scan).free_wrong == 5
    # Unknown where the box stands, but no free stretch reaches it: nothing wrong is said.
    quiet = said()
    quiet.nearest_m[AT_BOX], quiet.seen[AT_BOX], quiet.free_to_m[AT_BOX] = NAN, 0, 1.5
    found = score(quiet)
    assert (found.free_wrong, found.unknown, found.missed, found.misled) == (0, 5, 5, 0)
    # What the right camera cannot see is not asked for, but it is not free either.
    truth = world()[0]
    hidden = replace(truth, seen=truth.seen & (truth.standing != BOX))
    scan.nearest_m[AT_BOX] = WALL_M
    assert score(scan, hidden).missed == 0
    assert score(scan, hidden).free_wrong == 5


def test_no_free_stretch_is_no_claim() -> None:
    scan = said()
    scan.free_to_m[:] = NAN
    assert (score(scan).free_claimed, score(scan).free_wrong) == (0, 0)
    scan.free_to_m[:] = scan.free_from_m
    assert score(scan).free_claimed == 0


@pytest.mark.parametrize(("off_m", "missed", "near"), [(0.05, 0, 0), (-0.05, 0, 0), (0.4, 5, 0), (-0.4, 0, 5)])
def test_too_far_is_missed_and_too_near_is_false(off_m: float, missed: int, near: int) -> None:
    scan = said()
    scan.nearest_m[AT_BOX] += np.float32(off_m)
    assert (score(scan).missed, score(scan).false_near) == (missed, near)


def test_a_missed_obstacle_that_is_not_unknown_misleads() -> None:
    farther, nothing, reaching = said(), said(), said()
    for scan in (nothing, reaching):
        scan.nearest_m[AT_BOX], scan.free_to_m[AT_BOX] = NAN, 1.5
    farther.nearest_m[AT_BOX], farther.free_to_m[AT_BOX] = WALL_M, 1.5
    nothing.seen[AT_BOX] = 1
    reaching.seen[AT_BOX], reaching.free_to_m[AT_BOX] = 0, 2.3
    for scan in (farther, nothing, reaching):
        assert (score(scan).missed, score(scan).misled) == (5, 5)


def test_what_is_reported_wider_than_it_is_is_no_ghost() -> None:
    """The box reaches from direction 10 to 14."""
    wider, elsewhere = said(), said()
    wider.nearest_m[[6, 18]] = BOX_M
    elsewhere.nearest_m[[5, 19]] = BOX_M
    assert (score(wider).false_near, score(wider).ghosts) == (2, 0)
    assert (score(elsewhere).false_near, score(elsewhere).ghosts) == (2, 2)
    nearer = said()
    nearer.nearest_m[12] = BOX_M / 2
    assert (score(nearer).false_near, score(nearer).ghosts) == (1, 1)


def test_what_is_driven_over_or_passed_under_is_not_asked_for() -> None:
    truth, scan = world()[0], said()
    scan.nearest_m[AT_BOX] = WALL_M
    for height_m in (0.03, 2.4):
        other = replace(truth, height_m=np.where(truth.standing == BOX, height_m, truth.height_m))
        assert score(scan, other).missed == 0
    assert score(scan).missed == 5


def test_figures_of_scans() -> None:
    figures = scan_figures(
        [
            ScanScore(
                directions=10,
                free_claimed=8,
                free_wrong=2,
                unknown=1,
                asked=5,
                missed=3,
                misled=1,
                false_near=0,
                ghosts=0,
            ),
            ScanScore(
                directions=10,
                free_claimed=0,
                free_wrong=0,
                unknown=3,
                asked=5,
                missed=0,
                misled=0,
                false_near=2,
                ghosts=1,
            ),
        ]
    )
    assert figures["scan_free_wrong"] == 25
    assert figures["scan_missed"] == 30
    assert figures["scan_misled"] == 10
    assert figures["scan_false_near"] == 10
    assert figures["scan_ghosts"] == 5
    assert figures["scan_unknown"] == 20


def test_the_ground_of_a_camera_held_at_an_angle() -> None:
    """A floor written into a disparity map from the pose; what is found is then the pose."""
    pose = world_from_optical((0.3, -0.2, 0.6), 0.4, 0.12, 0.05)
    geometry = ep.RectifiedGeometry(width=320, height=240, focal_px=300, cx_px=161, cy_px=118, baseline_m=0.12)
    x, y = np.meshgrid((np.arange(320) - 161) / 300, (np.arange(240) - 118) / 300)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ pose[:3, :3].T
    with np.errstate(divide="ignore"):
        depth = np.where(rays[..., 2] < 0, -0.6 / rays[..., 2], np.inf)
    raw = np.round(16 * 36 / depth)
    disparity = ep.DisparityMap(raw.clip(0, 1023).astype(np.uint16), (raw < 16).astype(np.uint8))
    sample = ground_sample(ep.GroundEstimator()(disparity, geometry), pose)
    assert sample.true_height_m == 0.6
    assert abs(sample.height_m) < 0.005
    assert abs(sample.pitch_rad) < 0.002
    assert abs(sample.roll_rad) < 0.002
    tilted = ground_sample(ep.GroundEstimator()(disparity, geometry), world_from_optical((0, 0, 0.6), 0, 0.10, 0.0))
    assert tilted.pitch_rad == pytest.approx(0.02, abs=0.003)
    assert tilted.roll_rad == pytest.approx(0.05, abs=0.003)
    figures = ground_figures([sample, ground_sample(None, pose)])
    assert figures["ground_found"] == 50
    assert figures["height_p95"] < 1
    sigmas = (0.004, 0.01, 0.1)
    off = [GroundSample(0.6, 0.006, -0.009, 0.3, sigmas), GroundSample(0.6, 0.003, 0.021, 0.05, sigmas)]
    figures = ground_figures(off)
    assert [figures[f"{name}_within_1"] for name in ("height", "pitch", "roll")] == [50, 50, 50]
    assert [figures[f"{name}_within_2"] for name in ("height", "pitch", "roll")] == [100, 50, 50]


def test_steadiness_of_a_run() -> None:
    run = GroundRun(np.array([1.0, 1.1, 1.0, np.nan]), np.deg2rad([2.0, 2.0, 2.5, np.nan]), np.zeros(4))
    figures = run.steadiness()
    assert (figures["frames"], figures["found"], figures["camera_height_m"]) == (4, 75, 1.0)
    assert figures["height_off_worst"] == pytest.approx(10)
    assert figures["pitch_off_worst"] == pytest.approx(0.5)
    assert figures["pitch_off_median"] == 0
    assert "pitch_off_worst" not in GroundRun.of([None, None]).steadiness()


def test_the_nodding_of_a_vehicle_is_no_noise_of_its_ground() -> None:
    turned = np.deg2rad(2 * np.sin(np.arange(40)))
    frames = np.linspace(0, 1, 40)
    pitch = turned + np.deg2rad(5 + frames - 2 * frames**3)
    run = GroundRun(np.ones(40), pitch, np.zeros(40), turned)
    assert run.steadiness()["pitch_off_p90"] > 1
    assert run.steadiness()["pitch_less_nod_off_worst"] < 1e-6
    pitch[17] += np.deg2rad(1)
    assert run.steadiness()["pitch_less_nod_off_worst"] == pytest.approx(0.9, abs=0.1)
    one = GroundRun(np.ones(1), np.zeros(1), np.zeros(1), np.zeros(1))
    assert one.steadiness()["pitch_less_nod_off_worst"] == 0


def test_a_nod_is_told_from_driving_on() -> None:
    """Panels at 15 and 75 m, whose lower half is dark, seen by a camera that turns down and drives on."""
    rng = np.random.default_rng(3)
    before = cv2.GaussianBlur(rng.integers(0, 256, (240, 320), np.uint8), (0, 0), 1.5)
    before[120:] = 0
    near = np.arange(320) // 80 % 2 == 0
    geometry = ep.RectifiedGeometry(width=320, height=240, focal_px=300, cx_px=161, cy_px=118, baseline_m=0.5)
    raw = np.tile(np.where(near, 16 * 10, 16 * 2).astype(np.uint16), (240, 1))
    disparity = ep.DisparityMap(raw, np.zeros((240, 320), np.uint8))
    camera = np.array([[300, 0, 161], [0, 300, 118], [0, 0, 1.0]])
    for down_rad, ahead_m in ((0.0, 0.0), (0.01, 0.0), (-0.004, 0.0), (0.0, 1.0), (0.006, 1.0)):
        turn = cv2.Rodrigues(np.array([down_rad, 0.0, 0.0]))[0]
        after = np.zeros_like(before)
        for panels, depth_m in ((~near, 75.0), (near, 15.0)):
            come = np.diag([1.0, 1.0, 1 - ahead_m / depth_m])
            moved = camera @ turn @ come @ np.linalg.inv(camera)
            seen = cv2.warpPerspective(np.tile(panels.astype(np.uint8), (240, 1)), moved, (320, 240)) > 0
            after[seen] = cv2.warpPerspective(before, moved, (320, 240))[seen]
        assert nod_rad(before, after, disparity, geometry) == pytest.approx(down_rad, abs=3e-4)
    assert np.isnan(nod_rad(np.zeros_like(before), np.zeros_like(before), disparity, geometry))


def test_a_drive_of_a_car_is_recognised_and_scored(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recorded = data / "karlsruhe_2010_03_09_drive_0023"
    if not recorded.is_dir():
        pytest.skip(f"no {recorded}")
    drive = tmp_path / "drive"
    for side in ("left", "right"):
        (drive / side).mkdir(parents=True)
        for number in range(3):
            (drive / side / f"{number:06}.png").symlink_to(recorded / side / f"{number:06}.png")
    (drive / "calib.txt").write_text((recorded / "calib.txt").read_text())
    assert is_car_sequence(drive)
    height, width = cv2.imread(str(drive / "left" / "000000.png")).shape[:2]
    assert car_geometry(drive, (width, height)).baseline_m == pytest.approx(0.5707, abs=1e-4)
    assert main(["evaluate", "--obstacles", str(drive), "--preset", "fast", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["ground"]
    assert row["frames"] == 3
    assert 1.0 < row["camera_height_m"] < 2.5
    assert row["pitch_less_nod_off_worst"] < 0.3
    (drive / "calib.txt").write_text("P1_roi: 1 2 3\n")
    assert main(["evaluate", "--obstacles", str(drive), "--preset", "fast"]) == 1
    assert "calib.txt: no P1_roi and P2_roi" in capsys.readouterr().err
