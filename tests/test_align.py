"""Alignment without calibration: accuracy against known cameras, and refusal of everything that cannot carry it."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep
from epiline.cli import main
from epiline.sources.rendered import RenderedRig
from epiline.sources.rendered.camera import BrownCamera

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]


def rows_apart_px(aligned: ep.PairAlignment, left_px: Floats, right_px: Floats) -> Floats:
    """Vertical disparity of raw pixels after alignment, through OpenCV's undistortion, not ours."""
    assert aligned.lens is not None
    rows = []
    for lens, homography, pixels in zip(aligned.lens, aligned.homographies, (left_px, right_px), strict=True):
        matrix, distortion = lens.camera_matrix, lens.distortion
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        straight = cv2.undistortPoints(pixels[:, None], matrix, distortion, P=matrix, criteria=criteria)
        rows.append(cv2.perspectiveTransform(straight, homography)[:, 0, 1])
    return np.asarray(rows[1] - rows[0], dtype=np.float64)


def texture(seed: int, width: int = 640, height: int = 480) -> Image:
    random = np.random.default_rng(seed)
    levels = sum(cv2.GaussianBlur(random.normal(size=(height, width)), (0, 0), s) * s for s in (1.5, 3.0, 8.0))
    return np.clip(128 + 60 * levels / np.std(levels) * 0.7, 0, 255).astype(np.uint8)


@functools.cache
def boxes_pair(turn_deg: tuple[float, float, float], seed: int = 5) -> tuple[Image, Image, ep.CameraModel, Floats]:
    """Textured squares at several depths before a wall, seen by two equal pinhole cameras: painted by homographies.

    Returns the pair, the lens and (N, 4) exact matches (x, y left; x, y right), pixels.
    """
    focal, width, height = 560.0, 640, 480
    K = np.array([[focal, 0, 319.5], [0, focal, 239.5], [0, 0, 1]])
    R, _ = cv2.Rodrigues(np.radians(turn_deg))
    t = R @ np.array([-0.12, 0.004, -0.003])
    pair = [np.zeros((height, width), np.uint8) for _ in range(2)]
    random = np.random.default_rng(seed)
    matches = []
    squares = [(0.0, 0.0, 4.0, 6.0)]
    squares += [(random.uniform(-1, 1), random.uniform(-0.7, 0.7), z, 0.5) for z in (2.8, 2.4, 2.0, 1.7, 1.4, 1.2)]
    for i, (x, y, z, side) in enumerate(squares):
        paint = texture(seed + i, 900, 900)
        tilt, _ = cv2.Rodrigues(np.radians(random.uniform(-25, 25, 3)))
        # Pixel of the painting to a point of the left camera's frame.
        scale = side / 900
        plane = np.column_stack([tilt[:, 0] * scale, tilt[:, 1] * scale, [x, y, z]])
        plane[:, 2] -= 450 * (plane[:, 0] + plane[:, 1])
        for camera, (rotation, shift) in enumerate(((np.eye(3), np.zeros(3)), (R, t))):
            H = K @ (rotation @ plane + np.outer(shift, [0, 0, 1]))
            seen = cv2.warpPerspective(paint, H, (width, height), flags=cv2.INTER_AREA)
            there = cv2.warpPerspective(np.full_like(paint, 255), H, (width, height))
            pair[camera] = np.where(there == 255, seen, pair[camera])
        spots = random.uniform(0, 900, (200, 2))
        points = np.column_stack([spots, np.ones(len(spots))]) @ plane.T
        left, right = points @ K.T, (points @ R.T + t) @ K.T
        both = np.column_stack([left[:, :2] / left[:, 2:], right[:, :2] / right[:, 2:]])
        inside = (both > 0).all(1) & (both[:, ::2] < width).all(1) & (both[:, 1::2] < height).all(1)
        matches.append(both[inside])
    lens = ep.CameraModel(K, np.zeros(4), width=width, height=height)
    return pair[0], pair[1], lens, np.concatenate(matches)


@pytest.mark.parametrize(
    ("turn_deg", "known"), [((1.5, 2.0, -1.0), True), ((-2.0, -4.0, 3.0), True), ((0.5, 1.5, 1.0), False)]
)
def test_rows_agree_where_the_truth_says(turn_deg: tuple[float, float, float], known: bool) -> None:
    left, right, lens, matches = boxes_pair(turn_deg)
    aligned = ep.align(left, right, lens if known else None)
    assert aligned.trusted, aligned.reason
    apart = np.abs(rows_apart_px(aligned, matches[:, :2], matches[:, 2:]))
    assert apart.mean() < (0.1 if known else 0.3)
    # Held-out error and sigma are of the size of the truth.
    assert aligned.epipolar_error_px < 0.3
    assert aligned.sigma_px < 0.5
    assert aligned.matches >= 100


def test_the_aligned_images_are_aligned() -> None:
    left, right, lens, matches = boxes_pair((1.5, 2.0, -1.0))
    aligned = ep.align(left, right, lens)
    after = ep.alignment_error(
        aligned.left, aligned.right, left_valid=aligned.left_valid, right_valid=aligned.right_valid
    )
    assert np.median(np.abs(matches[:, 3] - matches[:, 1])) > 5
    assert after.median_px < 0.2
    assert np.median(after.left_px[:, 0] - after.right_px[:, 0]) > 0


def turned(image: Image) -> Image:
    """What the camera sees after turning about its own centre."""
    K = np.array([[560.0, 0, 319.5], [0, 560.0, 239.5], [0, 0, 1]])
    R, _ = cv2.Rodrigues(np.radians((0.5, 1.5, -0.7)))
    return np.asarray(cv2.warpPerspective(image, K @ R @ np.linalg.inv(K), (640, 480)), dtype=np.uint8)


def plane_seen_twice() -> tuple[Image, Image]:
    """A tilted poster and nothing else."""
    H = np.array([[1.02, 0.03, -35.0], [0.004, 1.0, 3.0], [6e-5, 2e-5, 1.0]])
    poster = texture(9, 900, 700)
    shift = np.array([[1, 0, -120.0], [0, 1, -100.0], [0, 0, 1]])
    return tuple(cv2.warpPerspective(poster, m, (640, 480)) for m in (shift, H @ shift))  # type: ignore[return-value]


NAMES = "blank", "unrelated", "identical", "turned", "plane", "swapped", "mirrored", "upside down", "noise"


@functools.cache
def hopeless() -> dict[str, tuple[Image, Image]]:
    left, right, _, _ = boxes_pair((0.5, 1.0, -0.5))
    blank = np.full_like(left, 90)
    return {
        "blank": (blank, blank),
        "unrelated": (left, boxes_pair((0.0, 0.0, 0.0), seed=77)[0]),
        "identical": (left, left),
        "turned": (left, turned(left)),
        "plane": plane_seen_twice(),
        "swapped": (right, left),
        "mirrored": (left, np.ascontiguousarray(right[:, ::-1])),
        "upside down": (left, np.ascontiguousarray(right[::-1, ::-1])),
        "noise": (texture(1), texture(2)),
    }


@pytest.mark.parametrize("name", [*NAMES, "plane, lens known", "turned, lens known"])
def test_what_cannot_carry_an_alignment_is_not_trusted(name: str) -> None:
    name, _, known = name.partition(", ")
    left, right = hopeless()[name]
    aligned = ep.align(left, right, boxes_pair((0.5, 1.0, -0.5))[2] if known else None)
    assert not aligned.trusted
    assert aligned.reason
    assert aligned.left.shape == left.shape
    words = {"identical": "plane", "turned": "plane", "plane": "plane", "swapped": "swapped", "blank": "too few"}
    assert words.get(name, "") in aligned.reason


def test_bouguet_pairs_one_at_a_time(data: Path) -> None:
    """The 13 pairs of OpenCV's samples: judged on board corners that the alignment did not get."""
    folder = data / "calib" / "opencv_bouguet"
    names = [sorted(folder.glob(f"{side}[0-9][0-9].jpg")) for side in ("left", "right")]
    observations = ep.find_boards(*names, ep.Chessboard(columns=9, rows=6, square_m=0.03))
    calibration = ep.calibrate(observations, held_out=False)
    known, raw, trusted = [], [], []
    # Every sixth here; benchmarks/align_anchors.py prints all.
    for view in observations.accepted[::6]:
        pair = [cv2.imread(str(folder / n), cv2.IMREAD_GRAYSCALE) for n in (view.name_left, view.name_right)]
        assert view.left_px is not None
        assert view.right_px is not None
        for lens, errors in (((calibration.left, calibration.right), known), (None, raw)):
            aligned = ep.align(pair[0], pair[1], lens)
            errors.append(float(np.mean(np.abs(rows_apart_px(aligned, view.left_px, view.right_px)))))
        trusted.append(aligned.trusted)
    assert np.median(known) < 0.182
    assert max(known) < 0.356
    assert all(error < 1 for error, good in zip(raw, trusted, strict=True) if good)


def test_arguments_are_checked() -> None:
    left, right, lens, _ = boxes_pair((0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="640x480 px"):
        ep.align(left, right[:-1])
    small = ep.CameraModel(lens.camera_matrix, lens.distortion, width=320, height=240)
    with pytest.raises(ValueError, match="one size"):
        ep.align(left, right, small)
    with pytest.raises(ValueError, match="lens"):
        ep.align(left, right, (lens, "lens"))  # type: ignore[arg-type]


@pytest.mark.parametrize("axis", ["pitch", "yaw", "roll"])
@pytest.mark.parametrize("degrees", [0.05, -0.05])
def test_a_turned_camera_is_recognised_and_corrected(axis: str, degrees: float) -> None:
    rig = RenderedRig(seed=3)
    pairs = [(frame.left, frame.right) for frame in rig.frames(6)]
    held = drift_of(truth_calibration(rig), pairs)
    wrong = turned_right(truth_calibration(rig), axis, degrees)
    drift = drift_of(wrong, pairs, reference=held)
    assert abs(np.degrees(drift.values[axis]) + degrees) < max(0.2 * abs(degrees), 3 * np.degrees(drift.sigma[axis]))
    if axis != "yaw":
        # Rows of few pairs show a yaw no better than its sigma says.
        assert drift.axis == axis
        assert abs(np.degrees(drift.values[axis]) + degrees) < 0.2 * abs(degrees)
        again = drift_of(ep.realign(wrong, drift), pairs, reference=held)
        assert abs(again.values[axis]) < 0.2 * abs(np.radians(degrees))
        assert again.axis is None


def truth_calibration(rig: RenderedRig) -> ep.StereoCalibration:
    def model(camera: BrownCamera) -> ep.CameraModel:
        matrix = [[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]]
        return ep.CameraModel(matrix, camera.distortion, width=camera.width, height=camera.height)

    truth = rig.truth
    return ep.StereoCalibration(model(truth.left), model(truth.right), truth.rotation, truth.translation_m)


def turned_right(cal: ep.StereoCalibration, axis: str, degrees: float) -> ep.StereoCalibration:
    """The calibration with its right camera turned about an axis of its own, the centre kept."""
    vector = np.zeros(3)
    vector[["pitch", "yaw", "roll"].index(axis)] = np.radians(degrees)
    turn, _ = cv2.Rodrigues(vector)
    rotation = turn.T @ cal.rotation
    center = -cal.rotation.T @ cal.translation_m
    return ep.StereoCalibration(cal.left, cal.right, rotation, -rotation @ center)


def drift_of(
    cal: ep.StereoCalibration, pairs: list[tuple[Image, Image]], reference: ep.Drift | None = None
) -> ep.Drift:
    rectifier = ep.Rectifier(cal)
    residuals = []
    for left, right in pairs:
        pair = rectifier(left, right)
        residuals.append(
            ep.alignment_error(pair.left, pair.right, left_valid=pair.left_valid, right_valid=pair.right_valid)
        )
    return ep.measure_drift(rectifier.geometry, residuals, reference=reference)


def test_the_pipeline_reports_drift_and_realigns() -> None:
    rig = RenderedRig(seed=3)
    pairs = [(frame.left, frame.right) for frame in rig.frames(4)]
    pipe = ep.Pipeline(turned_right(truth_calibration(rig), "pitch", 0.2))
    with pytest.raises(ep.Error, match="no pair"):
        pipe.realign()
    for left, right in pairs:
        result = pipe.process(left, right)
    assert result.drift is not None
    assert result.alignment is not None
    assert result.drift.axis == "pitch"
    before = result.alignment.median_px
    corrected = pipe.realign()
    result = pipe.process(*pairs[0])
    assert result.alignment is not None
    assert result.drift is not None
    assert result.alignment.median_px < 0.3 * before
    assert result.drift.frames == 1
    assert np.allclose(corrected.rotation @ corrected.rotation.T, np.eye(3), atol=1e-12)


def test_commands(tmp_path: Path, rendered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive, rig = rendered / "drive", rendered / "rig.yaml"
    pair = [str(drive / f"{side}00.png") for side in ("left", "right")]
    assert main(["align", *pair, "--json", "-o", str(tmp_path / "out")]) == 0
    report = json.loads(capsys.readouterr().out)
    (one,) = report["pairs"]
    assert one["trusted"] == (one["reason"] == "")
    assert len(list((tmp_path / "out").iterdir())) == 4
    assert main(["check-rig", str(rig), str(drive), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["status"] in {"holds", "cannot tell"}, report
    cal = ep.StereoCalibration.load(rig)
    turned_right(cal, "pitch", 0.5).save(tmp_path / "bad.yaml")
    arguments = ["check-rig", str(tmp_path / "bad.yaml"), str(drive), "--save", str(tmp_path / "good.yaml"), "--json"]
    assert main(arguments) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["status"], report["axis"]) == ("drifted", "pitch")
    assert main(["check-rig", str(tmp_path / "good.yaml"), str(drive), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["axis"] is None
