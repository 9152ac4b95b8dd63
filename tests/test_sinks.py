"""Files come whole or not at all, and say what their format says."""

from __future__ import annotations

import ast
import io
import itertools
import json
import os
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import epiline
from epiline._files import write_atomically
from epiline.sinks.jsonl import JsonLines, ground_record, obstacle_record, scan_record, track_record
from epiline.sinks.overlay import colour_of, picture_of, top_view
from epiline.sinks.pictures import write_picture
from epiline.sinks.ply import write_ply
from epiline.sinks.video import PictureFolder, VideoFile


def test_atomic_write_leaves_nothing_behind(tmp_path: Path) -> None:
    write_atomically(tmp_path / "a.bin", b"one")
    write_atomically(tmp_path / "a.bin", b"two")
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]
    assert (tmp_path / "a.bin").read_bytes() == b"two"


def test_missing_folder_is_named_by_the_path_asked_for(tmp_path: Path) -> None:
    target = tmp_path / "nowhere" / "a.png"
    with pytest.raises(OSError, match="cannot be written") as caught:
        write_picture(target, np.zeros((4, 4), np.uint8))
    assert caught.value.filename == str(target)


def test_a_folder_in_the_way_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.ply").mkdir()
    with pytest.raises(OSError, match="cannot be written"):
        write_ply(tmp_path / "a.ply", np.zeros((1, 3), np.float32))
    assert [p.name for p in tmp_path.iterdir()] == ["a.ply"]


def test_unknown_picture_format_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"'\.xyz'"):
        write_picture(tmp_path / "a.xyz", np.zeros((4, 4), np.uint8))


def test_picture_reads_back(tmp_path: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (7, 5, 3), np.uint8)
    write_picture(tmp_path / "a.png", image)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "a.png")), image)


def test_ply_has_the_points_and_colours(tmp_path: Path) -> None:
    points = np.array([[1, 2, 3, 10, 20, 30], [-1, 0.5, 4, 255, 0, 128]], np.float32)
    write_ply(tmp_path / "a.ply", points)
    header, body = (tmp_path / "a.ply").read_bytes().split(b"end_header\n")
    assert b"element vertex 2" in header
    vertices = np.frombuffer(body, np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)]))
    np.testing.assert_array_equal(vertices["xyz"], points[:, :3])
    np.testing.assert_array_equal(vertices["rgb"], points[:, 3:].astype(np.uint8))


def test_interrupted_jsonl_keeps_the_lines_it_has(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"

    def interrupted() -> None:
        with JsonLines.open(path) as sink:
            sink._stream.write(json.dumps({"seq": 0}) + "\n")
            assert not path.exists()
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == '{"seq": 0}\n'
    assert os.listdir(tmp_path) == ["run.jsonl"]


def test_jsonl_flushes_each_line() -> None:
    class Counting(io.StringIO):
        flushes = 0

        def flush(self) -> None:
            self.flushes += 1

    stream = Counting()
    result = SimpleNamespace(
        alignment=None,
        disparity=SimpleNamespace(density=0.5),
        ground=None,
        ground_reason="not asked for",
        profiles=[],
        obstacles=[],
        tracks=[],
        scan=None,
        stage_ms={"match": float("nan")},
    )
    frame = SimpleNamespace(seq=3, name="x", left_stamp_nanos=None, right_stamp_nanos=7)
    JsonLines(stream).write(frame, result)  # type: ignore[arg-type]
    assert stream.flushes == 1
    record = json.loads(stream.getvalue())
    assert record["seq"] == 3
    assert record["stage_ms"] == {"match": None}
    assert record["ground"] == {"reason": "not asked for"}


def test_a_line_holds_everything_the_core_says_of_an_obstacle() -> None:
    """Fields come from the stub, so that a new one cannot be forgotten here."""
    stub = ast.parse((Path(epiline.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))
    (declared,) = (node for node in stub.body if isinstance(node, ast.ClassDef) and node.name == "Obstacle")
    fields = {node.name for node in declared.body if isinstance(node, ast.FunctionDef)}
    obstacle = SimpleNamespace(**dict.fromkeys(fields, 1.5) | {"box": (1, 2, 3, 4), "sigma_m": float("nan")})
    record = obstacle_record(obstacle)  # type: ignore[arg-type]
    assert set(record) == fields
    assert (record["box"], record["sigma_m"], record["range_m"]) == ([1, 2, 3, 4], None, 1.5)


# ---- ground, tracks and scan -------------------------------------------------------------------

ROOM = epiline.RectifiedGeometry(width=160, height=120, focal_px=150, cx_px=79.5, cy_px=59.5, baseline_m=0.12)


@pytest.fixture
def room() -> epiline.DisparityMap:
    """A floor 0.5 m below, a wall at 4 m whose right third has no texture, a box at 2 m on the left."""
    x, y = np.meshgrid((np.arange(160) - 79.5) / 150, (np.arange(120) - 59.5) / 150)
    with np.errstate(divide="ignore"):
        depth_m = np.minimum(np.where(y > 0, 0.5 / y, np.inf), 4.0)
    bare = (depth_m == 4.0) & (x > 0.2)
    box = (np.abs(2 * x + 0.5) < 0.2) & (2 * y > 0.1) & (2 * y < 0.5)
    depth_m[box] = 2.0
    raw = np.round(16 * 18 / depth_m).astype(np.uint16)
    return epiline.DisparityMap(raw, np.where(bare, 16, 0).astype(np.uint8))


@pytest.fixture
def scan(room: epiline.DisparityMap) -> epiline.Scan:
    return epiline.scan(room, ROOM, mounting=epiline.RobotFromCamera(0.5), max_range_m=5, step_m=0.15, gap_guard_px=2)


def track(x_m: float, z_m: float, frames: int = 4) -> epiline.Track:
    tracker = epiline.Tracker()
    for k in range(frames):
        range_m, bearing_rad = float(np.hypot(x_m, z_m)), float(np.arctan2(x_m, z_m))
        seen = epiline.Detection(range_m, bearing_rad, 0.05, box=(20, 30, 40, 50))
        (followed,) = tracker.update([seen], k * 100_000_000)
    return followed


def test_a_scans_line_tells_obstacle_free_and_unknown_apart(scan: epiline.Scan) -> None:
    record = json.loads(json.dumps(scan_record(scan), allow_nan=False))
    seen, nearest, free = record["seen"], record["nearest_m"], record["free_to_m"]
    assert len(seen) == len(nearest) == len(free)
    # Counter-clockwise: the bare wall on the right comes first.
    assert seen[5] == "?"
    assert nearest[5] is None
    assert 2.5 < free[5] < 5
    assert seen[-5] == "o"
    assert nearest[-5] == pytest.approx(4 / np.cos(record["angle_min_rad"]), rel=0.05)
    assert [value for value, letter in zip(nearest, seen, strict=True) if letter != "o" and value is not None] == []
    assert min(value for value in nearest if value is not None) == pytest.approx(2, rel=0.03)


def test_a_tracks_line_has_its_sigmas() -> None:
    followed = track(1.0, 5.0)
    record = json.loads(json.dumps(track_record(followed), allow_nan=False))
    assert record["id"] == followed.id
    assert record["confirmed"] is True
    assert record["position_sigma_m"] == pytest.approx(np.sqrt(np.diag(followed.covariance))[:2].tolist())
    assert record["velocity_mps"] == pytest.approx([0, 0], abs=1e-6)


def test_a_grounds_line_is_the_pose_or_the_reason() -> None:
    names = ("camera_height_m", "pitch_rad", "roll_rad")
    sigmas = ("camera_height_sigma_m", "pitch_sigma_rad", "roll_sigma_rad", "support_share")
    ground = SimpleNamespace(**dict.fromkeys((*names, *sigmas), 0.5))
    assert ground_record(ground, None) == vars(ground)  # type: ignore[arg-type]
    assert ground_record(None, "a wall") == {"reason": "a wall"}


def test_the_top_view_has_free_unknown_and_obstacles_where_they_are(scan: epiline.Scan) -> None:
    view = top_view(scan, [], side_px=240)
    px_per_m, foot = (240 - 24) / 5, np.array([90, 228])

    def at(ahead_m: float, left_m: float) -> tuple[int, ...]:
        x, y = (foot - px_per_m * np.array([left_m, ahead_m])).astype(int)
        return tuple(int(v) for v in view[y, x])

    green, grey, red = (96, 150, 70), (70, 66, 66), (70, 80, 250)
    assert at(1.6, 0.1) == green
    assert at(4.5, -1.2) == grey
    assert at(4.6, 1.0) == grey
    column = [tuple(int(v) for v in pixel) for pixel in view[:, int(90 - px_per_m * 0.5 + 0.5)]]
    assert red in column
    assert abs(column.index(red) - (228 - px_per_m * 4)) <= 3


def test_only_confirmed_tracks_are_drawn(scan: epiline.Scan) -> None:
    left = np.full((120, 160), 90, np.uint8)
    plain = picture_of(left, [], None)
    assert plain.shape == (120, 160, 3)
    np.testing.assert_array_equal(picture_of(left, [track(0.5, 5.0, frames=1)], None), plain)
    drawn = picture_of(left, [track(0.5, 5.0)], None)
    # Away from the writing: the box's right edge, in the track's own colour.
    assert tuple(int(v) for v in drawn[70, 59]) == colour_of(0)
    beside = picture_of(left, [track(0.5, 5.0)], scan, caption="frame 1")
    assert beside.shape == (120, 160 + 90, 3)


def test_neighbouring_tracks_have_different_colours() -> None:
    colours = [np.array(colour_of(i), float) for i in range(12)]
    assert min(np.abs(a - b).sum() for a, b in itertools.pairwise(colours)) > 100


def test_a_video_comes_whole_and_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "run.avi"
    frames = [np.full((48, 64, 3), level, np.uint8) for level in (20, 120, 220)]
    with VideoFile.open(path, 10.0) as video:
        for i, frame in enumerate(frames):
            video.add(str(i), frame)
        assert not path.exists()
    assert os.listdir(tmp_path) == ["run.avi"]
    reader = cv2.VideoCapture(str(path))
    means = [float(reader.read()[1].mean()) for _ in frames]
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(10)
    reader.release()
    assert means == pytest.approx([20, 120, 220], abs=4)


def test_what_is_no_video_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"'\.gif' is no video format"), VideoFile.open(tmp_path / "a.gif", 10.0):
        pass
    with pytest.raises(FileNotFoundError), VideoFile.open(tmp_path / "nowhere" / "a.avi", 10.0):
        pass
    assert list(tmp_path.iterdir()) == []


def test_pictures_are_numbered_and_their_names_safe(tmp_path: Path) -> None:
    folder = PictureFolder(tmp_path / "pictures")
    for name in ("000007.png", "../../a b"):
        folder.add(name, np.zeros((4, 4, 3), np.uint8))
    assert sorted(os.listdir(tmp_path / "pictures")) == ["00000-000007.png", "00001-a-b.png"]
