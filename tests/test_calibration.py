"""Stereo calibration against OpenCV, SciPy and photographs of real rigs."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

import epiline as ep

SIZE = (640, 480)
INTRINSICS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
NAMES = [
    *(f"{side}_{name}" for side in ("left", "right") for name in INTRINSICS),
    *(f"rotation_{axis}" for axis in "xyz"),
    *(f"translation_{axis}_m" for axis in "xyz"),
]

Corners = list[np.ndarray]


def grid(columns: int, rows: int, square_m: float) -> np.ndarray:
    return np.array([[x * square_m, y * square_m, 0.0] for y in range(rows) for x in range(columns)])


def corners_of(pairs: list[tuple[Path, Path]], columns: int, rows: int, half_window: int) -> tuple[Corners, Corners]:
    """OpenCV's corners, both grids of a pair listed from the same end."""
    left: Corners = []
    right: Corners = []
    for pair in pairs:
        found = []
        for path in pair:
            image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
            ok, corners = cv2.findChessboardCorners(image, (columns, rows))
            assert ok, path
            window = (half_window, half_window)
            corners = cv2.cornerSubPix(image, corners.reshape(-1, 1, 2), window, (-1, -1), (3, 100, 0.01))
            found.append(corners.reshape(-1, 2).astype(float))
        if (found[0][-1] - found[0][0]) @ (found[1][-1] - found[1][0]) < 0:
            found[1] = found[1][::-1]
        left.append(found[0])
        right.append(found[1])
    return left, right


@pytest.fixture(scope="session")
def bouguet(data: Path) -> tuple[Corners, Corners]:
    folder = data / "calib" / "opencv_bouguet"
    numbers = [i for i in range(1, 15) if i != 10]
    return corners_of([(folder / f"left{i:02d}.jpg", folder / f"right{i:02d}.jpg") for i in numbers], 9, 6, 5)


@pytest.fixture(scope="session")
def bumblebee(data: Path) -> tuple[Corners, Corners]:
    folder = data / "calib" / "boofcv_Bumblebee2_Chess"
    return corners_of([(folder / f"left{i:02d}.jpg", folder / f"right{i:02d}.jpg") for i in range(1, 12)], 6, 4, 5)


@pytest.fixture(scope="module")
def synthetic() -> tuple[Corners, Corners, np.ndarray, ep.StereoCalibration]:
    """Eight noisy views of a known rig, projected by OpenCV."""
    rng = np.random.default_rng(5)
    board = grid(9, 6, 0.025)
    left = ep.CameraModel([[534, 0, 342], [0, 533, 235], [0, 0, 1]], [-0.28, 0.09, 1e-3, -3e-4], width=640, height=480)
    right = ep.CameraModel([[537, 0, 327], [0, 536, 250], [0, 0, 1]], [-0.29, 0.1, -5e-4, 4e-4], width=640, height=480)
    turn = cv2.Rodrigues(np.array([0.006, 0.008, -0.004]))[0]
    truth = ep.StereoCalibration(left, right, turn, [-0.0832, 9e-4, -2e-4])
    seen: tuple[Corners, Corners] = ([], [])
    for _ in range(8):
        pose = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0]
        points = board @ pose.T + [-0.08, -0.06, 0.38] + rng.uniform(-0.02, 0.02, 3)
        for corners, model, p in (
            (seen[0], left, points),
            (seen[1], right, points @ truth.rotation.T + truth.translation_m),
        ):
            pixels = cv2.projectPoints(p, np.zeros(3), np.zeros(3), model.camera_matrix, model.distortion)[0]
            corners.append(pixels.reshape(-1, 2) + rng.normal(0, 0.1, (len(board), 2)))
    return *seen, board, truth


def opencv_stereo(left: Corners, right: Corners, board: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """(rms, left matrix, right matrix, T) at the converged optimum of k1 k2 p1 p2."""
    boards = [board.astype(np.float32)] * len(left)
    lists = [[c.astype(np.float32) for c in side] for side in (left, right)]
    flags, stop = cv2.CALIB_FIX_K3, (3, 300, 1e-12)
    mono = [cv2.calibrateCamera(boards, side, SIZE, None, None, flags=flags, criteria=stop) for side in lists]
    (_, k1, d1, *_), (_, k2, d2, *_) = mono
    rms, k1, _, k2, _, _, t, *_ = cv2.stereoCalibrate(
        boards, *lists, k1, d1, k2, d2, SIZE, flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS, criteria=stop
    )
    return rms, k1, k2, t.ravel()


def vertical_px(calibration: ep.StereoCalibration, left: Corners, right: Corners) -> np.ndarray:
    """|Vertical disparity| of corners after rectification by OpenCV's routines."""
    turn = cv2.Rodrigues(cv2.Rodrigues(calibration.rotation)[0] / 2)[0]
    center = -turn.T @ calibration.translation_m
    axis = np.cross(center, [1.0, 0, 0])
    angle = math.atan2(float(np.linalg.norm(axis)), float(center[0]))
    level = cv2.Rodrigues(axis / np.linalg.norm(axis) * angle)[0]
    focal = (calibration.left.camera_matrix[1, 1] + calibration.right.camera_matrix[1, 1]) / 2
    rows = []
    for model, frame, side in ((calibration.left, level @ turn, left), (calibration.right, level @ turn.T, right)):
        pixels = np.concatenate(side)
        ideal = cv2.undistortPoints(pixels.reshape(-1, 1, 2), model.camera_matrix, model.distortion).reshape(-1, 2)
        rays = np.column_stack([ideal, np.ones(len(ideal))]) @ frame.T
        rows.append(focal * rays[:, 1] / rays[:, 2])
    return np.abs(rows[0] - rows[1])


def test_the_published_optimum_of_opencvs_photographs(bouguet: tuple[Corners, Corners]) -> None:
    left, right = bouguet
    board = grid(9, 6, 0.025)
    squared = ep.calibrate_points(left, right, [board] * 13, SIZE, loss="squared")
    robust = ep.calibrate_points(left, right, [board] * 13, SIZE)
    for found in (squared, robust):
        assert found.rms_px == pytest.approx(0.2153, abs=5e-4)
        assert found.baseline_m == pytest.approx(0.083183, abs=2e-5)
        assert found.left.camera_matrix[0, 0] == pytest.approx(533.56, abs=0.05)
        assert found.right.camera_matrix[0, 0] == pytest.approx(536.89, abs=0.05)
        assert found.epipolar_error_px < 0.1345
    # The same corners through OpenCV: one optimum. Its corners are float32.
    rms, k1, k2, t = opencv_stereo(left, right, board)
    assert squared.rms_px == pytest.approx(rms, rel=1e-6)
    np.testing.assert_allclose(squared.left.camera_matrix, k1, rtol=1e-4)
    np.testing.assert_allclose(squared.right.camera_matrix, k2, rtol=1e-4)
    np.testing.assert_allclose(squared.translation_m, t, atol=2e-6)


def test_the_bumblebee(bumblebee: tuple[Corners, Corners]) -> None:
    left, right = bumblebee
    found = ep.calibrate_points(left, right, [grid(6, 4, 0.03)] * 11, SIZE)
    assert found.baseline_m == pytest.approx(0.120, abs=6e-4)
    assert found.rms_px <= 0.10
    assert found.epipolar_error_px <= 0.06
    assert found.sigma["translation_x_m"] < 2e-4


def test_held_out_error_is_that_of_the_halves(bouguet: tuple[Corners, Corners]) -> None:
    left, right = bouguet
    board = grid(9, 6, 0.025)
    errors = []
    for first in (0, 1):
        fit = [i for i in range(13) if i % 2 != first]
        half = ep.calibrate_points(
            [left[i] for i in fit], [right[i] for i in fit], [board] * len(fit), SIZE, held_out=False
        )
        assert math.isnan(half.epipolar_error_px)
        errors.append(vertical_px(half, left[first::2], right[first::2]))
    whole = ep.calibrate_points(left, right, [board] * 13, SIZE)
    # OpenCV's removal of distortion stops after five iterations.
    assert whole.epipolar_error_px == pytest.approx(np.concatenate(errors).mean(), rel=1e-3)


def test_tsai_rectifies_real_photographs(bouguet: tuple[Corners, Corners]) -> None:
    left, right = bouguet
    found = ep.calibrate_points(left, right, [grid(9, 6, 0.025)] * 13, SIZE, method="tsai")
    assert found.epipolar_error_px < 0.3
    assert found.baseline_m == pytest.approx(0.0832, rel=0.01)
    assert vertical_px(found, left, right).mean() < 0.3


def test_optimum_and_covariance_are_scipys(
    synthetic: tuple[Corners, Corners, np.ndarray, ep.StereoCalibration],
) -> None:
    left, right, board, _ = synthetic
    found = ep.calibrate_points(left, right, [board] * 8, SIZE, loss="squared", model="brown5")
    assert list(found.sigma) == NAMES

    def residuals(x: np.ndarray) -> np.ndarray:
        cameras = x[:9], x[9:18]
        rig_turn = cv2.Rodrigues(x[18:21])[0] @ found.rotation
        rows = []
        for i, view in enumerate(found.views):
            step = x[24 + 6 * i : 30 + 6 * i]
            points = board @ (cv2.Rodrigues(step[:3])[0] @ view.rotation).T + view.translation_m + step[3:]
            for (fx, fy, cx, cy, *d), p, seen in zip(
                cameras, (points, points @ rig_turn.T + x[21:24]), (left[i], right[i]), strict=True
            ):
                k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
                pixels = cv2.projectPoints(p, np.zeros(3), np.zeros(3), k, np.array(d))[0].reshape(-1, 2)
                rows.append(pixels - seen)
        return np.concatenate(rows).ravel()

    start = np.zeros(24 + 6 * 8)
    for offset, model in ((0, found.left), (9, found.right)):
        k = model.camera_matrix
        start[offset : offset + 9] = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], *model.distortion]
    start[21:24] = found.translation_m
    r = residuals(start)
    assert found.rms_px == pytest.approx(math.sqrt(2 * np.mean(r**2)), rel=1e-9)
    # Three-point derivatives: the optimum must be SciPy's to a small part of its own uncertainty.
    best = least_squares(
        residuals, start, jac="3-point", x_scale="jac", xtol=1e-12, ftol=1e-14, gtol=1e-12, max_nfev=20
    )
    covariance = np.linalg.inv(best.jac.T @ best.jac) * (2 * best.cost / (r.size - start.size))
    sigma = np.sqrt(np.diag(covariance))[:24]
    assert np.abs((best.x - start)[:24] / sigma).max() < 1e-3
    np.testing.assert_allclose([found.sigma[name] for name in NAMES], sigma, rtol=1e-3)
    assert found.covariance is not None
    np.testing.assert_allclose(
        found.covariance / np.outer(sigma, sigma), covariance[:24, :24] / np.outer(sigma, sigma), atol=2e-3
    )


def test_outliers_are_left_out_and_named(
    synthetic: tuple[Corners, Corners, np.ndarray, ep.StereoCalibration],
) -> None:
    left, right, board, truth = synthetic
    broken = [c.copy() for c in right]
    broken[3][[7, 20, 33]] += [4.0, -3.0]
    clean = ep.calibrate_points(left, right, [board] * 8, SIZE)
    robust = ep.calibrate_points(left, broken, [board] * 8, SIZE)
    squared = ep.calibrate_points(left, broken, [board] * 8, SIZE, loss="squared")
    assert clean.outliers == squared.outliers == []
    assert [(o.view, o.side, o.corner) for o in robust.outliers] == [(3, "right", i) for i in (7, 20, 33)]
    assert all(4.5 < o.residual_px < 5.5 and "times" in o.reason for o in robust.outliers)
    assert robust.rms_px == pytest.approx(clean.rms_px, rel=0.02)
    shift_robust = abs(robust.baseline_m - clean.baseline_m)
    assert shift_robust < 0.3 * clean.sigma["translation_x_m"]
    assert shift_robust < 0.1 * abs(squared.baseline_m - clean.baseline_m)
    assert abs(clean.baseline_m - truth.baseline_m) < 4 * clean.sigma["translation_x_m"]
    # Corners left out are as if never seen.
    unseen = [c.copy() for c in right]
    unseen[3][[7, 20, 33]] = math.nan
    without = ep.calibrate_points(left, unseen, [board] * 8, SIZE)
    assert without.baseline_m == pytest.approx(robust.baseline_m, rel=1e-9)


def test_partial_and_single_views(synthetic: tuple[Corners, Corners, np.ndarray, ep.StereoCalibration]) -> None:
    left, right, board, truth = synthetic
    boards = [board] * 8
    pairs = ep.calibrate_points(left[:5], right[:5], boards[:5], SIZE, held_out=2)
    nothing = np.full((54, 2), math.nan)
    # Two boards that only the left camera saw, one that only the right one saw in part.
    part = right[7].copy()
    part[:20] = math.nan
    lefts, rights = [*left[:5], left[5], left[6], nothing], [*right[:5], nothing, nothing, part]
    found = ep.calibrate_points(lefts, rights, boards, SIZE, held_out=2)
    assert [math.isnan(v.right_rms_px) for v in found.views] == [False] * 5 + [True, True, False]
    assert [math.isnan(v.left_rms_px) for v in found.views] == [False] * 7 + [True]
    for name in ("left_fx", "left_cx", "right_fx", "right_cx"):
        assert found.sigma[name] < 0.99 * pairs.sigma[name]
    assert found.sigma["left_fx"] / pairs.sigma["left_fx"] < found.sigma["right_fx"] / pairs.sigma["right_fx"]
    assert abs(found.baseline_m - truth.baseline_m) < 4 * found.sigma["translation_x_m"]
    # Held-out errors are those of the pairs; views of one camera are fitted always.
    # With fewer than four views a part each view is left out alone.
    alone = []
    for out in range(5):
        fit = [i for i in range(8) if i != out]
        rest = ep.calibrate_points([lefts[i] for i in fit], [rights[i] for i in fit], [board] * 7, SIZE)
        alone.append(vertical_px(rest, left[out : out + 1], right[out : out + 1]))
    assert found.epipolar_error_px == pytest.approx(np.concatenate(alone).mean(), rel=1e-3)
    with pytest.raises(ValueError, match="both cameras saw"):
        ep.calibrate_points([*left[:4], *[nothing] * 4], [*[nothing] * 4, *right[4:]], boards, SIZE)
    with pytest.raises(ValueError, match="NaN in both"):
        ep.calibrate_points([np.where(np.arange(2) == 0, math.nan, left[0]), *left[1:]], right, boards, SIZE)


def seen_through(
    lens: str, coefficients: list[float], *, noise_px: float
) -> tuple[Corners, Corners, np.ndarray, float]:
    """Sixteen views of a large board by two like cameras, projected by OpenCV; and the baseline, metres."""
    rng = np.random.default_rng(11)
    board = grid(11, 8, 0.04)
    matrix = np.array([[330.0, 0, 322.0], [0, 331.0, 238.0], [0, 0, 1]])
    turn, shift = cv2.Rodrigues(np.array([0.01, -0.02, 0.005]))[0], np.array([-0.12, 0.002, 0.001])
    seen: tuple[Corners, Corners] = ([], [])
    while len(seen[0]) < 16:
        pose = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0]
        points = (board - board.mean(axis=0)) @ pose.T + [*rng.uniform(-0.12, 0.12, 2), rng.uniform(0.3, 0.5)]
        pixels = []
        for p in (points, points @ turn.T + shift):
            project = cv2.fisheye.projectPoints if lens == "fisheye" else cv2.projectPoints
            at = project(p.reshape(-1, 1, 3), np.zeros(3), np.zeros(3), matrix, np.array(coefficients))[0]
            pixels.append(at.reshape(-1, 2) + rng.normal(0, noise_px, (len(board), 2)))
        if all((p > 0).all() and (p < np.array(SIZE) - 1).all() for p in pixels):
            seen[0].append(pixels[0])
            seen[1].append(pixels[1])
    return *seen, board, float(np.linalg.norm(shift))


@pytest.mark.parametrize(
    ("model", "lens", "coefficients"),
    [
        ("brown5", "brown-conrady", [-0.3, 0.12, 1e-3, -5e-4, -0.02]),
        ("rational", "rational", [0.6, 0.1, 1e-3, -5e-4, 0.01, 0.95, 0.3, 0.03]),
        ("thin-prism", "thin-prism", [0.6, 0.1, 1e-3, -5e-4, 0.01, 0.95, 0.3, 0.03, 4e-3, -2e-3, -3e-3, 1e-3]),
        ("fisheye", "kannala-brandt", [-0.03, 0.01, -0.005, 0.001]),
    ],
)
def test_every_lens_is_recovered(model: str, lens: str, coefficients: list[float]) -> None:
    left, right, board, baseline_m = seen_through(model, coefficients, noise_px=0.1)
    found = ep.calibrate_points(left, right, [board] * 16, SIZE, model=model)  # type: ignore[arg-type]
    assert found.left.lens == found.right.lens == lens
    assert len(found.left.distortion) == len(coefficients)
    parameters = 2 * (4 + len(coefficients)) + 6 + 6 * 16
    assert found.rms_px == pytest.approx(0.1 * math.sqrt(2 - 2 * parameters / (4 * 88 * 16)), rel=0.03)
    assert abs(found.baseline_m - baseline_m) < 4 * found.sigma["translation_x_m"]
    names = [name.removeprefix("left_") for name in found.sigma if name.startswith("left_")][4:]
    for name, value, truth in zip(names, found.left.distortion, coefficients, strict=True):
        assert abs(value - truth) < 4.5 * found.sigma[f"left_{name}"], name
    # A lens that bends less cannot follow.
    if model != "brown5":
        assert ep.calibrate_points(left, right, [board] * 16, SIZE, held_out=False).rms_px > 1.02 * found.rms_px


def test_the_lens_is_chosen_by_held_out_error() -> None:
    fisheye = seen_through("fisheye", [-0.05, 0.03, -0.02, 0.004], noise_px=0.02)
    plain = seen_through("brown", [-0.25, 0.08, 1e-3, 0.0, 0.0], noise_px=0.1)
    for (left, right, board, _), lenses in ((fisheye, {"kannala-brandt", "rational"}), (plain, {"brown-conrady"})):
        chosen = ep.calibrate_points(left, right, [board] * 16, SIZE, model="auto")
        assert chosen.left.lens in lenses
        simple = ep.calibrate_points(left, right, [board] * 16, SIZE)
        assert chosen.epipolar_error_px <= 1.0001 * simple.epipolar_error_px


def test_parameters_are_held_and_shared(
    synthetic: tuple[Corners, Corners, np.ndarray, ep.StereoCalibration],
) -> None:
    left, right, board, truth = synthetic

    def fit(**options: object) -> ep.StereoCalibration:
        return ep.calibrate_points(left, right, [board] * 8, SIZE, held_out=False, **options)  # type: ignore[arg-type]

    held = fit(fix=["cx", "right_cy", "lens"])
    assert held.left.camera_matrix[0, 2] == held.right.camera_matrix[0, 2] == 319.5
    assert held.right.camera_matrix[1, 2] == 239.5
    assert held.left.camera_matrix[1, 2] != 239.5
    assert not held.left.distortion.any()
    assert held.sigma["left_cx"] == held.sigma["right_cy"] == held.sigma["right_k1"] == 0.0
    assert held.sigma["left_cy"] > 0
    shared = fit(share=["fx", "lens"], square_pixels=True)
    np.testing.assert_array_equal(shared.left.distortion, shared.right.distortion)
    focal = {shared.left.camera_matrix[i, i] for i in (0, 1)} | {shared.right.camera_matrix[i, i] for i in (0, 1)}
    assert len(focal) == 1
    assert shared.sigma["left_fx"] == shared.sigma["right_fy"] > 0
    # Constraints cost fit; for the noise that is left, certainty grows.
    free = fit()
    assert shared.rms_px > free.rms_px
    assert shared.sigma["left_fx"] / shared.rms_px < free.sigma["left_fx"] / free.rms_px
    intrinsics = ["fx", "fy", "cx", "cy", "lens"]
    extrinsic = fit(fix=intrinsics, initial=truth)
    assert extrinsic.left == truth.left
    assert extrinsic.right == truth.right
    assert abs(extrinsic.baseline_m - truth.baseline_m) < 4 * extrinsic.sigma["translation_x_m"]
    assert extrinsic.sigma["translation_x_m"] < free.sigma["translation_x_m"]
    again = fit(initial=free)
    assert again.baseline_m == pytest.approx(free.baseline_m, rel=1e-8)
    with pytest.raises(ValueError, match="initial calibration"):
        fit(fix=["fx"])
    with pytest.raises(ValueError, match="k9"):
        fit(fix=["k9"])
    with pytest.raises(ValueError, match="kannala-brandt"):
        fit(model="fisheye", initial=truth)


def test_a_bent_board_is_straightened(
    synthetic: tuple[Corners, Corners, np.ndarray, ep.StereoCalibration],
) -> None:
    *_, board, truth = synthetic
    rng = np.random.default_rng(2)
    x, y = ((board[:, i] - board[:, i].mean()) / np.ptp(board[:, i]) * 2 for i in (0, 1))
    bent = board.copy()
    bent[:, 2] = 8e-4 * (1 - x**2) - 3e-4 * (1 - y**2)
    left, right = [], []
    for _ in range(12):
        pose = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0]
        points = bent @ pose.T + [-0.08, -0.06, 0.38] + rng.uniform(-0.02, 0.02, 3)
        left.append(truth.left.project(points) + rng.normal(0, 0.1, (54, 2)))
        right.append(truth.right.project(points @ truth.rotation.T + truth.translation_m) + rng.normal(0, 0.1, (54, 2)))
    flat = ep.calibrate_points(left, right, [board] * 12, SIZE)
    found = ep.calibrate_points(left, right, [board] * 12, SIZE, warp=True)
    assert flat.board_warp_m is None
    assert found.board_warp_m is not None
    assert found.board_warp_sigma_m is not None
    assert (np.abs(found.board_warp_m - [8e-4, -3e-4]) < 4 * found.board_warp_sigma_m).all()
    assert (found.board_warp_sigma_m < 1e-4).all()
    assert found.rms_px < flat.rms_px
    assert abs(found.baseline_m - truth.baseline_m) < 4 * found.sigma["translation_x_m"]


def test_bad_input_is_refused_in_words(
    synthetic: tuple[Corners, Corners, np.ndarray, ep.StereoCalibration],
) -> None:
    left, right, board, _ = synthetic
    boards = [board] * 8
    with pytest.raises(ValueError, match="7 views"):
        ep.calibrate_points(left[:7], right, boards, SIZE)
    with pytest.raises(ValueError, match="board views: 1 given"):
        ep.calibrate_points(left[:1], right[:1], boards[:1], SIZE)
    with pytest.raises(ValueError, match=r"left_px\[2\]"):
        ep.calibrate_points([*left[:2], np.zeros((54, 3)), *left[3:]], right, boards, SIZE)
    with pytest.raises(ValueError, match="inf"):
        ep.calibrate_points([*left[:2], np.full((54, 2), math.inf), *left[3:]], right, boards, SIZE)
    unseen = np.full((54, 2), math.nan)
    with pytest.raises(ValueError, match="corners in one view"):
        ep.calibrate_points([*left[:2], unseen, *left[3:]], [*right[:2], unseen, *right[3:]], boards, SIZE)
    with pytest.raises(ValueError, match="held_out = 1"):
        ep.calibrate_points(left, right, boards, SIZE, held_out=1)
    with pytest.raises(ValueError, match="model"):
        ep.calibrate_points(left, right, boards, SIZE, model="brown6")  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="method"):
        ep.calibrate_points(left, right, boards, SIZE, method="zhang")  # type: ignore[arg-type]
    with pytest.raises(ep.Error, match="swapped"):
        ep.calibrate_points(right, left, boards, SIZE)
    with pytest.raises(ep.Error, match="other end"):
        ep.calibrate_points(left, [right[0][::-1], *right[1:]], boards, SIZE)


def test_negative_sizes_are_named() -> None:
    with pytest.raises(ValueError, match="width = -1"):
        ep.CameraModel(np.eye(3), np.zeros(5), width=-1, height=3)
    corners, board = [np.zeros((54, 2))] * 3, [ep.Chessboard().points_m] * 3
    with pytest.raises(ValueError, match="image_size = -640"):
        ep.calibrate_points(corners, corners, board, (-640, 480))
