"""The scan, held to worlds whose every ray is traced here: boxes on a floor, with and without texture."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep

LOW_TEXTURE = 16
UNKNOWN, NOTHING, OBSTACLE = 0, 1, 2
GEOMETRY = ep.RectifiedGeometry(width=320, height=240, focal_px=300, cx_px=161.3, cy_px=118.6, baseline_m=0.12)
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Box:
    """Axis-aligned in the robot's frame, metres: x forward, y left, z up."""

    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]
    textured: bool = True


@dataclass(frozen=True)
class World:
    boxes: tuple[Box, ...] = ()
    mounting: ep.RobotFromCamera = field(default_factory=lambda: ep.RobotFromCamera(0.5))
    bare_floor: tuple[float, float] = (np.inf, np.inf)
    """Distances forward between which the floor has no texture."""
    ramp: tuple[float, float] = (np.inf, 0.0)
    """Where the floor begins to rise, and by how much per metre."""

    def trace(self) -> tuple[Floats, NDArray[np.bool_]]:
        """Depth Z of every pixel, infinite where there is nothing, and whether it has texture."""
        height, width = GEOMETRY.height, GEOMETRY.width
        x, y = np.meshgrid(np.arange(width) - GEOMETRY.cx_px, np.arange(height) - GEOMETRY.cy_px)
        rays = np.stack([x / GEOMETRY.focal_px, y / GEOMETRY.focal_px, np.ones_like(x)], axis=-1)
        pose = self.mounting.robot_from_camera
        rays, origin = rays @ pose[:3, :3].T, pose[:3, 3]
        depth, textured = np.full((height, width), np.inf), np.zeros((height, width), bool)

        def see(at: Floats, mask: NDArray[np.bool_], texture: NDArray[np.bool_] | bool) -> None:
            nearer = mask & (at > 0) & (at < depth)
            depth[nearer] = at[nearer]
            textured[nearer] = np.broadcast_to(texture, depth.shape)[nearer]

        with np.errstate(divide="ignore", invalid="ignore"):
            at = -origin[2] / rays[..., 2]
            ahead = origin[0] + at * rays[..., 0]
            bare = (ahead > self.bare_floor[0]) & (ahead < self.bare_floor[1])
            see(at, (rays[..., 2] < 0) & (ahead < self.ramp[0]), ~bare)
            begin, slope = self.ramp
            at = (slope * (origin[0] - begin) - origin[2]) / (rays[..., 2] - slope * rays[..., 0])
            see(at, origin[0] + at * rays[..., 0] >= begin, True)
            for box in self.boxes:
                sides = np.array([box.x, box.y, box.z])
                low = (sides[:, 0] - origin) / rays
                high = (sides[:, 1] - origin) / rays
                enter = np.minimum(low, high).max(axis=-1)
                leave = np.maximum(low, high).min(axis=-1)
                see(enter, enter <= leave, box.textured)
        return depth, textured

    def disparity(self, *, noise_px: float = 0.0, seed: int = 0, num_disparities: int = 64) -> ep.DisparityMap:
        depth, textured = self.trace()
        px = GEOMETRY.focal_px * GEOMETRY.baseline_m / depth
        px = px + np.random.default_rng(seed).normal(0, noise_px, px.shape) if noise_px else px
        seen = textured & (px >= 0) & (px < num_disparities)
        raw = np.round(16 * np.where(seen, px, 0)).astype(np.uint16)
        return ep.DisparityMap(raw, np.where(seen, 0, LOW_TEXTURE).astype(np.uint8), num_disparities=num_disparities)

    def scan(self, *, noise_px: float = 0.0, seed: int = 0, **parameters: float) -> ep.Scan:
        disparity = self.disparity(noise_px=noise_px, seed=seed)
        return ep.scan(disparity, GEOMETRY, mounting=self.mounting, **{"step_m": 0.1, **parameters})

    def standing_m(self, angles_rad: Floats, *, above_m: float = 0.1) -> Floats:
        """For directions from the camera's foot, the distance to the nearest box that is higher than that."""
        origin = self.mounting.robot_from_camera[:2, 3]
        rays = np.stack([np.cos(angles_rad), np.sin(angles_rad)], axis=-1).astype(np.float64)
        nearest = np.full(len(rays), np.inf)
        with np.errstate(divide="ignore"):
            for box in (box for box in self.boxes if box.z[1] >= above_m):
                sides = np.array([box.x, box.y])
                low, high = (sides[:, 0] - origin) / rays, (sides[:, 1] - origin) / rays
                enter, leave = np.minimum(low, high).max(axis=-1), np.maximum(low, high).min(axis=-1)
                nearest = np.where((enter <= leave) & (enter > 0), np.minimum(nearest, enter), nearest)
        return nearest


WALL = Box(x=(5, 6), y=(-50, 50), z=(0, 3))


def test_a_wall_is_an_obstacle_and_the_floor_before_it_is_free() -> None:
    world = World((WALL,))
    scan = world.scan()
    assert len(scan) == GEOMETRY.width
    assert (np.diff(scan.angle_rad) > 0).all()
    assert (scan.seen == OBSTACLE).all()
    true_m = world.standing_m(scan.angle_rad)
    np.testing.assert_allclose(scan.nearest_m, true_m, rtol=0.01)
    np.testing.assert_allclose(scan.free_to_m, true_m, rtol=0.01)
    # The lowest row sees the floor at f·H/(239 - cy), longer to the sides.
    ahead_m = 300 * 0.5 / (239 - 118.6)
    np.testing.assert_allclose(scan.free_from_m, ahead_m / np.cos(scan.angle_rad), rtol=0.01)
    sigma_m = 5.0**2 * 0.25 / 36 / np.cos(scan.angle_rad)
    np.testing.assert_allclose(scan.sigma_m, sigma_m, rtol=0.05)


def test_a_wall_without_texture_is_unknown_and_never_free() -> None:
    world = World((Box(x=(5, 6), y=(-50, 50), z=(0, 3), textured=False),))
    scan = world.scan()
    assert (scan.seen == UNKNOWN).all()
    assert np.isnan(scan.nearest_m).all()
    true_m = world.standing_m(scan.angle_rad)
    assert (scan.free_to_m <= true_m * 1.001).all()
    assert (scan.free_to_m >= true_m * 0.85).all()
    laser = scan.to_laser_scan()
    assert np.isnan(laser["ranges"]).all()


def test_a_floor_seen_as_far_as_was_looked_has_nothing_in_range() -> None:
    scan = World().scan(max_range_m=4)
    assert (scan.seen == NOTHING).all()
    assert np.isposinf(scan.to_laser_scan()["ranges"]).all()
    assert np.isposinf(scan.to_clearing_scan()["ranges"]).all()
    np.testing.assert_allclose(scan.free_to_m, 4, rtol=1e-5)


def test_the_floor_is_free_no_farther_than_something_low_would_stand_out() -> None:
    scan = World().scan(max_range_m=100, step_m=0.1)
    assert (scan.seen == UNKNOWN).all()
    # 0.1 m on a floor 0.5 m below is a quarter of the floor's disparity, which must be 3 sigma.
    assert (scan.free_to_m <= 36 / 3.0 / np.cos(scan.angle_rad) * 1.001).all()
    assert (scan.free_to_m > 5).all()


@pytest.mark.parametrize(("end_m", "is_bridged"), [(2.2, True), (2.9, False)])
def test_a_bare_patch_is_crossed_only_if_nothing_that_matters_fits_in(end_m: float, is_bridged: bool) -> None:
    """0.1 m at 2 m hides a floor 0.5 m below up to 2·0.5/0.4 = 2.5 m."""
    scan = World(bare_floor=(2.0, end_m)).scan(max_range_m=4, gap_guard_px=0)
    assert (scan.seen == (NOTHING if is_bridged else UNKNOWN)).all()
    if not is_bridged:
        assert (scan.free_to_m * np.cos(scan.angle_rad) <= 2.0).all()


def test_a_floor_without_texture_is_not_free_before_a_wall() -> None:
    scan = World((WALL,), bare_floor=(0.0, 9.0)).scan()
    assert (scan.seen == OBSTACLE).all()
    assert np.isnan(scan.free_to_m).all()
    assert np.isnan(scan.to_clearing_scan()["ranges"]).all()
    np.testing.assert_allclose(np.nanmin(scan.to_laser_scan()["ranges"]), 5, rtol=0.01)


@pytest.mark.parametrize(("pitch_deg", "roll_deg", "yaw_deg"), [(25, 0, 0), (25, 6, 20), (-8, -10, -30), (0, 12, 0)])
def test_a_tilted_camera_sees_things_as_wide_and_as_far_as_they_are(
    pitch_deg: float, roll_deg: float, yaw_deg: float
) -> None:
    """depth_nav_tools#17: after compensating the tilt, obstacles off the middle came out narrower."""
    roll, pitch, yaw = np.radians([roll_deg, pitch_deg, yaw_deg])
    mounting = ep.RobotFromCamera(0.7, x_m=0.3, y_m=-0.1, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)
    # One box straight ahead of the camera, one to each side, at 2.2 m from its foot.
    boxes = []
    for off in (-0.35, 0.0, 0.35):
        angle = yaw + off
        x, y = 0.3 + 2.2 * np.cos(angle), -0.1 + 2.2 * np.sin(angle)
        boxes.append(Box(x=(x - 0.15, x + 0.15), y=(y - 0.15, y + 0.15), z=(0, 0.5)))
    world = World(tuple(boxes), mounting)
    scan = world.scan(max_range_m=6)
    true_m = world.standing_m(scan.angle_rad)
    seen = np.isfinite(scan.nearest_m)
    standing = np.isfinite(true_m)
    # An edge may be off by a direction or two.
    assert (seen != standing).sum() <= 12, (seen & ~standing).sum()
    both = seen & standing
    assert both.sum() > 60
    np.testing.assert_allclose(scan.nearest_m[both], true_m[both], rtol=0.03)
    assert (np.nan_to_num(scan.free_to_m[both]) <= true_m[both] * 1.03).all()
    points = scan.obstacle_points_m()
    for box in boxes:
        near = points[np.hypot(points[:, 0] - np.mean(box.x), points[:, 1] - np.mean(box.y)) < 0.35]
        # From its front face; the side that is turned towards the camera may lie behind it.
        assert len(near) > 15
        assert near[:, 0].min() > box.x[0] - 0.1
        assert near[:, 0].max() < box.x[1] + 0.1


def test_a_ramp_is_free_until_it_is_as_high_as_what_matters() -> None:
    scan = World(ramp=(2.0, 0.2)).scan(max_range_m=4)
    ahead = scan.free_to_m * np.cos(scan.angle_rad)
    assert (scan.seen != NOTHING).all()
    assert (ahead <= 2.51).all()
    assert (ahead >= 1.9).all()


def test_what_the_robot_passes_under_does_not_stand_in_the_way() -> None:
    shelf = Box(x=(2.0, 2.6), y=(-3, 3), z=(0.75, 0.95))
    low = World((shelf,)).scan(max_range_m=3, headroom_m=0.6)
    assert (low.seen != OBSTACLE).all()
    tall = World((shelf,)).scan(max_range_m=3, headroom_m=1.2)
    assert (tall.seen == OBSTACLE).mean() > 0.95
    np.testing.assert_allclose(np.nanmin(tall.nearest_m), 2.0, rtol=0.02)


def test_free_never_reaches_behind_anything_that_stands() -> None:
    """Random rooms, half of their boxes without texture, noise of a quarter pixel, cameras tilted as they come."""
    seen_free, checked = 0.0, 0
    for seed in range(24):
        random = np.random.default_rng(seed)
        boxes = []
        for _ in range(random.integers(1, 6)):
            x, y = random.uniform(1.2, 6), random.uniform(-2, 2)
            width, depth, height = random.uniform(0.05, 0.8), random.uniform(0.1, 0.5), random.uniform(0.13, 1.2)
            boxes.append(Box((x, x + depth), (y, y + width), (0, height), textured=bool(random.uniform() < 0.5)))
        roll, pitch, yaw = random.uniform(-0.1, 0.1), random.uniform(-0.1, 0.4), random.uniform(-0.5, 0.5)
        world = World(tuple(boxes), ep.RobotFromCamera(0.5, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw))
        scan = world.scan(noise_px=0.25, seed=seed)
        true_m = world.standing_m(scan.angle_rad)
        free_m = np.nan_to_num(scan.free_to_m, nan=0.0)
        # Two directions at the edge of a box may see past it.
        inside = np.minimum.reduce([np.roll(true_m, k) for k in (-2, -1, 0, 1, 2)]) == true_m
        # Two standard deviations of a disparity, and what edges of pixels make of a distance.
        sigma_m = np.where(inside, true_m, 0) ** 2 * 0.25 / 36
        beyond = inside & (free_m > true_m * 1.02 + 2 * sigma_m)
        assert not beyond.any(), (seed, free_m[beyond], true_m[beyond])
        seen_free += float(np.minimum(free_m, true_m).sum())
        checked += int(np.isfinite(true_m).sum())
    assert checked > 1000
    assert seen_free > 5000


def test_laser_scans_have_equal_angles_and_the_values_of_rep_117() -> None:
    world = World((Box((2, 2.3), (0.2, 0.8), (0, 0.6)), Box((3, 3.3), (-1.2, -0.5), (0, 0.6), textured=False)))
    scan = world.scan(max_range_m=3.5)
    laser = scan.to_laser_scan()
    ranges = laser["ranges"]
    angles = laser["angle_min"] + laser["angle_increment"] * np.arange(len(ranges))
    assert laser["angle_max"] == pytest.approx(angles[-1])
    assert laser["range_max"] == 3.5
    assert laser["range_min"] == pytest.approx(36 / 63)
    true_m = world.standing_m(angles)
    box, bare = np.isclose(true_m, 2, rtol=0.1), np.isclose(true_m, 3, rtol=0.1)
    inner = slice(2, -2)
    np.testing.assert_allclose(ranges[box][inner], true_m[box][inner], rtol=0.02)
    assert np.isnan(ranges[bare][inner]).all()
    assert np.isposinf(ranges[~box & ~bare]).mean() > 0.8
    too_close = scan.to_laser_scan(range_min_m=2.6)["ranges"]
    assert np.isneginf(too_close[box][inner]).all()
    clearing = scan.to_clearing_scan()["ranges"]
    assert (clearing[bare][inner] <= true_m[bare][inner]).all()
    assert (clearing[box][inner] <= true_m[box][inner] * 1.02).all()


LEVEL = ep.RectifiedGeometry(width=200, height=100, focal_px=100, cx_px=99.5, cy_px=49.5, baseline_m=0.2)


def read_px(disparity_px: Floats) -> Floats:
    """The disparity of each column's nearest obstacle, without a ground."""
    raw = np.round(16 * disparity_px).astype(np.uint16)
    scan = ep.scan(ep.DisparityMap(raw, np.zeros(raw.shape, np.uint8)), LEVEL, max_range_m=1000)
    return np.asarray(100 * 0.2 / (scan.nearest_m * np.cos(scan.angle_rad)), float)[::-1]


def test_the_nearest_of_a_surface_that_recedes_is_its_near_edge() -> None:
    """Of a surface that bends away, each half pixel of disparity holds a third more pixels than the one before."""
    counts = [6, 8, 11, 14, 19, 25]
    edges = 40 - 0.5 * np.arange(len(counts) + 1)
    column = np.concatenate(
        [np.linspace(near - 0.03, far + 0.03, n) for near, far, n in zip(edges, edges[1:], counts, strict=False)]
    )
    disparity = np.full((100, 200), 5.0)
    disparity[: len(column)] = (column[:, None] - np.linspace(0, 1, 200)).clip(5)
    nearest = disparity[0]
    read = read_px(disparity)
    assert (read <= nearest).all()
    assert (read >= nearest - 1).all()


def test_the_nearest_of_an_upright_surface_is_its_middle_not_the_near_end_of_its_scatter() -> None:
    random = np.random.default_rng(4)
    true_px = random.uniform(20, 40, 200)
    read = read_px(true_px + random.normal(0, 0.3, (100, 200)))
    assert abs((read - true_px).mean()) < 0.1
    assert np.abs(read - true_px).max() < 0.4


def test_without_a_ground_the_gap_in_a_column_says_how_far_it_is_free() -> None:
    flat = ep.RectifiedGeometry(width=64, height=100, focal_px=100, cx_px=31.5, cy_px=49.5, baseline_m=0.2)
    raw = np.full((100, 64), 16 * 5, np.uint16)
    validity = np.zeros((100, 64), np.uint8)
    validity[20:40, 10:20] = LOW_TEXTURE
    validity[:, 40:50] = LOW_TEXTURE
    scan = ep.scan(ep.DisparityMap(raw, validity), flat, step_m=0.2)
    nearest, free = scan.nearest_m[::-1], scan.free_to_m[::-1]
    per_depth = np.hypot(1, (np.arange(64) - 31.5) / 100)
    whole = np.r_[0:10, 20:40, 50:64]
    np.testing.assert_allclose(nearest[whole], 4 * per_depth[whole], rtol=1e-5)
    np.testing.assert_allclose(free[whole], 4 * per_depth[whole], rtol=1e-5)
    # 20 rows hide 0.2 m from 100·0.2/20 = 1 m on.
    np.testing.assert_allclose(nearest[10:20], 4 * per_depth[10:20], rtol=1e-5)
    np.testing.assert_allclose(free[10:20], per_depth[10:20], rtol=1e-5)
    assert np.isnan(nearest[40:50]).all()
    assert np.isnan(free[40:50]).all()


def test_filled_pixels_are_not_seen() -> None:
    world = World((WALL,))
    map_ = world.disparity()
    filled = ep.DisparityMap(map_.raw, np.full_like(map_.validity, 128))
    scan = ep.scan(filled, GEOMETRY, mounting=world.mounting)
    assert (scan.seen == UNKNOWN).all()
    assert np.isnan(scan.free_to_m).all()


def test_an_empty_map_is_unknown() -> None:
    empty = ep.DisparityMap(np.zeros((240, 320), np.uint16), np.full((240, 320), 1, np.uint8))
    for mounting in (None, ep.RobotFromCamera(0.5)):
        scan = ep.scan(empty, GEOMETRY, mounting=mounting)
        assert (scan.seen == UNKNOWN).all()


def test_mountings_are_poses() -> None:
    mounting = ep.RobotFromCamera(0.4, x_m=0.1, y_m=-0.2, roll_rad=0.1, pitch_rad=0.2, yaw_rad=0.3)
    pose = mounting.robot_from_camera
    assert ep.RobotFromCamera.from_matrix(pose) == mounting
    np.testing.assert_allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], [0.1, -0.2, 0.4])
    level = ep.RobotFromCamera(0.4).robot_from_camera[:3, :3]
    np.testing.assert_allclose(level @ [0, 0, 1], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(level @ [1, 0, 0], [0, -1, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"min_support": 0}, "min_support = 0 px"),
        ({"step_m": 0.0}, "step_m = 0 m"),
        ({"step_m": 0.6}, "step_m = 0.6 m: must be below the camera's height"),
        ({"headroom_m": 0.05}, "headroom_m = 0.05 m"),
        ({"headroom_m": float("nan")}, "headroom_m = NaN m"),
        ({"max_range_m": float("inf")}, "max_range_m = inf m"),
        ({"gap_guard_px": -1.0}, "gap_guard_px = -1 px"),
        ({"disparity_sigma_px": float("nan")}, "disparity_sigma_px = NaN px"),
    ],
)
def test_parameters_out_of_range_are_named(parameters: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        World().scan(**parameters)


def test_poses_that_cannot_scan_are_refused() -> None:
    with pytest.raises(ValueError, match="not below the floor"):
        ep.RobotFromCamera(-1.0)
    with pytest.raises(ValueError, match="robot_from_camera"):
        ep.RobotFromCamera(float("nan"))
    with pytest.raises(ValueError, match="orthonormal"):
        ep.RobotFromCamera.from_matrix(np.diag([2, 2, 2, 1]))
    with pytest.raises(ValueError, match="three rows"):
        ep.RobotFromCamera.from_matrix(np.eye(4)[:2])
    with pytest.raises(ep.Error, match="leans or tilts too far"):
        World(mounting=ep.RobotFromCamera(0.5, roll_rad=1.5)).scan()
    with pytest.raises(ep.Error, match=r"tilts too far|too steeply"):
        World(mounting=ep.RobotFromCamera(0.5, pitch_rad=1.3)).scan()
    other = ep.RectifiedGeometry(width=32, height=24, focal_px=30, cx_px=15.5, cy_px=11.5, baseline_m=0.12)
    with pytest.raises(ValueError, match="320x240"):
        ep.scan(World().disparity(), other)
