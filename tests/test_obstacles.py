"""Obstacles and ground from Python, held to worlds traced with NumPy; the core's own tests hold the parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep

Floats = NDArray[np.float64]
WIDTH, HEIGHT, FOCAL_PX, BASELINE_M = 320, 240, 300.0, 0.12


@pytest.fixture
def geometry() -> ep.RectifiedGeometry:
    return ep.RectifiedGeometry(
        width=WIDTH, height=HEIGHT, focal_px=FOCAL_PX, cx_px=159.5, cy_px=119.5, baseline_m=BASELINE_M
    )


@dataclass(frozen=True)
class Upright:
    """A board across the way: how far ahead, from where to where to the right, and how high, metres."""

    ahead_m: float
    left_m: float
    right_m: float
    up_m: float


def trace(
    boards: list[Upright],
    *,
    camera_height_m: float = 0.5,
    pitch_rad: float = 0.0,
    roll_rad: float = 0.0,
    wall_m: float = 9,
) -> tuple[Floats, NDArray[np.int16]]:
    """Depth and what is seen (-2 wall, -1 floor, or a board's index) of every pixel."""
    down = np.array([np.cos(pitch_rad) * np.sin(roll_rad), np.cos(pitch_rad) * np.cos(roll_rad), np.sin(pitch_rad)])
    ahead = np.array([0, 0, 1]) - down * down[2]
    ahead /= np.linalg.norm(ahead)
    right = np.cross(down, ahead)
    x, y = np.meshgrid((np.arange(WIDTH) - 159.5) / FOCAL_PX, (np.arange(HEIGHT) - 119.5) / FOCAL_PX)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1)
    with np.errstate(divide="ignore"):
        depth = wall_m / (rays @ ahead)
        seen = np.full(depth.shape, -2, np.int16)
        floor = np.where(rays @ down > 0, camera_height_m / (rays @ down), np.inf)
        depth, seen = np.where(floor < depth, floor, depth), np.where(floor < depth, -1, seen).astype(np.int16)
        for index, board in enumerate(boards):
            at = board.ahead_m / (rays @ ahead)
            aside, up = at * (rays @ right), camera_height_m - at * (rays @ down)
            hit = (aside >= board.left_m) & (aside < board.right_m) & (up >= 0) & (up <= board.up_m) & (at < depth)
            depth, seen = np.where(hit, at, depth), np.where(hit, index, seen).astype(np.int16)
    return depth, seen


def as_disparity(depth_m: Floats, rng: np.random.Generator | None = None) -> ep.DisparityMap:
    """What a matcher makes of it: with `rng` noise, gaps and mismatches."""
    disparity = FOCAL_PX * BASELINE_M / depth_m
    validity = np.zeros(depth_m.shape, np.uint8)
    if rng is not None:
        disparity += rng.normal(0, 0.2, disparity.shape)
        wrong = rng.random(disparity.shape) < 0.02
        disparity[wrong] = rng.uniform(1, 60, int(wrong.sum()))
        validity[rng.random(disparity.shape) < 0.15] = 16
    return ep.DisparityMap(np.round(16 * disparity).clip(0, 2000).astype(np.uint16), validity, num_disparities=126)


BOX, POLE = Upright(3.0, -0.9, -0.3, 0.7), Upright(1.5, 0.2, 0.26, 1.2)


def test_box_and_pole_but_neither_floor_nor_far_wall(geometry: ep.RectifiedGeometry) -> None:
    pole, box = ep.find_obstacles(as_disparity(trace([BOX, POLE])[0]), geometry, max_range_m=8)
    assert [pole.id, box.id] == [0, 1]
    assert pole.region == box.region == "image"
    assert pole.regions == box.regions == ["image"]
    assert pole.depth_m == pytest.approx(1.5, rel=0.01)
    assert box.depth_m == pytest.approx(3.0, rel=0.01)
    # The nearest points are the edges on the side of the optical axis.
    assert pole.bearing_rad == pytest.approx(np.arctan(0.2 / 1.5), abs=0.01)
    assert box.bearing_rad == pytest.approx(np.arctan(-0.3 / 3), abs=0.01)
    assert pole.width_m == pytest.approx(0.06, abs=0.01)
    assert box.width_m == pytest.approx(0.6, abs=0.03)
    assert box.range_m == pytest.approx(np.hypot(3.0, 0.3), rel=0.01)
    assert 0 < pole.sigma_m < 0.03 < box.sigma_m < 0.12
    assert box.height_above_ground_m == pytest.approx(0.7, abs=0.03)
    assert box.height_m == pytest.approx(0.7, abs=0.06)
    x, _, width, _ = box.box
    assert abs(x - 69.5) <= 2
    assert abs(width - 60) <= 3
    assert box.support > 0.9 * 60 * 66


def test_random_worlds_are_told_completely_and_nothing_else(geometry: ep.RectifiedGeometry) -> None:
    asked = found = reports = real = 0
    heights = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        pose = {
            "camera_height_m": rng.uniform(0.4, 0.8),
            "pitch_rad": rng.uniform(0, 0.2),
            "roll_rad": rng.uniform(-0.05, 0.05),
        }
        boards = []
        for sector in range(3):
            ahead = rng.uniform(1.3, 4.0)
            left = (sector - 1.4) * 0.33 * ahead
            kind = rng.integers(3)
            width, up = ((0.06, 1.0), (0.25 * ahead, 0.08), (rng.uniform(0.15, 0.3) * ahead, rng.uniform(0.3, 0.9)))[
                kind
            ]
            if kind == 1 and ahead > 2.2:
                # A kerb farther away than this has too few rows in so small an image.
                up = 0.2
            boards.append(Upright(ahead, left, left + width, up))
        depth, seen = trace(boards, **pose)
        disparity = as_disparity(depth, rng)
        ground = ep.GroundEstimator()(disparity, geometry)
        assert ground is not None
        heights.append(ground.camera_height_m / pose["camera_height_m"] - 1)
        obstacles = ep.find_obstacles(disparity, geometry, ground=ground, max_range_m=7)
        reports += len(obstacles)
        matched = set()
        for o in obstacles:
            x, _, width, _ = o.box
            near = (np.abs(depth - o.depth_m) < 0.05 * o.depth_m)[:, x : x + width]
            ids, counts = np.unique(seen[:, x : x + width][near & (seen[:, x : x + width] >= 0)], return_counts=True)
            real += bool(counts.sum() >= 8)
            matched |= set(ids[counts >= 8].tolist())
        visible = {i for i in range(len(boards)) if (seen == i).sum() >= 60}
        asked += len(visible)
        found += len(visible & matched)
    assert asked > 60
    assert found >= 0.95 * asked, f"{found} of {asked}"
    assert real >= 0.97 * reports, f"{real} of {reports}"
    assert np.abs(heights).max() < 0.03
    assert abs(np.mean(heights)) < 0.01


def test_one_obstacle_however_many_regions(geometry: ep.RectifiedGeometry) -> None:
    disparity = as_disparity(trace([BOX])[0])
    left = ep.Region("left", x=0, y=60, width=150, height=80)
    both = ep.Region("both", x=0, y=60, width=320, height=80)
    beside = ep.Region("beside", x=200, y=0, width=120, height=240)
    (box,) = ep.find_obstacles(disparity, geometry, regions=(beside, left, both), max_range_m=8)
    assert box.regions == ["left", "both"]
    assert box.region == "left"
    assert ep.find_obstacles(disparity, geometry, regions=[beside], max_range_m=8) == []
    assert ep.find_obstacles(disparity, geometry, regions=[], max_range_m=8) == []


def test_nothing_valid_is_nothing_found_and_no_ground(geometry: ep.RectifiedGeometry) -> None:
    nothing = ep.DisparityMap(np.full((240, 320), 300, np.uint16), np.ones((240, 320), np.uint8))
    assert ep.find_obstacles(nothing, geometry) == []
    estimator = ep.GroundEstimator()
    assert estimator(nothing, geometry) is None
    assert estimator.reason == "too few pixels have a disparity"


def test_a_wall_without_texture_is_not_known(geometry: ep.RectifiedGeometry) -> None:
    """What has no disparity is no obstacle, and what is before it is one all the same."""
    depth, seen = trace([BOX], wall_m=4.0)
    blank = as_disparity(depth)
    validity = np.where(seen == -2, 16, 0).astype(np.uint8)
    (box,) = ep.find_obstacles(ep.DisparityMap(blank.raw, validity, num_disparities=126), geometry)
    assert box.depth_m == pytest.approx(3.0, rel=0.01)


def test_the_ground_is_a_pose_and_heights(geometry: ep.RectifiedGeometry) -> None:
    depth, _ = trace([BOX], camera_height_m=0.7, pitch_rad=0.15, roll_rad=-0.04)
    disparity = as_disparity(depth)
    estimator = ep.GroundEstimator(mounting=ep.Mounting(0.7, pitch_rad=0.15, pitch_sigma_rad=0.05, roll_sigma_rad=0.05))
    ground = estimator(disparity, geometry)
    assert ground is not None
    assert estimator.reason is None
    assert ground.camera_height_m == pytest.approx(0.7, rel=0.01)
    assert ground.pitch_rad == pytest.approx(0.15, abs=0.003)
    assert ground.roll_rad == pytest.approx(-0.04, abs=0.003)
    assert 0 < ground.camera_height_sigma_m < 0.02
    assert 0 < ground.pitch_sigma_rad < 0.005
    assert 0 < ground.roll_sigma_rad < 0.005
    assert 0.2 < ground.support_share <= 1
    np.testing.assert_allclose(ground.down, [-0.0395, 0.988, 0.1494], atol=0.004)
    floor_px = ground.disparity_px(160, 220)
    assert floor_px is not None
    assert floor_px == pytest.approx(FOCAL_PX * BASELINE_M / depth[220, 160], abs=0.15)
    assert ground.height_m(160, 220, floor_px) == pytest.approx(0, abs=1e-3)
    assert ground.disparity_px(160, 0) is None
    depths_m, rises_m = ground.profile_m.T
    assert (np.diff(depths_m) > 0).all()
    assert np.abs(rises_m[depths_m < 6]).max() < 0.05
    with pytest.raises(ValueError, match=r"mounting\.camera_height_m = -1 m"):
        ep.GroundEstimator(mounting=ep.Mounting(-1))
    with pytest.raises(ValueError, match="max_roll_rad = 2 rad"):
        ep.GroundEstimator(max_roll_rad=2)
    with pytest.raises(ValueError, match="3x3"):
        estimator(ep.DisparityMap(np.zeros((3, 3), np.uint16), np.zeros((3, 3), np.uint8)), geometry)


def test_the_paper_clusters_what_is_nearer_than_around(geometry: ep.RectifiedGeometry) -> None:
    boards = [Upright(2.0, -0.6, -0.2, 0.9), Upright(2.6, 0.4, 0.9, 0.9)]
    depth, seen = trace(boards, wall_m=5.0)
    raw = as_disparity(depth).raw
    without_floor = ep.DisparityMap(raw, np.where(seen == -1, 16, 0).astype(np.uint8), num_disparities=126)
    one, other = ep.find_obstacles(without_floor, geometry, method="paper")
    assert one.depth_m == pytest.approx(2.0, rel=0.01)
    assert other.depth_m == pytest.approx(2.6, rel=0.01)
    assert one.height_above_ground_m is None
    # An oracle of equation 7 and connected components.
    scipy_ndimage = pytest.importorskip("scipy.ndimage")
    known = (seen != -1).astype(float)
    near = known * raw / 16
    u, v = np.meshgrid(np.fft.fftfreq(WIDTH, 1 / WIDTH), np.fft.fftfreq(HEIGHT, 1 / HEIGHT))
    response = np.exp(-(u**2 + v**2) / (2 * 3.0**2))
    around, weight = (np.fft.ifft2(np.fft.fft2(image) * response).real for image in (near, known))
    bright = (near > around / np.maximum(weight, 1e-3) + 1.0) & (known > 0)
    labels, _ = scipy_ndimage.label(bright)
    sizes = np.sort(np.bincount(labels.ravel())[1:])[::-1]
    assert abs(max(one.support, other.support) - sizes[0]) <= 0.02 * sizes[0]
    assert abs(min(one.support, other.support) - sizes[1]) <= 0.02 * sizes[1]


def test_bad_parameters_are_named(geometry: ep.RectifiedGeometry) -> None:
    disparity = as_disparity(trace([BOX])[0])
    with pytest.raises(ValueError, match="max_range_m = 0 m"):
        ep.find_obstacles(disparity, geometry, max_range_m=0)
    with pytest.raises(ValueError, match="min_support = -3"):
        ep.find_obstacles(disparity, geometry, min_support=-3)
    with pytest.raises(ValueError, match="step_m = -1 m"):
        ep.find_obstacles(disparity, geometry, step_m=-1)
    with pytest.raises(ValueError, match=r"headroom_m = 0\.01 m"):
        ep.find_obstacles(disparity, geometry, headroom_m=0.01)
    with pytest.raises(ValueError, match="method = 'magic'"):
        ep.find_obstacles(disparity, geometry, method="magic")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="ground = 'flat'"):
        ep.find_obstacles(disparity, geometry, ground="flat")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'r'"):
        ep.find_obstacles(disparity, geometry, regions=[ep.Region("r", x=0, y=0, width=0, height=1)])
