"""The rectifier against OpenCV's maps in double precision, and the vertical residual of real pairs."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep

LEFT_K = np.array([[531.0, 0, 315.2], [0, 533.5, 247.8], [0, 0, 1]])
RIGHT_K = np.array([[536.4, 0, 322.9], [0, 534.0, 241.1], [0, 0, 1]])
LEFT_D = np.array([-0.31, 0.13, 8e-4, -5e-4, -0.02])
RIGHT_D = np.array([-0.29, 0.11, -3e-4, 6e-4, 0.0])


def rig(degrees: tuple[float, float, float], width: int = 640, height: int = 480) -> ep.StereoCalibration:
    left = ep.CameraModel(LEFT_K, LEFT_D, width=width, height=height)
    right = ep.CameraModel(RIGHT_K, RIGHT_D, width=width, height=height)
    rotation, _ = cv2.Rodrigues(np.radians(degrees))
    return ep.StereoCalibration(left, right, rotation, rotation @ [-0.12, 0.004, -0.003])


def opencv_maps(
    geometry: ep.RectifiedGeometry, degrees: tuple[float, float, float]
) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Source positions of every aligned pixel, float64: OpenCV's projection of the rays both views share."""
    x, y = np.meshgrid(np.arange(geometry.width, dtype=float), np.arange(geometry.height, dtype=float))
    rays = np.stack([(x - geometry.cx_px) / geometry.focal_px, (y - geometry.cy_px) / geometry.focal_px, 0 * x + 1], 2)
    rotation, _ = cv2.Rodrigues(np.radians(degrees))
    left_from_aligned = geometry.aligned_from_left.T
    maps = []
    for turn, K, D in [(left_from_aligned, LEFT_K, LEFT_D), (rotation @ left_from_aligned, RIGHT_K, RIGHT_D)]:
        points, _ = cv2.projectPoints((rays.reshape(-1, 3) @ turn.T), np.zeros(3), np.zeros(3), K, D)
        maps.append((points[:, 0, 0].reshape(x.shape), points[:, 0, 1].reshape(x.shape)))
    return maps


def bilinear(
    image: NDArray[np.uint8], u: NDArray[np.float64], v: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]:
    """Equation 4 in float64, where it has four source pixels, and the steps between them."""
    height, width = image.shape
    valid = (u >= 0) & (u <= width - 1) & (v >= 0) & (v <= height - 1)
    x = np.clip(np.floor(u).astype(int), 0, width - 2)
    y = np.clip(np.floor(v).astype(int), 0, height - 2)
    a, b = u - x, v - y
    i1, i2, i3, i4 = (image[y + dy, x + dx].astype(float) for dy in (0, 1) for dx in (0, 1))
    value = (1 - a) * (1 - b) * i1 + a * (1 - b) * i2 + (1 - a) * b * i3 + a * b * i4
    steps = np.maximum(abs(i2 - i1), abs(i4 - i3)) + np.maximum(abs(i3 - i1), abs(i4 - i2))
    return value, valid, steps


@pytest.mark.parametrize("degrees", [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (0.0, -2.0, 0.0), (1.0, 1.5, -2.0)])
def test_images_and_masks_are_equation_4_at_opencv_positions(degrees: tuple[float, float, float]) -> None:
    random = np.random.default_rng(1)
    images = [random.integers(0, 256, (480, 640)).astype(np.uint8) for _ in range(2)]
    rectifier = ep.Rectifier(rig(degrees))
    pair = rectifier(*images)
    maps = opencv_maps(pair.geometry, degrees)
    for image, ours, mask, (u, v) in zip(
        images, (pair.left, pair.right), (pair.left_valid, pair.right_valid), maps, strict=True
    ):
        expected, valid, steps = bilinear(image, u, v)
        # Positions are rounded to 1/256 px: within half of that of the border either answer is right.
        height, width = image.shape
        near_border = np.minimum.reduce([abs(u), abs(u - width + 1), abs(v), abs(v - height + 1)]) <= 1 / 512
        np.testing.assert_array_equal(mask[~near_border], valid[~near_border])
        assert not ours[~mask].any()
        sure = mask & ~near_border
        assert (abs(ours - expected)[sure] <= 0.5 + steps[sure] / 512 + 1e-6).all()
        opencv = cv2.remap(image, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR).astype(int)
        # Before OpenCV 5 its positions were rounded to 1/32 px, eight times as coarse as ours.
        assert (abs(ours - opencv)[sure] <= 2 + steps[sure] / 64).all()
        assert (abs(ours - opencv)[sure] <= 1).mean() > (0.99 if cv2.__version__ >= "5" else 0.8)


@pytest.mark.parametrize("degrees", [(0.0, 0.0, 0.0), (1.0, 1.5, -2.0)])
def test_alpha_lies_where_opencvs_does(degrees: tuple[float, float, float]) -> None:
    rotation, _ = cv2.Rodrigues(np.radians(degrees))
    translation = (rotation @ [-0.12, 0.004, -0.003]).reshape(3, 1)
    for alpha in (0.0, 1.0):
        ours = ep.Rectifier(rig(degrees), alpha=alpha).geometry.focal_px
        *_, P1, _, _, _, _ = cv2.stereoRectify(
            LEFT_K, LEFT_D, RIGHT_K, RIGHT_D, (640, 480), rotation, translation, alpha=alpha, flags=0
        )
        # OpenCV samples nine points an edge and centres each picture by itself.
        assert ours == pytest.approx(P1[0, 0], rel=0.12), alpha
    pair = ep.Rectifier(rig(degrees), alpha=0.0)(*[np.full((480, 640), 9, np.uint8)] * 2)
    assert pair.left_valid.all()
    assert pair.right_valid.all()


def test_pairs_share_masks_that_nobody_can_change_and_nothing_else() -> None:
    rectifier = ep.Rectifier(rig((1.0, 1.5, -2.0)))
    first, second = (rectifier(*[np.full((480, 640), level, np.uint8)] * 2) for level in (50, 90))
    for pair in (first, second):
        assert not pair.left_valid.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            pair.right_valid[0, 0] = True
    first.left[...] = 7
    assert second.left[240, 320] == 90
    assert (second.left[second.left_valid] == 90).all()
    assert (second.left[~second.left_valid] == 0).all()


def test_options_of_the_view() -> None:
    wide = ep.Rectifier(rig((0.0, 0.0, 0.0)), size=(800, 300), fov_deg=90)
    assert (wide.geometry.width, wide.geometry.height) == (800, 300)
    assert wide.geometry.focal_px == pytest.approx(400)
    assert wide.geometry.projection == "pinhole"
    assert ep.Rectifier(rig((0.0, 0.0, 0.0)), focal_px=321).geometry.focal_px == 321
    with pytest.raises(ValueError, match="at most one"):
        ep.Rectifier(rig((0.0, 0.0, 0.0)), alpha=0.5, fov_deg=90)
    with pytest.raises(ValueError, match=r"fov_deg = 180"):
        ep.Rectifier(rig((0.0, 0.0, 0.0)), fov_deg=180)
    with pytest.raises(ValueError, match="expected pinhole or cylindrical"):
        ep.Rectifier(rig((0.0, 0.0, 0.0)), projection="spherical")  # type: ignore[arg-type]


def test_a_fisheye_pair_on_a_cylinder() -> None:
    """Rows agree, and the law of sines gives the points back: checked with vectors alone."""
    camera = ep.CameraModel(
        [[145, 0, 239.5], [0, 145, 239.5], [0, 0, 1]], [-0.01, 2e-3, 0, 0], width=480, height=480, lens="kannala-brandt"
    )
    rotation, _ = cv2.Rodrigues(np.radians([1.0, -2.0, 0.7]))
    fisheyes = ep.StereoCalibration(camera, camera, rotation, [-0.1, 2e-3, 3e-3])
    geometry = ep.Rectifier(fisheyes, size=(500, 500), fov_deg=178, projection="cylindrical").geometry
    rng = np.random.default_rng(4)
    directions = rng.normal(size=(300, 3))
    directions[:, 2] = abs(directions[:, 2])
    points = directions / np.linalg.norm(directions, axis=1, keepdims=True) * rng.uniform(0.5, 20, (300, 1))
    b = geometry.baseline_m
    left, right = points, points - [b, 0, 0]
    columns = [np.arctan2(p[:, 0], np.hypot(p[:, 1], p[:, 2])) for p in (left, right)]
    row = np.arctan2(points[:, 1], points[:, 2])
    x = geometry.focal_px * columns[0] + geometry.cx_px
    y = geometry.focal_px * row + geometry.cy_px
    disparity = geometry.focal_px * (columns[0] - columns[1])
    np.testing.assert_allclose(geometry.points(np.stack([x, y, disparity], 1)), points, rtol=1e-7, atol=1e-7)
    flat = ep.DisparityMap(np.full((500, 500), 160, np.uint16), np.zeros((500, 500), np.uint8))
    with pytest.raises(ValueError, match="needs a pinhole pair"):
        ep.to_range(flat, geometry)
    with pytest.raises(ValueError, match="needs a pinhole pair"):
        _ = geometry.Q


def test_q_and_depth_triangulate() -> None:
    degrees = (1.0, -1.5, 0.5)
    geometry = ep.Rectifier(rig(degrees)).geometry
    assert (geometry.width, geometry.height, geometry.doffs_px) == (640, 480, 0.0)
    point_m = np.array([0.21, -0.13, 1.7])
    aligned = geometry.aligned_from_left @ point_m
    d = geometry.disparity_px(aligned[2])
    x, y = geometry.focal_px * aligned[:2] / aligned[2] + (geometry.cx_px, geometry.cy_px)
    X = geometry.Q @ (x, y, d, 1)
    np.testing.assert_allclose(X[:3] / X[3], aligned, atol=1e-12)
    np.testing.assert_allclose(geometry.depth_m(d), aligned[2])


def test_same_angles_as_opencv_stereo_rectify() -> None:
    degrees = (1.2, -0.8, 1.5)
    rotation, _ = cv2.Rodrigues(np.radians(degrees))
    translation = rotation @ [-0.12, 0.004, -0.003]
    R1 = cv2.stereoRectify(LEFT_K, LEFT_D, RIGHT_K, RIGHT_D, (640, 480), rotation, translation.reshape(3, 1))[0]
    # Not equal: OpenCV turns the levelled pair about another axis; the residual turn is about the baseline.
    turn, _ = cv2.Rodrigues(ep.Rectifier(rig(degrees)).geometry.aligned_from_left @ R1.T)
    np.testing.assert_allclose(turn.ravel()[1:], 0, atol=1e-9)
    assert abs(turn[0, 0]) < np.radians(0.1)


def test_colour_is_converted_and_rows_may_be_strided() -> None:
    rectifier = ep.Rectifier(rig((0.5, 0.5, 0.5)))
    colour = np.random.default_rng(4).integers(0, 256, (480, 640, 3)).astype(np.uint8)
    grey = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY)
    wide = np.zeros((480, 800), np.uint8)
    wide[:, 100:740] = grey
    first, second = rectifier(colour, grey), rectifier(wide[:, 100:740], colour)
    np.testing.assert_array_equal(first.left, second.left)
    np.testing.assert_array_equal(first.right, second.right)


def test_wrong_images_are_refused() -> None:
    rectifier = ep.Rectifier(rig((0.0, 0.0, 0.0)))
    good, small = np.zeros((480, 640), np.uint8), np.zeros((480, 639), np.uint8)
    with pytest.raises(ValueError, match=r"left image is 639x480 px .* 640x480 px"):
        rectifier(small, good)
    with pytest.raises(ValueError, match=r"right image is 639x480 px .* 640x480 px"):
        rectifier(good, small)
    with pytest.raises(ValueError, match="right"):
        rectifier(good, good.astype(float))  # type: ignore[arg-type]


def test_swapped_cameras_are_refused() -> None:
    camera = ep.CameraModel(LEFT_K, LEFT_D, width=640, height=480)
    with pytest.raises(ep.Error, match="swapped"):
        ep.Rectifier(ep.StereoCalibration(camera, camera, np.eye(3), [0.12, 0, 0]))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"focal_px": 0.0}, "focal_px = 0"),
        ({"baseline_m": -0.1}, "baseline_m = -0.1"),
        ({"cx_px": np.nan}, "cx_px"),
        ({"width": 0}, "0x3 px"),
        ({"height": -2}, "height = -2"),
    ],
)
def test_geometry_names_the_bad_value(change: dict[str, float], text: str) -> None:
    good = {"width": 4, "height": 3, "focal_px": 500.0, "cx_px": 1.5, "cy_px": 1.0, "baseline_m": 0.1}
    assert ep.RectifiedGeometry(**good).doffs_px == 0  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=text):
        ep.RectifiedGeometry(**good | change)  # type: ignore[arg-type]


# ---- the residual of real pairs ----------------------------------------------------------------


def grey_pair(folder: Path) -> list[NDArray[np.uint8]]:
    return [cv2.imread(str(next(folder.glob(f"{side}.*"))), cv2.IMREAD_GRAYSCALE) for side in ("left", "right")]


@pytest.mark.parametrize(
    "scene",
    [
        "middlebury2003/cones",
        "middlebury2003/teddy",
        "middlebury2005/Art",
        "middlebury2005/Dolls",
        "middlebury2006/Cloth3",
        "middlebury2014/Motorcycle",
    ],
)
def test_residual_of_laboratory_pairs_is_small(data: Path, scene: str) -> None:
    error = ep.alignment_error(*grey_pair(data / scene))
    assert error.matches >= 40
    assert error.median_px < 0.2
    assert error.spread_px < 0.2
    assert error.left_px.shape == error.right_px.shape == (error.matches, 2)


@pytest.mark.parametrize("scene", ["000002_10", "000007_10", "000010_10", "000020_10", "000029_10"])
def test_residual_of_road_pairs_is_small(data: Path, scene: str) -> None:
    error = ep.alignment_error(*grey_pair(data / "kitti2015" / scene))
    assert error.matches >= 30
    assert error.median_px < 0.4
    assert error.spread_px < 0.3


@pytest.mark.parametrize(("scene", "scale"), [("cones", 4), ("teddy", 4)])
def test_matches_are_those_of_the_ground_truth(data: Path, scene: str, scale: int) -> None:
    folder = data / "middlebury2003" / scene
    error = ep.alignment_error(*grey_pair(folder))
    truth = cv2.imread(str(folder / "gt_left.png"), cv2.IMREAD_GRAYSCALE) / scale
    x, y = error.left_px.astype(int).T
    known = truth[y, x] > 0
    off = abs(error.left_px[:, 0] - error.right_px[:, 0] - truth[y, x])[known]
    assert np.median(off) < 0.25
    assert (off > 2).mean() < 0.12


@pytest.mark.parametrize("quarters", range(-3, 6))
def test_shifts_by_quarters_of_a_pixel_in_a_real_picture(data: Path, quarters: int) -> None:
    """Four full-size pixels become one: a shift by whole ones of them is an exact quarter."""
    full = cv2.imread(str(data / "middlebury2005_full" / "Art" / "left.png"), cv2.IMREAD_GRAYSCALE).astype(float)
    random = np.random.default_rng(0)

    def camera(top: int, gain: float) -> NDArray[np.uint8]:
        part = full[8 + top : 1096 + top, 64 if gain == 1 else 85 :][:1088, :1240]
        small = part.reshape(272, 4, 310, 4).mean((1, 3))
        return np.clip(gain * small + random.normal(0, 2, small.shape), 0, 255).round().astype(np.uint8)

    error = ep.alignment_error(camera(0, 1.0), camera(-quarters, 0.8), num_disparities=64)
    right = error.right_px[:, 1] - error.left_px[:, 1]
    assert error.matches >= 60
    assert abs(np.median(right) - quarters / 4) < 0.01
    assert abs(error.median_px - np.median(abs(right))) < 1e-12
    # Along the rows, where nothing is asked of it, a meter at half size is a little less exact.
    assert abs(np.median(error.left_px[:, 0] - error.right_px[:, 0]) - 21 / 4) < 0.02


def published_bumblebee(folder: Path) -> ep.StereoCalibration:
    """The rig's calibration as BoofCV published it: `rightToLeft`, millimetres."""
    text = (folder / "stereo.yaml").read_text()
    cameras = []
    for side in ("left", "right"):
        block = text[re.search(rf"^{side}:", text, re.M).start() :]  # type: ignore[union-attr]
        fx, fy, cx, cy = (float(re.search(rf"{n}: (\S+)", block)[1]) for n in ("fx", "fy", "cx", "cy"))  # type: ignore[index]
        radial = [float(k) for k in re.findall(r"- (\S+)", block)[:2]]
        K = [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]
        cameras.append(ep.CameraModel(K, [*radial, 0, 0, 0], width=640, height=480))
    block = text[text.index("rightToLeft") :]
    R = np.array([float(v) for v in re.findall(r"- (\S+)", block)[:9]]).reshape(3, 3)
    T = np.array([float(re.search(rf"^  {n}: (\S+)", block, re.M)[1]) for n in "xyz"]) / 1000  # type: ignore[index]
    return ep.StereoCalibration(*cameras, R.T, -R.T @ T)


def test_raw_pairs_are_aligned_by_their_published_calibration(data: Path) -> None:
    rectifier = ep.Rectifier(published_bumblebee(data / "calib" / "boofcv_Bumblebee2_Chess"))
    assert abs(rectifier.geometry.baseline_m - 0.120) < 0.0006
    scenes = sorted((data / "scenes_unrectified" / "boofcv_bumblebee2").glob("*_left.jpg"))
    assert len(scenes) == 8
    for left in scenes:
        images = [cv2.imread(str(left.with_name(left.name.replace("left", side)))) for side in ("left", "right")]
        pair = rectifier(*images)
        before = ep.alignment_error(*images, max_offset_px=16)
        after = ep.alignment_error(pair.left, pair.right)
        assert before.median_px > 3, left.name
        assert after.median_px <= 0.6, left.name
        assert after.matches >= 30, left.name


def test_too_little_to_match_is_not_a_number() -> None:
    flat = np.full((240, 320), 90, np.uint8)
    error = ep.alignment_error(flat, flat)
    assert (error.matches, error.left_px.shape) == (0, (0, 2))
    assert np.isnan([error.median_px, error.spread_px]).all()


def test_bad_options_are_named() -> None:
    flat = np.full((24, 32), 90, np.uint8)
    with pytest.raises(ValueError, match="num_disparities = 0 px"):
        ep.alignment_error(flat, flat, num_disparities=0)
    with pytest.raises(ValueError, match="num_disparities = -1"):
        ep.alignment_error(flat, flat, num_disparities=-1)
    with pytest.raises(ValueError, match="max_offset_px = 65 px"):
        ep.alignment_error(flat, flat, max_offset_px=65)
    with pytest.raises(ValueError, match=r"32x24 px .* 31x24 px"):
        ep.alignment_error(flat, flat[:, 1:])
