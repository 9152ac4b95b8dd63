"""Files come whole or not at all, and say what their format says."""

from __future__ import annotations

import ast
import io
import json
import os
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import epiline
from epiline._files import write_atomically
from epiline.sinks.jsonl import JsonLines, obstacle_record
from epiline.sinks.pictures import write_picture
from epiline.sinks.ply import write_ply


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
        profiles=[],
        obstacles=[],
        stage_ms={"match": float("nan")},
    )
    frame = SimpleNamespace(seq=3, name="x", left_stamp_nanos=None, right_stamp_nanos=7)
    JsonLines(stream).write(frame, result)  # type: ignore[arg-type]
    assert stream.flushes == 1
    record = json.loads(stream.getvalue())
    assert record["seq"] == 3
    assert record["stage_ms"] == {"match": None}


def test_a_line_holds_everything_the_core_says_of_an_obstacle() -> None:
    """Fields come from the stub, so that a new one cannot be forgotten here."""
    stub = ast.parse((Path(epiline.__file__).parent / "_core.pyi").read_text(encoding="utf-8"))
    (declared,) = (node for node in stub.body if isinstance(node, ast.ClassDef) and node.name == "Obstacle")
    fields = {node.name for node in declared.body if isinstance(node, ast.FunctionDef)}
    obstacle = SimpleNamespace(**dict.fromkeys(fields, 1.5) | {"box": (1, 2, 3, 4), "sigma_m": float("nan")})
    record = obstacle_record(obstacle)  # type: ignore[arg-type]
    assert set(record) == fields
    assert (record["box"], record["sigma_m"], record["range_m"]) == ([1, 2, 3, 4], None, 1.5)
