"""Rig files: exact round trips, and errors that name the file, the entry and the value."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import epiline as ep
from epiline.cli.arguments import load_rig


def rotation(vector: list[float]) -> np.ndarray:
    """Rodrigues' formula."""
    angle = float(np.linalg.norm(vector))
    x, y, z = np.asarray(vector) / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k


def camera(fx: float, cx: float) -> ep.CameraModel:
    matrix = [[fx, 0, cx], [0, fx * 1.01, 235.5], [0, 0, 1]]
    return ep.CameraModel(matrix, [-0.28, 0.09, 1.2e-3, -3e-4, 1 / 3], width=640, height=480)


def bare_rig() -> ep.StereoCalibration:
    return ep.StereoCalibration(
        camera(533.1, 342.7), camera(536.9, 327.3), rotation([0.01, -0.02, 0.005]), [-0.12, 1e-3, -2e-4]
    )


@pytest.fixture(scope="module")
def rig() -> ep.StereoCalibration:
    """A calibrated rig: covariance, views and errors known."""
    truth = bare_rig()
    board = np.array([[x * 0.03, y * 0.03, 0.0] for y in range(5) for x in range(7)])
    rng = np.random.default_rng(0)
    left, right = [], []
    for _ in range(6):
        points = board @ rotation(rng.uniform(-0.5, 0.5, 3)).T + [-0.08, -0.05, 0.5]
        noise = rng.normal(0, 0.1, (2, len(board), 2))
        left.append(truth.left.project(points) + noise[0])
        right.append(truth.right.project(points @ truth.rotation.T + truth.translation_m) + noise[1])
    return ep.calibrate_points(left, right, [board] * 6, (640, 480))


def test_a_round_trip_is_exact(rig: ep.StereoCalibration, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    rig.save(path)
    back = ep.StereoCalibration.load(path)
    assert back == rig
    assert rig.covariance is not None
    assert back.covariance is not None
    assert np.array_equal(back.covariance, rig.covariance)
    assert back.sigma == rig.sigma
    assert back.epipolar_error_px == rig.epipolar_error_px > 0
    assert len(back.views) == 6
    assert back.range_sigma(3.0) == rig.range_sigma(3.0) > 0
    assert list(tmp_path.iterdir()) == [path], "no temporary file is left"


def test_what_is_unknown_stays_unknown(tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    bare_rig().save(path)
    back = ep.StereoCalibration.load(path)
    assert math.isnan(back.rms_px)
    assert math.isnan(back.epipolar_error_px)
    assert math.isnan(back.range_sigma(1.0))
    assert back.covariance is None
    assert back.sigma == {}
    assert back.views == []
    assert back.left == bare_rig().left


def test_it_is_ordinary_yaml(rig: ep.StereoCalibration, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    rig.save(path)
    text = path.read_text()
    for line in ("format: epiline stereo rig", "version: 1", "left:", "right_from_left:", "  translation_m: ["):
        assert line in text
    assert "fx_px: " in text


BREAKAGES = [
    ("missing", r"\n  k2: [^\n]*", "", "left.k2", "is missing"),
    ("empty", r"(\n  k2:)[^\n]*", r"\1", "left.k2", "is missing"),
    ("NaN", r"(\n  fx_px:)[^\n]*", r"\1 .nan", "left.fx_px", "NaN"),
    ("infinite", r"(\n  cx_px:)[^\n]*", r"\1 .inf", "left.cx_px", "inf"),
    ("overflowing", r"(\n  cx_px:)[^\n]*", r"\1 1e999", "left.cx_px", "inf"),
    ("huge", r"(\n  cx_px:)[^\n]*", r"\1 1e30", "left.cx_px", "no larger than"),
    ("negative focal", r"(\n  fy_px:)[^\n]*", r"\1 -500.0", "left.fy_px", "-500"),
    ("text for a number", r"(\n  p1:)[^\n]*", r"\1 about zero", "left.p1", "about zero"),
    ("a huge image", r"(\n  width_px:)[^\n]*", r"\1 99999999999999999999", "left.width_px", "100000000000000000000"),
    ("half a pixel", r"(\n  height_px:)[^\n]*", r"\1 480.5", "left.height_px", "480.5"),
    ("no pixels", r"(\n  height_px:)[^\n]*", r"\1 0", "left.height_px", "0"),
    ("another lens", r"(\n  lens:)[^\n]*", r"\1 fisheye", "left.lens", "fisheye"),
    ("two numbers", r"(\n  translation_m:)[^\n]*", r"\1 [1, 2]", "right_from_left.translation_m", "a list of 2"),
    ("NaN in a list", r"(\n  translation_m:)[^\n]*", r"\1 [.nan, 0, 0]", "right_from_left.translation_m[0]", "NaN"),
    ("no baseline", r"(\n  translation_m:)[^\n]*", r"\1 [0, 0, 0]", "baseline_m", "0 m"),
    ("no rotation", r"(\n  rotation:\n *- )[^\n]*", r"\1[2, 0, 0]", "right_from_left.rotation", "no rotation"),
    ("another version", r"version: 1", "version: 2", "version", "must be 1"),
    ("another file", r"format: [^\n]*", "format: camera_info", "format", "camera_info"),
    ("a list for a table", r"^[\s\S]*", "- 1\n- 2\n...", "document", "a list of 2"),
    ("not YAML", r"^[\s\S]*", "left: [1, 2\nright: }", "document", "not valid YAML"),
    ("empty file", r"^[\s\S]*", "", "document", "is empty"),
]


@pytest.mark.parametrize(
    ("pattern", "replacement", "entry", "reason"), [b[1:] for b in BREAKAGES], ids=[b[0] for b in BREAKAGES]
)
def test_a_bad_entry_is_named(
    rig: ep.StereoCalibration, tmp_path: Path, pattern: str, replacement: str, entry: str, reason: str
) -> None:
    path = tmp_path / "broken rig.yaml"
    rig.save(path)
    broken, count = re.subn(pattern, replacement, path.read_text(), count=1)
    assert count == 1
    path.write_text(broken)
    with pytest.raises(ep.Error, match="broken rig") as caught:
        ep.StereoCalibration.load(path)
    message = str(caught.value)
    assert "\n" not in message
    assert f"'{entry}'" in message
    assert reason in message


def test_a_truncated_file_is_never_a_rig(rig: ep.StereoCalibration, tmp_path: Path) -> None:
    path = tmp_path / "rig.yaml"
    rig.save(path)
    text = path.read_text()
    whole = len(text.rstrip())
    # Between the lines, and within numbers, lists and names wherever the covariance and the views are.
    between = [i for i, c in enumerate(text) if c == "\n" and i < whole]
    for end in [*between, *range(0, whole, 397), whole - 1]:
        path.write_text(text[:end])
        with pytest.raises(ep.Error, match=r"rig\.yaml"):
            ep.StereoCalibration.load(path)
    path.write_text(text[:whole])
    assert ep.StereoCalibration.load(path) == rig


def test_files_that_cannot_be_read_or_written(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"nowhere\.yaml"):
        ep.StereoCalibration.load(tmp_path / "nowhere.yaml")
    with pytest.raises(OSError, match="nowhere"):
        bare_rig().save(tmp_path / "nowhere" / "rig.yaml")
    folder = tmp_path / "folder"
    folder.mkdir()
    with pytest.raises(OSError, match="folder"):
        bare_rig().save(folder)
    assert list(tmp_path.iterdir()) == [folder], "no temporary file is left"
    (tmp_path / "binary.yaml").write_bytes(b"\x89PNG\r\n\xff\x00")
    with pytest.raises(ep.Error, match="not UTF-8"):
        ep.StereoCalibration.load(tmp_path / "binary.yaml")


def test_a_failed_write_leaves_the_old_file(tmp_path: Path, rig: ep.StereoCalibration) -> None:
    path = tmp_path / "rig.yaml"
    bare_rig().save(path)
    rig.save(path)
    assert ep.StereoCalibration.load(path) == rig


def test_impossible_cameras_are_refused() -> None:
    matrix = [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]
    with pytest.raises(ValueError, match="fx"):
        ep.CameraModel([[math.nan, 0, 320], [0, 500, 240], [0, 0, 1]], [0] * 5, width=640, height=480)
    with pytest.raises(ValueError, match="camera_matrix"):
        ep.CameraModel([[500, 3.0, 320], [0, 500, 240], [0, 0, 1]], [0] * 5, width=640, height=480)
    with pytest.raises(ValueError, match="4, 5, 8 or 12"):
        ep.CameraModel(matrix, [0] * 7, width=640, height=480)
    with pytest.raises(ValueError, match="tilted sensor"):
        ep.CameraModel(matrix, [0] * 12 + [0.01, 0], width=640, height=480)
    with pytest.raises(ValueError, match="4 coefficients"):
        ep.CameraModel(matrix, [0] * 5, width=640, height=480, lens="kannala-brandt")
    with pytest.raises(ValueError, match="expected one of brown-conrady"):
        ep.CameraModel(matrix, [0] * 5, width=640, height=480, lens="pinhole")
    good = ep.CameraModel(matrix, [0] * 5, width=640, height=480)
    with pytest.raises(ValueError, match="rotation"):
        ep.StereoCalibration(good, good, np.diag([1.0, 1, -1]), [-0.1, 0, 0])
    with pytest.raises(ValueError, match="baseline_m"):
        ep.StereoCalibration(good, good, np.eye(3), [0, 0, 0])


def test_projection_and_its_inverse() -> None:
    model = camera(533.1, 342.7)
    points = np.array([[0.1, -0.05, 0.6], [-0.2, 0.1, 0.9], [0.0, 0.0, -1.0]])
    pixels = model.project(points)
    assert np.isnan(pixels[2]).all(), "behind the camera"
    ideal = points[:2, :2] / points[:2, 2:]
    expected = ideal * [533.1, 533.1 * 1.01] + [342.7, 235.5]
    np.testing.assert_allclose(model.undistort(pixels[:2]), expected, atol=1e-9)


KARLSRUHE = """\
roi: 2.6e+01 1.369e+03 7.0e+01 4.41e+02
P1_roi: 6.452401e+02 0 6.359587e+02 0 0 6.452401e+02 1.941291e+02 0 0 0 1 0
P2_roi: 6.452401e+02 0 6.359587e+02 -3.682632e+02 0 6.452401e+02 1.941291e+02 0 0 0 1 0
"""


def aligned_geometry(path: Path) -> ep.RectifiedGeometry:
    geometry = load_rig(path)
    assert isinstance(geometry, ep.RectifiedGeometry)
    return geometry


def test_the_karlsruhe_projection(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(KARLSRUHE)
    found = aligned_geometry(path)
    assert found.baseline_m == pytest.approx(368.2632 / 645.2401)
    assert (found.width, found.height) == (1344, 372)
    assert (found.focal_px, found.cx_px, found.cy_px, found.doffs_px) == (645.2401, 635.9587, 194.1291, 0.0)


@pytest.mark.parametrize(
    ("old", "new", "entry", "reason"),
    [
        ("P2_roi", "P3_roi", "P2_roi", "is missing"),
        ("-3.682632e+02", "nan", "P2_roi", "'nan'"),
        ("-3.682632e+02", "3.682632e+02", "P2_roi", "left of the left"),
        ("-3.682632e+02", "", "P2_roi", "11 numbers"),
        ("1.941291e+02 0 0 0 1 0\nP2", "1.95e+02 0 0 0 1 0\nP2", "P2_roi", "not aligned"),
        ("1.369e+03", "1.0", "roi", "no image"),
    ],
)
def test_a_bad_karlsruhe_entry_is_named(tmp_path: Path, old: str, new: str, entry: str, reason: str) -> None:
    path = tmp_path / "calib.txt"
    assert old in KARLSRUHE
    path.write_text(KARLSRUHE.replace(old, new))
    with pytest.raises(ep.Error) as caught:
        load_rig(path)
    assert "calib.txt" in str(caught.value)
    assert f"'{entry}'" in str(caught.value)
    assert reason in str(caught.value)


def test_the_real_karlsruhe_file(data: Path) -> None:
    found = aligned_geometry(data / "karlsruhe_2010_03_09_drive_0023" / "calib.txt")
    assert found.focal_px == pytest.approx(645.24, abs=0.005)
    assert found.baseline_m == pytest.approx(0.5707, abs=5e-5)
    assert (found.cx_px, found.cy_px) == pytest.approx((635.96, 194.13), abs=0.005)


def test_content_decides_what_a_rig_file_is(rig: ep.StereoCalibration, tmp_path: Path) -> None:
    """Not its name: a rig of ours called .txt is one, and a text that is none is refused as what it is."""
    path = tmp_path / "rig.txt"
    rig.save(path, format="epiline")
    assert load_rig(path) == rig
    path.write_text("it rained all day\n")
    with pytest.raises(ep.Error, match=r"rig\.txt.*'document' is 'it rained all day': no rig file of a known"):
        load_rig(path)
    path.write_text("P0: 700 0 300 0 0 700 200 0 0 0 1 0\n")
    with pytest.raises(ep.Error, match="image_size"):
        load_rig(path)


def test_outliers_and_the_boards_bend_are_kept(tmp_path: Path) -> None:
    """Exactly, as everything else; a file without them, as older ones are, has none."""
    truth = bare_rig()
    board = np.array([[x * 0.03, y * 0.03, 0.0] for y in range(5) for x in range(7)])
    rng = np.random.default_rng(1)
    left, right = [], []
    for _ in range(8):
        points = board @ rotation(rng.uniform(-0.5, 0.5, 3)).T + [-0.08, -0.05, 0.5]
        left.append(truth.left.project(points) + rng.normal(0, 0.1, (len(board), 2)))
        in_right = points @ truth.rotation.T + truth.translation_m
        right.append(truth.right.project(in_right) + rng.normal(0, 0.1, (len(board), 2)))
    left[2][7] += [4.0, 3.0]
    right[5][20] -= [2.0, 6.0]
    bent = ep.calibrate_points(left, right, [board] * 8, (640, 480), warp=True)
    assert [(o.view, o.side, o.corner) for o in bent.outliers] == [(2, "left", 7), (5, "right", 20)]
    path = tmp_path / "rig.yaml"
    bent.save(path)
    back = ep.StereoCalibration.load(path)
    assert back == bent
    assert back.outliers == bent.outliers
    assert [o.reason for o in back.outliers] == [o.reason for o in bent.outliers]
    assert back.board_warp_m is not None
    assert bent.board_warp_m is not None
    assert np.array_equal(back.board_warp_m, bent.board_warp_m)
    text = path.read_text()
    older = text[: text.index("board_warp:")] + "...\n"
    path.write_text(older)
    back = ep.StereoCalibration.load(path)
    assert back.outliers == []
    assert back.board_warp_m is None
    assert back.views == bent.views
    for old, new, entry in [
        ("side: left", "side: top", r"outliers\[0\]\.side"),
        ("corner: 7", "corner: -7", r"outliers\[0\]\.corner"),
        ("residual_px: ", "residual_px: -", r"outliers\[0\]\.residual_px"),
        ("height_m: [", "height_m: [0.1, ", r"board_warp\.height_m"),
    ]:
        assert old in text
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(ep.Error, match=entry):
            ep.StereoCalibration.load(path)
