"""Tsai's method against SciPy, OpenCV and Willson's published points."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

import epiline as ep
from epiline import tsai

SENSOR = tsai.Sensor(ncx=576, nfx=576, dx_mm=0.023, dy_mm=0.023, cx=258, cy=204)


def euler(rx: float, ry: float, rz: float) -> np.ndarray:
    """``Rz @ Ry @ Rx``."""
    (a, b, c), (d, e, f) = np.cos([rx, ry, rz]), np.sin([rx, ry, rz])
    x = np.array([[1, 0, 0], [0, a, -d], [0, d, a]])
    y = np.array([[b, 0, e], [0, 1, 0], [-e, 0, b]])
    z = np.array([[c, -f, 0], [f, c, 0], [0, 0, 1]])
    return np.asarray(z @ y @ x)


def project(p: np.ndarray, world: np.ndarray, pitch: float) -> np.ndarray:
    """Tsai's model from its definition; p = f, kappa1, Cx, Cy, sx, Tx, Ty, Tz, Rx, Ry, Rz."""
    f, kappa1, cx, cy, sx = p[:5]
    camera = world @ euler(*p[8:]).T + p[5:8]
    undistorted = f * camera[:, :2] / camera[:, 2:]
    radius = np.linalg.norm(undistorted, axis=1)
    # The real root of kappa1 r³ + r - Ru = 0 nearest to Ru.
    distorted = np.empty_like(radius)
    for i, ru in enumerate(radius):
        roots = np.roots([kappa1, 0.0, 1.0, -ru]) if kappa1 else np.array([ru])
        real = roots[np.abs(roots.imag) < 1e-9].real
        distorted[i] = real[np.argmin(np.abs(real - ru))]
    d = undistorted * (distorted / radius)[:, None]
    return np.column_stack([sx * d[:, 0] / pitch + cx, d[:, 1] / pitch + cy])


def parameters(c: tsai.Calibration) -> np.ndarray:
    return np.array([c.f, c.kappa1, c.Cx, c.Cy, c.sx, c.Tx, c.Ty, c.Tz, c.Rx, c.Ry, c.Rz])


def willson(data: Path, name: str) -> tuple[np.ndarray, np.ndarray]:
    table = np.loadtxt(data / "tsai" / "willson_3.0b3" / name)
    return table[:, :3], table[:, 3:]


def synthetic(noise_px: float = 0.05, *, depth_mm: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.linspace(-100, 100, 9), np.linspace(-80, 80, 7)), axis=-1).reshape(-1, 2)
    world = np.column_stack([grid, depth_mm * rng.uniform(0, 1, len(grid))])
    truth = np.array([9.0, 1.5e-3, 262.0, 210.0, 1.0, 12.0, -20.0, 480.0, 0.5, 0.2, 0.3])
    return world, project(truth, world, 0.023) + rng.normal(0, noise_px, (len(world), 2)), truth


def test_willson_coplanar(data: Path) -> None:
    world, pixels = willson(data, "cc_cd.dat")
    stages = tsai.calibrate(world, pixels, sensor=SENSOR, full=False)
    assert stages.coplanar
    assert stages.f == pytest.approx(220.57, abs=0.01)
    assert stages.kappa1 == pytest.approx(-5.3967e-4, abs=1e-8)
    assert stages.sse_px2 == pytest.approx(2.2330, abs=1e-4)
    assert stages.sigma == {}
    full = tsai.calibrate(world, pixels, sensor=SENSOR)
    assert full.sse_px2 <= 1.2136495
    assert full.f == pytest.approx(258.810, abs=0.01)
    assert (full.Cx, full.Cy) == pytest.approx((261.853, 211.580), abs=1e-3)
    assert full.sx == 1.0
    assert full.sigma["sx"] == 0.0
    # The truth behind the points lies within two standard deviations.
    for name, truth in {"f": 270.0, "Tx": 150.0, "Ty": -75.0, "Tz": 6600.0, "Cx": 262.0, "Cy": 212.0}.items():
        assert abs(getattr(full, name) - truth) < 2 * full.sigma[name]


def test_willson_in_space(data: Path) -> None:
    world, pixels = willson(data, "ncc_cd.dat")
    stages = tsai.calibrate(world, pixels, sensor=SENSOR, full=False)
    assert not stages.coplanar
    assert stages.f == pytest.approx(68.019, abs=0.001)
    assert stages.sse_px2 == pytest.approx(3.7216, abs=1e-4)
    full = tsai.calibrate(world, pixels, sensor=SENSOR)
    assert full.sse_px2 <= 2.3997505
    assert full.f == pytest.approx(69.8750, abs=1e-3)
    assert full.sx == pytest.approx(1.000174, abs=1e-6)
    assert abs(full.f - 70.0) < 2 * full.sigma["f"]


@pytest.mark.parametrize(
    ("name", "sse_px2"), [("cc_cd.dat", 1.2136495), ("ncc_cd.dat", 2.3997505)], ids=["coplanar", "in space"]
)
def test_the_full_optimum_from_any_start(data: Path, name: str, sse_px2: float) -> None:
    world, pixels = willson(data, name)
    best = tsai.calibrate(world, pixels, sensor=SENSOR)
    rng = np.random.default_rng(8)
    names = ["f", "kappa1", "Cx", "Cy", "Tx", "Ty", "Tz", "Rx", "Ry", "Rz", *([] if best.coplanar else ["sx"])]
    for _ in range(20):
        moved = {n: getattr(best, n) * rng.uniform(0.8, 1.2) for n in names}
        found = tsai.calibrate(world, pixels, sensor=SENSOR, start=replace(best, **moved))
        assert found.sse_px2 <= sse_px2
    with pytest.raises(ep.Error, match="does not see"):
        tsai.calibrate(world, pixels, sensor=SENSOR, start=replace(best, Tz=-best.Tz))


def test_values_go_to_opencv_and_back() -> None:
    world, pixels, _ = synthetic()
    found = tsai.calibrate(world, pixels, sensor=SENSOR)
    exact = found.camera_model((524, 420), lens="tsai")
    points = world @ found.R.T + found.T
    np.testing.assert_allclose(exact.project(points), project(parameters(found), world, 0.023), atol=1e-9)
    opencv = found.camera_model((524, 420), lens="brown-conrady")
    assert list(opencv.distortion[2:4]) == [0.0, 0.0]
    seen = cv2.projectPoints(points, np.zeros(3), np.zeros(3), opencv.camera_matrix, opencv.distortion)[0]
    np.testing.assert_allclose(seen.reshape(-1, 2), exact.project(points), atol=0.01)
    f, kappa1, cx, cy, sx = tsai.from_opencv(opencv, sensor=SENSOR)
    assert (f, cx, cy, sx) == pytest.approx((found.f, found.Cx, found.Cy, found.sx), rel=1e-12)
    assert kappa1 == pytest.approx(found.kappa1, rel=2e-3)
    assert found.pixel_size_mm == (0.023, 0.023)
    with pytest.raises(ValueError, match="p1 = p2 = 0"):
        tsai.from_opencv(ep.CameraModel(opencv.camera_matrix, [0.1, 0, 1e-3, 0], width=524, height=420), sensor=SENSOR)
    with pytest.raises(ep.Error, match="kappa1 alone"):
        tsai.from_opencv(ep.CameraModel(opencv.camera_matrix, [0.5, -0.6, 0, 0], width=524, height=420), sensor=SENSOR)


def test_skew_is_that_of_the_picture() -> None:
    world, pixels, truth = synthetic(0.0, depth_mm=60.0)
    plain = tsai.calibrate(world, pixels, sensor=tsai.Sensor(576, 576, 0.023, 0.023, 262, 210), full=False)
    assert plain.skew_rad == pytest.approx(0.0, abs=1e-9)
    sheared = pixels + np.outer(pixels[:, 1] - truth[3], [0.01, 0.0])
    tilted = tsai.calibrate(world, sheared, sensor=tsai.Sensor(576, 576, 0.023, 0.023, 262, 210), full=False)
    assert abs(tilted.skew_rad) == pytest.approx(0.01, rel=0.05)
    flat_world, flat, _ = synthetic()
    assert math.isnan(tsai.calibrate(flat_world, flat, sensor=SENSOR).skew_rad)


@pytest.mark.parametrize("depth_mm", [0.0, 60.0], ids=["coplanar", "in space"])
def test_the_full_optimum_is_scipys(depth_mm: float) -> None:
    world, pixels, _ = synthetic(depth_mm=depth_mm)
    found = tsai.calibrate(world, pixels, sensor=SENSOR)
    p = parameters(found)
    np.testing.assert_allclose(found.R, euler(*p[8:]), atol=1e-12)
    np.testing.assert_array_equal(found.T, p[5:8])
    residuals = project(p, world, SENSOR.dpx_mm) - pixels
    assert found.sse_px2 == pytest.approx(np.sum(residuals**2), rel=1e-9)
    free = [i for i in range(11) if i != 4 or depth_mm]

    def cost(x: np.ndarray) -> np.ndarray:
        q = p.copy()
        q[free] = x
        return np.asarray((project(q, world, SENSOR.dpx_mm) - pixels).ravel())

    best = least_squares(cost, p[free] * 1.001, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=200)
    assert found.sse_px2 <= 2 * best.cost * (1 + 1e-9)
    np.testing.assert_allclose(p[free], best.x, rtol=1e-4, atol=1e-5)
    # Standard deviations from SciPy's Jacobian.
    variance = 2 * best.cost / (pixels.size - len(free))
    sigma = np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac)) * variance)
    names = ["f", "kappa1", "Cx", "Cy", "sx", "Tx", "Ty", "Tz", "Rx", "Ry", "Rz"]
    np.testing.assert_allclose([found.sigma[names[i]] for i in free], sigma, rtol=1e-3)


def test_only_the_effective_pitch_matters() -> None:
    world, pixels, _ = synthetic()
    plain = tsai.calibrate(world, pixels, sensor=SENSOR)
    doubled = tsai.Sensor(ncx=576, nfx=576, dx_mm=0.046, dy_mm=0.046, cx=258, cy=204)
    twice = tsai.calibrate(world, pixels, sensor=doubled)
    assert twice.f == pytest.approx(2 * plain.f, rel=1e-6)
    assert twice.kappa1 == pytest.approx(plain.kappa1 / 4, rel=1e-5)
    assert twice.Tz == pytest.approx(plain.Tz, rel=1e-6)
    grabbed = tsai.Sensor(ncx=768, nfx=384, dx_mm=0.0115, dy_mm=0.023, cx=258, cy=204)
    assert grabbed.dpx_mm == pytest.approx(0.023)


def test_the_world_may_start_anywhere() -> None:
    world, pixels, _ = synthetic()
    near = tsai.calibrate(world, pixels, sensor=SENSOR, full=True)
    shift = np.array([3000.0, -1000.0, 500.0])
    far = tsai.calibrate(world + shift, pixels, sensor=SENSOR, full=True)
    assert far.f == pytest.approx(near.f, rel=1e-5)
    np.testing.assert_allclose(far.T + far.R @ shift, near.T, rtol=1e-4, atol=1e-2)


def test_degenerate_points_are_refused_in_words() -> None:
    world, pixels, truth = synthetic()
    parallel = truth.copy()
    parallel[8:10] = 0.0
    rng = np.random.default_rng(1)
    facing = project(parallel, world, 0.023) + rng.normal(0, 0.1, pixels.shape)
    for full in (False, True):
        with pytest.raises(ep.Error, match="parallel to the image"):
            tsai.calibrate(world, facing, sensor=tsai.Sensor(576, 576, 0.023, 0.023, 262, 210), full=full)
        # With a principal point 7 px off, the plane seems to be tilted a little: still no camera.
        with pytest.raises(ep.Error, match="inseparable"):
            tsai.calibrate(world, facing, sensor=SENSOR, full=full)
    with pytest.raises(ep.Error, match="one line"):
        tsai.calibrate(world[:9], pixels[:9], sensor=SENSOR)
    with pytest.raises(ValueError, match="at least 5"):
        tsai.calibrate(world[[0, 8, 30, 55]], pixels[[0, 8, 30, 55]], sensor=SENSOR)
    with pytest.raises(ValueError, match="at least 11"):
        tsai.calibrate(world[::7], pixels[::7], sensor=SENSOR)
    with pytest.raises(ValueError, match="one length"):
        tsai.calibrate(world, pixels[:-1], sensor=SENSOR)
    with pytest.raises(ValueError, match="point 4"):
        tsai.calibrate(world, np.where(np.arange(len(pixels))[:, None] == 4, math.nan, pixels), sensor=SENSOR)
    with pytest.raises(ValueError, match="dpx_mm"):
        tsai.calibrate(world, pixels, sensor=tsai.Sensor(576, 576, -0.023, 0.023, 258, 204))
    deep, seen, _ = synthetic(depth_mm=60.0)
    with pytest.raises(ep.Error, match="left-handed"):
        tsai.calibrate(deep * [1, 1, -1], seen, sensor=SENSOR)


def test_a_tilt_below_two_degrees_is_refused_and_one_of_five_is_not() -> None:
    """Boards of 200 mm at 500 mm, f 8 mm, 0.1 px noise, pixels of three sizes; every direction of tilt."""
    side = np.linspace(-100, 100, 10)
    board = np.column_stack([*(axis.ravel() for axis in np.meshgrid(side, side)), np.zeros(100)])
    for pitch_mm in (0.004, 0.0065, 0.01):
        sensor = tsai.Sensor(ncx=768, nfx=768, dx_mm=pitch_mm, dy_mm=pitch_mm, cx=384, cy=288)
        passed = dict.fromkeys((0.0, 1.0, 1.5, 5.0, 10.0), 0)
        for tilt_deg in passed:
            for seed in range(40):
                rng = np.random.default_rng(seed)
                direction = rng.uniform(0, 2 * math.pi)
                axis = math.radians(tilt_deg) * np.array([math.cos(direction), math.sin(direction), 0.0])
                points = board @ cv2.Rodrigues(axis)[0].T + [10.0, 15.0, 500.0]
                pixels = [384.0, 288.0] + 8 / pitch_mm * points[:, :2] / points[:, 2:] + rng.normal(0, 0.1, (100, 2))
                with contextlib.suppress(ep.Error):
                    assert tsai.calibrate(board, pixels, sensor=sensor, full=False).f == pytest.approx(8.0, rel=0.3)
                    passed[tilt_deg] += 1
        assert passed[5.0] == passed[10.0] == 40
        assert passed[0.0] + passed[1.0] == 0
        assert passed[1.5] <= 1


def test_a_real_pair_of_a_cube(data: Path) -> None:
    # 26 points picked by hand on the inside of a cube; ruler baseline 33 mm, its author's programme 32.5 mm.
    table = np.loadtxt(data / "tsai" / "bailus_fuji_cube" / "points.csv", delimiter=",")
    sensor = tsai.Sensor(ncx=3000, nfx=3000, dx_mm=0.001096, dy_mm=0.001096, cx=1499.5, cy=1499.5)
    with pytest.raises(ep.Error, match="left-handed"):
        # As published, y runs up and the frame is left-handed: x to the left, z to the right, both to the camera.
        tsai.calibrate(table[:, :3], table[:, 3:5], sensor=sensor)
    world = table[:, :3] * [1, -1, 1]
    centers = []
    for seen in (table[:, 3:5], table[:, 5:7]):
        found = tsai.calibrate(world, seen, sensor=sensor, full=False)
        assert found.f == pytest.approx(1.9, abs=0.2)
        centers.append(-found.R.T @ found.T)
    assert np.linalg.norm(centers[1] - centers[0]) == pytest.approx(33, abs=5)
