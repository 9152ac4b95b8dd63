"""The rendered rig against geometry worked out another way: by hand, by OpenCV, by brute force."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from epiline.sources.rendered import (
    Box,
    CameraPath,
    Lamp,
    Material,
    Pole,
    RenderedFrame,
    RenderedRig,
    Room,
    Scene,
    Sensor,
    Tracer,
    Waypoint,
    column_nearest,
    default_rig,
    drive_ahead,
    nearest_supported,
    seen_by_right,
    true_depth,
    true_raw,
    true_view,
    workshop,
    world_from_optical,
)
from epiline.sources.rendered.camera import rotation_xyz
from epiline.sources.rendered.photograph import Lens, render
from epiline.sources.rendered.scene import POSTS, WHITEWASH
from epiline.sources.rendered.shading import shade
from epiline.sources.rendered.textures import pattern

CLEAN = Sensor(gain=1.0, read_noise=0.0, shot_noise=0.0, blur_px=0.0)
DARK = Material("plain", ((40, 40, 40),))
BRIGHT = Material("plain", ((200, 200, 200),))


def plain_room(*solids, lamps=()):
    return Scene(Room((-3, 11), (-3, 3), 3.0, DARK, DARK, DARK, DARK, DARK, DARK), solids, lamps, ambient=1.0)


@pytest.fixture(scope="module")
def small():
    return RenderedRig(size=(320, 240))


# ---- cameras -----------------------------------------------------------------------------------


def test_project_is_opencvs():
    camera = default_rig(640, 480).left
    points = np.random.default_rng(1).uniform([-0.6, -0.45, 0.9], [0.6, 0.45, 1.1], (500, 3))
    theirs, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.camera_matrix, np.array(camera.distortion))
    np.testing.assert_allclose(camera.project(points), theirs[:, 0], atol=1e-9)


def test_rays_project_back_onto_every_pixel():
    for camera in (default_rig(640, 480).left, default_rig(640, 480).right):
        cols, rows = np.meshgrid(np.arange(640), np.arange(480))
        np.testing.assert_allclose(camera.project(camera.pixel_rays), np.stack([cols, rows], -1), atol=1e-9)


def test_points_behind_have_no_pixel():
    assert np.isnan(default_rig(640, 480).left.project([0.1, 0.1, -1.0])).all()


def test_right_pose_is_the_inverse_of_right_from_left():
    rig = default_rig(640, 480)
    points = np.random.default_rng(2).normal(size=(20, 3))
    pose = rig.left_from_right
    back = rig.right_from_left(points) @ pose[:3, :3].T + pose[:3, 3]
    np.testing.assert_allclose(back, points, atol=1e-12)
    assert rig.baseline_m == pytest.approx(0.1187)
    assert rig.translation_m[0] < 0


def test_optical_frame_in_the_world():
    """Yaw turns left, pitch looks down, roll leans right."""
    level = world_from_optical((1, 2, 3), 0.0)
    np.testing.assert_allclose(level[:3, :3] @ [0, 0, 1], [1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(level[:3, :3] @ [1, 0, 0], [0, -1, 0], atol=1e-15)
    assert (world_from_optical((0, 0, 0), 0.1)[:3, :3] @ [0, 0, 1])[1] > 0
    assert (world_from_optical((0, 0, 0), 0.0, 0.1)[:3, :3] @ [0, 0, 1])[2] < 0
    assert (world_from_optical((0, 0, 0), 0.0, 0.0, 0.1)[:3, :3] @ [1, 0, 0])[2] < 0


# ---- rays against surfaces ---------------------------------------------------------------------


def test_depth_of_the_walls_and_the_floor(small):
    view = true_raw(plain_room(), world_from_optical((0.4, 0.2, 0.5), 0.1, 0.02, 0.03), small.truth.left)
    points = view.points_world_m
    planes = {0: (2, 0.0), 1: (2, 3.0), 2: (0, 11.0), 3: (0, -3.0), 4: (1, 3.0), 5: (1, -3.0)}
    assert set(np.unique(view.object_id)) == {0, 1, 2, 4, 5}
    for side, (axis, at) in planes.items():
        np.testing.assert_allclose(points[view.object_id == side][:, axis], at, atol=1e-9)
    inside = (points > [-3 - 1e-9, -3 - 1e-9, -1e-9]) & (points < [11 + 1e-9, 3 + 1e-9, 3 + 1e-9])
    assert inside.all()


def test_points_on_boxes_and_poles_lie_on_their_surface(small):
    box = Box("box", (3.0, 0.4, 0.5), (0.6, 0.5, 0.7), BRIGHT, yaw_rad=0.4, pitch_rad=-0.3)
    pole = Pole("pole", 2.5, -0.5, 0.03, 0.45, BRIGHT)
    eye = np.array([0.0, 0.0, 0.6])
    view = true_raw(plain_room(box, pole), world_from_optical(eye, 0.0), small.truth.left)
    local = (view.points_world_m[view.object_id == 6] - box.center_m) @ box.rotation
    share = np.abs(local) / (np.array(box.size_m) / 2)
    assert len(share) > 500
    np.testing.assert_allclose(share.max(axis=1), 1.0, atol=1e-9)
    on_pole = view.points_world_m[view.object_id == 7]
    radius = np.hypot(on_pole[:, 0] - 2.5, on_pole[:, 1] + 0.5)
    side = on_pole[:, 2] < 0.45 - 1e-9
    assert 0 < (~side).sum() < side.sum()
    np.testing.assert_allclose(radius[side], 0.03, atol=1e-9)
    assert (radius[~side] < 0.03 + 1e-9).all()
    # The nearest point is on the near side, not the far one.
    nearest = np.hypot(on_pole[:, 0], on_pole[:, 1]).min()
    assert nearest == pytest.approx(np.hypot(2.5, 0.5) - 0.03, abs=2e-4)


def test_windows_leave_nothing_out(small):
    """The rectangles that save work find the same hits as asking every solid about every ray."""
    tracer = small.tracer
    for elapsed in (0.0, 2.5, 4.0):
        pose = small.path.world_from_left(elapsed)
        rays = small.truth.left.pixel_rays @ pose[:3, :3].T
        parts = (rays[..., 0], rays[..., 1], rays[..., 2])
        depth, surface = tracer.cast(pose[:3, 3], parts)
        view = true_raw(tracer, pose, small.truth.left)
        np.testing.assert_array_equal(view.depth_m, depth)
        np.testing.assert_array_equal(view.object_id, tracer.object_of[surface])


def test_edge_of_a_box_is_where_it_projects():
    """The left edge of a bright face, found from the grey values of its pixels, against the projected edge."""
    box = Box("box", (2.0, 0.0, 0.7), (0.2, 0.8, 0.8), BRIGHT)
    rig = RenderedRig(scene=plain_room(box), left_sensor=CLEAN)
    pose = world_from_optical((0.0, 0.013, 0.7), 0.0)
    image = render(rig.tracer, Lens(rig.truth.left), pose)[..., 0].astype(float)
    heights = np.linspace(0.45, 0.95, 400)
    edge = np.stack([np.full(400, 1.9), np.full(400, 0.4), heights], 1)
    pixels = rig.truth.left.project((edge - pose[:3, 3]) @ pose[:3, :3])
    errors = []
    for row in range(200, 281, 5):
        expected = np.interp(row, pixels[::-1, 1], pixels[::-1, 0])
        col = round(expected)
        dark, bright = image[row, col - 3], image[row, col + 3]
        covered = (image[row, col - 2 : col + 3] - dark).sum() / (bright - dark)
        errors.append(col + 2.5 - covered - expected)
    assert np.abs(errors).max() < 0.11  # one fifth of a pixel between samples
    assert abs(np.mean(errors)) < 0.04


# ---- views, alignment, disparity ---------------------------------------------------------------


def test_aligned_view_shares_centre_and_world(small):
    """The same rays, told in a turned frame, meet the same points."""
    pose = small.path.world_from_left(1.0)
    raw = true_raw(small.tracer, pose, small.truth.left)
    aligned_from_left = rotation_xyz(0.01, -0.02, 0.015)
    turned = raw.directions @ aligned_from_left.T
    world_from_aligned = pose.copy()
    world_from_aligned[:3, :3] = pose[:3, :3] @ aligned_from_left.T
    view = true_view(small.tracer, world_from_aligned, turned / turned[..., 2:])
    np.testing.assert_allclose(view.range_m, raw.range_m, rtol=1e-9)

    geometry = {"focal_px": 255.0, "cx_px": 158.2, "cy_px": 121.7, "width": 300, "height": 220}
    aligned = true_depth(small.scene, pose, **geometry, aligned_from_left=aligned_from_left)
    assert aligned.depth_m.shape == (220, 300)
    # Every point, brought to the raw camera's frame and turned, has the depth and the pixel it claims.
    left = (aligned.points_world_m - pose[:3, 3]) @ pose[:3, :3]
    again = left @ aligned_from_left.T
    np.testing.assert_allclose(again[..., 2], aligned.depth_m, rtol=1e-12)
    np.testing.assert_allclose(
        255.0 * again[..., 0] / again[..., 2] + 158.2, np.tile(np.arange(300.0), (220, 1)), atol=1e-9
    )


def test_disparity_is_the_shift_between_the_aligned_cameras(small):
    pose = small.path.world_from_left(0.0)
    focal, baseline = 260.0, small.truth.baseline_m
    view = true_depth(small.tracer, pose, focal_px=focal, cx_px=160, cy_px=120, width=320, height=240)
    left = view.directions * view.depth_m[..., None]
    right = left - [baseline, 0, 0]
    shift = focal * left[..., 0] / left[..., 2] - focal * right[..., 0] / right[..., 2]
    np.testing.assert_allclose(view.disparity_px(focal, baseline), shift, rtol=1e-9)
    np.testing.assert_allclose(view.disparity_px(focal, baseline, doffs_px=3.0), shift - 3.0, rtol=1e-9)


def _right_pixels(rig, pose, view):
    left = (view.points_world_m - pose[:3, 3]) @ pose[:3, :3]
    return rig.truth.right.project(rig.truth.right_from_left(left))


def test_both_cameras_see_the_same_surface():
    """Left pixel -> point -> right pixel: the grey values agree, and stop agreeing for a wrong baseline."""
    rig = RenderedRig(left_sensor=CLEAN, right_sensor=CLEAN)
    pose = rig.path.world_from_left(0.0)
    left, right = rig.photograph(pose)
    view = true_raw(rig.tracer, pose, rig.truth.left)
    visible = seen_by_right(view, rig.truth, pose)
    assert 0.8 < visible.mean() < 0.97

    def residual(pixels):
        seen = cv2.remap(right, pixels.astype(np.float32), None, cv2.INTER_LINEAR)
        return np.abs(seen.astype(float) - left).mean(axis=-1)

    true_pixels = _right_pixels(rig, pose, view)
    right_residual = residual(true_pixels)
    assert np.median(right_residual[visible]) < 2.0
    assert np.percentile(right_residual[visible], 90) < 8.0
    wrong = residual(true_pixels + np.array([2.0, 0.0]))
    assert np.median(wrong[visible]) > 2.5 * np.median(right_residual[visible])


def test_occlusion_against_the_right_cameras_own_depth(small):
    pose = small.path.world_from_left(4.0)
    view = true_raw(small.tracer, pose, small.truth.left)
    visible = seen_by_right(view, small.truth, pose)
    right = true_raw(small.tracer, pose @ small.truth.left_from_right, small.truth.right)
    world_from_right = pose @ small.truth.left_from_right
    depth = (view.points_world_m - world_from_right[:3, 3]) @ world_from_right[:3, 2]
    pixels = np.rint(_right_pixels(small, pose, view))
    inside = (pixels[..., 0] >= 0) & (pixels[..., 0] < 320) & (pixels[..., 1] >= 0) & (pixels[..., 1] < 240)
    cols, rows = (np.where(inside, pixels[..., i], 0).astype(int) for i in (0, 1))
    expected = inside & (right.depth_m[rows, cols] > depth * 0.98)
    assert np.mean(visible != expected) < 0.01
    assert np.mean(~visible & inside) > 0.01  # there is something to hide


# ---- light and texture -------------------------------------------------------------------------


def test_pyramid_keeps_the_mean_and_tiles():
    picture = pattern("planks", 3)
    first = picture.pyramid[: 1024 * 1024].reshape(1024, 1024)
    assert picture.pyramid[-1] == pytest.approx(first.mean(), abs=1e-4)
    assert 0 <= first.min() < 0.1 < 0.8 < first.max() <= 1
    rng = np.random.default_rng(0)
    u, v = rng.uniform(0, 2.24, (2, 200)).astype(np.float32)
    foot = np.full(200, 0.004, np.float32)
    tile = np.float32(picture.tile_m)
    np.testing.assert_allclose(picture.sample(u, v, foot), picture.sample(u + tile, v - 3 * tile, foot), atol=2e-2)
    # At a texel's centre and its own size the sample is the texel.
    rows, cols = rng.integers(0, 1024, (2, 200))
    texel = picture.tile_m / 1024
    u, v = ((cols + 0.5) * texel).astype(np.float32), ((rows + 0.5) * texel).astype(np.float32)
    np.testing.assert_allclose(picture.sample(u, v, np.full(200, texel / 2, np.float32)), first[rows, cols], atol=2e-3)


def test_texture_is_not_aliased(small):
    """One filtered sample of a pixel against 144 unfiltered ones spread over it."""
    lens = Lens(small.truth.left)
    pose = small.path.world_from_left(0.0)
    rng = np.random.default_rng(5)
    rows, cols = rng.integers(2, 238, 3000), rng.integers(2, 318, 3000)
    view = true_raw(small.tracer, pose, small.truth.left)
    same = np.ones(3000, bool)
    for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0)):
        same &= view.object_id[rows, cols] == view.object_id[rows + dr, cols + dc]
    rows, cols = rows[same], cols[same]

    def radiance(offset_x, offset_y, pixel_rad):
        rays = small.truth.left.rays(np.stack([cols + offset_x, rows + offset_y], -1)) @ pose[:3, :3].T
        parts = tuple(rays[..., i].astype(np.float32) for i in range(3))
        at, surface = small.tracer.cast(pose[:3, 3], parts)
        return shade(small.tracer, pose[:3, 3], parts, at, surface, pixel_rad)[:, 1]

    one = radiance(0.0, 0.0, lens.pixel_rad)
    offsets = (np.arange(12) + 0.5) / 12 - 0.5
    many = np.mean([radiance(x, y, lens.pixel_rad / 12) for x in offsets for y in offsets], axis=0)
    raw = radiance(0.0, 0.0, lens.pixel_rad / 12)
    assert abs((one - many).mean()) < 0.5
    assert np.sqrt(((one - many) ** 2).mean()) < 0.6 * np.sqrt(((raw - many) ** 2).mean())


def test_hard_walls_for_matchers():
    """A whitewashed wall has nothing to match; posts repeat along the scan-line."""
    pose = world_from_optical((8.0, 0.0, 1.5), 0.0)
    rows = {}
    for name, material in (("plain", WHITEWASH), ("posts", POSTS)):
        room = Room((-3, 11), (-3, 3), 3.0, DARK, DARK, material, DARK, DARK, DARK)
        lens = Lens(default_rig(320, 240).left)
        rows[name] = render(Tracer(Scene(room, ambient=1.0)), lens, pose)[120, 110:210, 1]
    assert np.ptp(rows["plain"]) < 1.0
    # 2.4 m / 16 bars at 3 m distance.
    period = 0.15 * 259 / 3.0
    spectrum = np.abs(np.fft.rfft(rows["posts"] - rows["posts"].mean()))
    assert np.ptp(rows["posts"]) > 60
    assert np.argmax(spectrum) == round(100 / period)


def test_lamps_follow_lambert():
    """The floor right under a lamp and one metre beside it."""
    lamp = Lamp((2.0, 0.0, 2.0), strength=0.8, reach_m=3.0)
    scene = plain_room(lamps=(lamp,))
    origin = np.array([0.0, 0.0, 1.0])
    targets = np.array([[2.0, 0.0, 0.0], [2.0, 1.0, 0.0]])
    rays = tuple((targets - origin)[:, i].astype(np.float32) for i in range(3))
    tracer = Tracer(scene)
    at, surface = tracer.cast(origin, rays)
    got = shade(tracer, origin, rays, at, surface, 1e-3)[:, 0]
    under = 1.0 + 0.8 / (1 + 4 / 9)
    beside = 1.0 + 0.8 * 2 / np.sqrt(5) / (1 + 5 / 9)
    corner = 1 - 0.3 * np.exp(-np.array([3.0, 2.0]) / 0.35)
    np.testing.assert_allclose(got, 40 * np.array([under, beside]) * corner, rtol=1e-5)


def test_sensor_noise_and_exposure():
    sensor = Sensor(gain=0.9, read_noise=0.8, shot_noise=0.02, blur_px=0.45)
    image = sensor.expose(np.full((200, 200, 3), 120.0, np.float32), np.random.default_rng(0)).astype(float)
    assert image.mean() == pytest.approx(108.0, abs=0.05)
    # One twelfth is what rounding adds.
    assert image.var() == pytest.approx(0.8**2 + 0.02 * 108 + 1 / 12, rel=0.03)


def test_blur_is_opencvs():
    image = np.random.default_rng(0).uniform(0, 255, (40, 50, 3)).astype(np.float32)
    ours = Sensor(read_noise=0.0, shot_noise=0.0, blur_px=0.8).expose(image, np.random.default_rng(0))
    theirs = cv2.GaussianBlur(image, (7, 7), 0.8, borderType=cv2.BORDER_REPLICATE)
    assert np.abs(ours - theirs).max() <= 0.51


def test_same_seed_same_pixels():
    one, two, other = (RenderedRig(seed=seed, size=(160, 120)) for seed in (4, 4, 5))
    pose = one.path.world_from_left(1.0)
    for a, b in zip(one.photograph(pose), two.photograph(pose), strict=True):
        np.testing.assert_array_equal(a, b)
    assert (one.photograph(pose)[0] != other.photograph(pose)[0]).mean() > 0.5
    assert (one.photograph(pose, number=1)[0] != one.photograph(pose)[0]).any()


# ---- the drive ---------------------------------------------------------------------------------


def test_frames_are_a_source(small):
    source = small.frames(3)
    with source:
        frames = list(source)
    assert len(source) == source.length == 3
    assert source.size == (320, 240)
    assert [frame.seq for frame in frames] == [0, 1, 2]
    assert [frame.left_stamp_nanos for frame in frames] == [0, 2_000_000_000, 4_000_000_000]
    for frame in frames:
        assert isinstance(frame, RenderedFrame)
        assert frame.left.shape == frame.right.shape == (240, 320, 3)
        assert frame.left.dtype == np.uint8
        assert 60 < frame.left.mean() < 180
        assert (frame.left > 250).mean() < 0.02
        # The right camera is exposed a tenth less.
        assert frame.right.mean() / frame.left.mean() == pytest.approx(0.9, abs=0.04)


def test_path_passes_its_waypoints_smoothly():
    path = drive_ahead()
    np.testing.assert_allclose(path.world_from_left(2.0)[:3, 3], [0.39, 0.08, 0.50], atol=1e-12)
    np.testing.assert_array_equal(path.world_from_left(99.0), path.world_from_left(path.duration_s))
    times = np.linspace(0, 4, 401)
    steps = np.diff([path.world_from_left(t)[:3, 3] for t in times], axis=0)
    assert np.abs(np.diff(steps, axis=0)).max() < 1e-4
    with pytest.raises(ValueError, match="two way-points"):
        CameraPath([Waypoint(0, (0, 0, 1))])
    with pytest.raises(ValueError, match="increase"):
        CameraPath([Waypoint(1, (0, 0, 1)), Waypoint(1, (1, 0, 1))])


@pytest.mark.parametrize("size", [(16, 480), (640, 5000)])
def test_sizes_out_of_bounds_are_refused(size):
    with pytest.raises(ValueError, match=f"{size[0]}x{size[1]} px"):
        RenderedRig(size=size)


def test_count_of_frames_is_positive(small):
    with pytest.raises(ValueError, match="count is 0"):
        small.frames(0)


# ---- obstacles and regions ---------------------------------------------------------------------


def _demo_truth(rig, elapsed):
    return true_depth(
        rig.tracer, rig.path.world_from_left(elapsed), focal_px=500, cx_px=319.5, cy_px=239.5, width=640, height=480
    )


def test_demo_has_obstacles_from_one_to_eight_metres():
    rig = RenderedRig()
    obstacles = _demo_truth(rig, 0.0).obstacles(within=(0, 190, 640, 100))
    ranges = [obstacle.range_m for obstacle in obstacles]
    assert ranges == sorted(ranges)
    assert {"parcel", "crate", "bollard", "thin pole"} <= {obstacle.name for obstacle in obstacles}
    assert "door" not in {obstacle.name for obstacle in obstacles}
    assert min(ranges) < 3 < 6 < max(ranges)


@pytest.mark.parametrize("elapsed", [0.0, 1.3, 2.9, 4.0])
def test_no_edge_grazes_the_papers_bands(elapsed):
    """Nine rows more or less do not change a band's nearest range: the truth does not hang on a row or two."""
    view = _demo_truth(RenderedRig(size=(160, 120)), elapsed)
    for half in (20, 30, 40, 50):
        nearest = [view.nearest_range_m((0, 240 - half - by, 640, 2 * (half + by))) for by in (-9, 0, 9)]
        assert max(nearest) / min(nearest) < 1.005


def test_obstacle_truth_by_hand():
    scene = plain_room(Box("box", (3.0, 0.5, 0.6), (0.4, 0.4, 1.2), BRIGHT), Pole("pole", 2.0, -0.4, 0.05, 2.0, BRIGHT))
    pose = world_from_optical((0, 0, 0.5), 0.0)
    view = true_depth(scene, pose, focal_px=500, cx_px=320, cy_px=240, width=640, height=480)
    pole, box = view.obstacles(min_pixels=1)
    assert (pole.name, box.name) == ("pole", "box")
    # The box's near face is the plane Z = 2.8 m from y = 0.3 m to 0.7 m on the left.
    assert box.depth_m == pytest.approx(2.8)
    assert box.range_m == pytest.approx(np.hypot(2.8, 0.3), rel=1e-3)
    assert box.box[0] == np.ceil(320 - 500 * 0.7 / 2.8)
    assert box.bearing_rad < 0 < pole.bearing_rad
    assert pole.bearing_rad == pytest.approx(np.arctan(0.4 / 2.0), abs=0.01)
    assert pole.range_m == pytest.approx(np.hypot(2.0, 0.4) - 0.05, abs=1e-3)
    assert pole.pixels == (view.object_id == 7).sum()
    assert [o.name for o in view.obstacles(within=(0, 200, 300, 40))] == ["box"]
    assert view.nearest_range_m((0, 200, 300, 40)) == pytest.approx(box.range_m, rel=1e-3)


def test_nearest_supported_by_brute_force():
    rng = np.random.default_rng(0)
    for _ in range(50):
        values = rng.uniform(1, 4, rng.integers(1, 40))
        values[rng.random(values.size) < 0.2] = np.nan
        support = int(rng.integers(1, 6))
        candidates = [v for v in values if np.sum((values >= v) & (values <= 1.05 * v)) >= support]
        expected = min(candidates, default=np.nan)
        np.testing.assert_equal(nearest_supported(values, support), expected)
    with pytest.raises(ValueError, match="min_pixels is 0"):
        nearest_supported([1.0], 0)


def test_column_nearest_is_nearest_supported_per_column():
    image = np.full((6, 4), 5.0)
    image[1:5, 2] = 2.0
    image[3, 1] = 1.0
    np.testing.assert_array_equal(column_nearest(image, (0, 0, 4, 6), min_pixels=3), [5, 5, 2, 5])


# ---- the chessboard ----------------------------------------------------------------------------


def _found(image, truth, columns, rows):
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    ok, corners = cv2.findChessboardCorners(grey, (columns, rows))
    assert ok
    grid = truth.reshape(rows, columns, 2)
    spacing = min(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min() for axis in (0, 1))
    half = max(2, int(0.35 * spacing))
    corners = cv2.cornerSubPix(grey, corners.astype(np.float32), (half, half), (-1, -1), (3, 50, 1e-4)).reshape(-1, 2)
    # Either end of a board may be the first for the finder.
    return min((corners, corners[::-1]), key=lambda c: np.abs(c - truth).sum()).astype(np.float32)


def test_boards_calibrate_the_rig():
    """OpenCV finds the rendered corners within 0.1 px and recovers the cameras that rendered them."""
    rig = RenderedRig()
    views = list(rig.board_views(9, 6, 0.04, count=12))
    assert len(views) == 12
    left = [_found(view.left, view.left_px, 9, 6) for view in views]
    right = [_found(view.right, view.right_px, 9, 6) for view in views]
    board = [view.board_m.astype(np.float32) for view in views]
    errors = np.concatenate([a - view.left_px for a, view in zip(left, views, strict=True)])
    errors = np.concatenate([errors, *(b - view.right_px for b, view in zip(right, views, strict=True))])
    assert np.sqrt((errors**2).sum(axis=1).mean()) < 0.1

    flags = cv2.CALIB_FIX_K3
    inner = []
    for corners in (left, right):
        _, matrix, lens, _, _ = cv2.calibrateCamera(board, corners, (640, 480), None, None, flags=flags)
        inner += [matrix, lens]
    solved = cv2.stereoCalibrate(
        board, left, right, *inner, (640, 480), flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS, criteria=(3, 100, 1e-9)
    )
    matrix, rotation, translation = solved[1], solved[5], solved[6].ravel()
    assert np.linalg.norm(translation) == pytest.approx(rig.truth.baseline_m, rel=0.003)
    assert matrix[0, 0] == pytest.approx(rig.truth.left.fx, rel=0.003)
    np.testing.assert_allclose(rotation, rig.truth.rotation, atol=2e-3)


def test_boards_vary_and_stay_inside(small):
    views = list(small.board_views(7, 5, 0.03, count=15))
    tilts, middles = [], []
    for view in views:
        tilts.append(np.rad2deg(np.arccos(view.left_from_board[2, 2])))
        middles.append(view.left_px.mean(axis=0))
        for pixels in (view.left_px, view.right_px):
            assert (pixels > 4).all()
            assert (pixels < [315, 235]).all()
        # A saturated paper would grow into the ink.
        assert (view.left == 255).mean() < 1e-4
    assert max(tilts) > 30
    assert max(tilts) < 40
    assert np.ptp(np.array(middles), axis=0).min() > 60


def test_impossible_boards_are_refused(small):
    with pytest.raises(ValueError, match="is none"):
        small.board_views(9, 6, 0.0)
    with pytest.raises(ValueError, match="does not fit"):
        small.board_views(9, 6, 0.0001)


def test_workshop_names_every_object():
    scene = workshop()
    assert len(scene.names) == 6 + len(scene.solids)
    assert len(set(scene.names)) == len(scene.names)
    assert all(scene.names[i] not in scene.decoration for i in scene.obstacle_ids)
