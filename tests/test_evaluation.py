"""Scores against an independent computation, and hostile ground-truth files."""

from __future__ import annotations

import io
import json
import struct
import zipfile
from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.evaluation import load_scenes
from epiline.evaluation.readers import read_disparity, read_pfm
from epiline.evaluation.scenes import agrees_with_right
from epiline.sinks.disparity import kitti_levels, pfm_bytes, write_disparity


def test_scores_of_a_map_small_enough_to_count_by_hand() -> None:
    truth = np.array([[10.0, 10.0, 10.0, 100.0, np.nan]])
    answers = np.array([[10.5, 12.5, np.nan, 104.0, 7.0]], np.float32)
    e = ep.evaluate(answers, truth)
    assert e.pixels == 4
    assert e.density == 75.0
    assert e.avg == pytest.approx((0.5 + 2.5 + 4.0) / 3)
    assert e.rms == pytest.approx(np.sqrt((0.25 + 6.25 + 16.0) / 3))
    assert e.bad1_matched == pytest.approx(200 / 3)
    assert (e.bad1_total, e.bad2_total, e.bad3_total) == (75.0, 75.0, 50.0)
    # 4 px off a disparity of 100 is within 5 %: wrong for bad3, right for D1; the unanswered pixel is wrong for both.
    assert e.d1_total == 25.0
    assert e.d1_matched == 0.0


def test_mask_leaves_pixels_out() -> None:
    truth = np.full((2, 2), 5.0)
    answers = np.array([[5.0, 50.0], [5.0, 5.0]], np.float32)
    mask = np.array([[True, False], [True, True]])
    assert ep.evaluate(answers, truth).bad1_total == 25.0
    assert ep.evaluate(answers, truth, mask).bad1_total == 0.0


def test_negative_answers_are_none_and_plain_lists_will_do() -> None:
    scores = ep.evaluate([[-1.0, 5.0, 5.0]], [[5.0, 5.0, 9.0]], [[True, True, False]])  # type: ignore[arg-type]
    assert (scores.pixels, scores.density, scores.avg, scores.bad1_total) == (2, 50.0, 0.0, 50.0)


def test_shapes_that_differ_are_named() -> None:
    with pytest.raises(ValueError, match=r"\(2, 3\).*\(3, 2\)"):
        ep.evaluate(np.zeros((2, 3)), np.zeros((3, 2)))


def test_pfm_of_both_byte_orders(tmp_path: Path) -> None:
    values = np.arange(6, dtype=np.float32).reshape(2, 3) + 0.5
    (tmp_path / "little.pfm").write_bytes(pfm_bytes(values))
    big = b"Pf\n3 2\n1.0\n" + np.flipud(values).astype(">f4").tobytes()
    (tmp_path / "big.pfm").write_bytes(big)
    for name in ("little.pfm", "big.pfm"):
        np.testing.assert_array_equal(read_pfm(tmp_path / name), values)


@pytest.mark.parametrize("suffix", [".pfm", ".npy"])
def test_disparity_files_keep_every_bit(tmp_path: Path, suffix: str) -> None:
    # A disparity of zero is an answer: a point too far away to have a parallax.
    values = np.array([[1.0625, np.nan], [63.9375, 0.0]], np.float32)
    write_disparity(tmp_path / f"d{suffix}", values)
    np.testing.assert_array_equal(read_disparity(tmp_path / f"d{suffix}"), values)


def test_kitti_png_is_what_opencv_reads(tmp_path: Path) -> None:
    values = np.array([[1.0625, np.nan], [255.9375, 0.0]], np.float32)
    write_disparity(tmp_path / "d.png", values)
    stored = cv2.imread(str(tmp_path / "d.png"), cv2.IMREAD_UNCHANGED)
    # Zero disparity is an answer and must not turn into "unknown".
    np.testing.assert_array_equal(stored, [[272, 0], [65520, 1]])
    with pytest.raises(ValueError, match="300 px"):
        kitti_levels(np.array([[300.0]], np.float32))


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "no header"),
        (b"Pf\n2 2\n-1.0\n" + b"\0" * 15, "truncated.*15 bytes.*need 16"),
        (b"Pf\n999999999 999999999\n-1.0\n", "999999999x999999999"),
        (b"Pf\n2 2\n0\n" + b"\0" * 16, "scale"),
        (b"Pf\n2 2\n1e999\n" + b"\0" * 16, "scale"),
        (b"P6\n2 2\n255\n" + b"\0" * 12, "no header"),
    ],
)
def test_damaged_pfm_is_refused(tmp_path: Path, content: bytes, complaint: str) -> None:
    path = tmp_path / "bad.pfm"
    path.write_bytes(content)
    with pytest.raises(OSError, match=complaint):
        read_pfm(path)


def numpy_file(shape: tuple[int, ...], dtype: str, body: bytes) -> bytes:
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": dtype, "fortran_order": False, "shape": shape})
    return stream.getvalue() + body


def zipped(*members: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for i, member in enumerate(members):
            archive.writestr(f"arr_{i}.npy", member)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("d.npy", b"", "reading magic string"),
        ("d.npy", b"\x80\x04\x95" * 9, "magic string is not correct"),
        ("d.npy", numpy_file((1_000_000, 1_000_000), "<f4", b""), "each side must be 1 to 16384 px"),
        ("d.npy", numpy_file((10, 10), "<f4", bytes(50)), "truncated: 50 bytes.*need 400"),
        ("d.npy", numpy_file((2, 2), "|O", bytes(32)), "real numbers.*object"),
        ("d.npy", numpy_file((2, 2), "<c8", bytes(32)), "real numbers.*complex64"),
        ("d.npy", numpy_file((2, 2, 3), "<f4", bytes(48)), r"\(2, 2, 3\)"),
        ("d.npz", zipped(numpy_file((1_000_000, 1_000_000), "<f4", b"")), "each side must be 1 to 16384 px"),
        ("d.npz", zipped(numpy_file((1, 1), "<f4", bytes(4)), numpy_file((1, 1), "<f4", bytes(4))), "it holds 2"),
        ("d.npz", zipped(numpy_file((1, 1), "<f4", bytes(4)))[:-9], "not a zip file"),
        ("d.pgm", b"P5\n# a comment\n100 100\n255\n" + bytes(50), "truncated PNM: 50 bytes.*need 10000"),
    ],
)
def test_damaged_disparity_files_are_refused(tmp_path: Path, name: str, content: bytes, complaint: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(OSError, match=rf"{name}: .*{complaint}"):
        read_disparity(path)


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_as_numpy_saves_them(tmp_path: Path, order: Literal["C", "F"]) -> None:
    values = np.arange(1, 7, dtype=np.float64).reshape(2, 3)
    np.save(tmp_path / "d.npy", np.asarray(values, order=order))
    np.savez_compressed(tmp_path / "d.npz", np.asarray(values, order=order))
    for name in ("d.npy", "d.npz"):
        np.testing.assert_array_equal(read_disparity(tmp_path / name, scale=2), values / 2)


def test_truncated_png_truth_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "gt.png"
    cv2.imwrite(str(path), np.full((50, 50), 256, np.uint16))
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(OSError, match="truncated PNG"):
        read_disparity(path, scale=256)


def test_left_right_agreement_of_a_step() -> None:
    # Background at 2 px, a foreground of columns 6..9 at 4 px; the two background pixels it hides lie left of it.
    left = np.full((1, 12), 2.0, np.float32)
    left[0, 6:10] = 4.0
    right = np.full((1, 12), 2.0, np.float32)
    right[0, 2:6] = 4.0
    seen = agrees_with_right(left, right)[0]
    assert list(np.flatnonzero(~seen)) == [0, 1, 4, 5]


def test_a_manifest_that_lacks_an_entry_is_named(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(json.dumps({"a/b": {"left": "l.png"}}))
    with pytest.raises(ValueError, match=r"scene 'a/b' lacks gt"):
        list(load_scenes(tmp_path))


def test_scores_equal_an_independent_scorer_on_real_scenes(data: Path) -> None:
    """The field's definitions written down a second time, on OpenCV's disparity."""
    for scene in load_scenes(data):
        if scene.name not in {"middlebury2003/cones", "kitti2015/000002_10", "middlebury2014/Motorcycle"}:
            continue
        grey = [ep.grey(image) for image in (scene.left, scene.right)]
        raw = cv2.StereoBM.create(scene.num_disparities, 9).compute(*grey)
        values = raw.astype(np.float32) / 16
        values[raw < 0] = np.nan
        ours = ep.evaluate(values, scene.truth, scene.non_occluded)
        mask = scene.non_occluded
        wrong = answered = bad = 0
        total_error = 0.0
        for value, truth in zip(values[mask].tolist(), scene.truth[mask].tolist(), strict=True):
            known = value == value
            answered += known
            off = abs(value - truth) if known else float("inf")
            total_error += off if known else 0.0
            bad += off > 2
            wrong += off > 3 and off > 0.05 * truth
        count = int(mask.sum())
        assert ours.density == pytest.approx(100 * answered / count)
        assert ours.avg == pytest.approx(total_error / answered)
        assert ours.bad2_total == pytest.approx(100 * bad / count)
        assert ours.bad2_matched == pytest.approx(100 * (bad - (count - answered)) / answered)
        assert ours.d1_total == pytest.approx(100 * wrong / count)


def test_the_manifest_names_27_scenes(data: Path) -> None:
    assert len(list(load_scenes(data))) == len(json.loads((data / "manifest.json").read_text()))


def test_header_of_an_npz_is_not_trusted(tmp_path: Path) -> None:
    path = tmp_path / "gt.npz"
    path.write_bytes(b"PK\x03\x04" + struct.pack("<I", 7) * 8)
    with pytest.raises(OSError, match=r"gt\.npz"):
        read_disparity(path)
