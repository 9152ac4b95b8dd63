"""Sources from files: what is recognised, what is paired with what, and what is refused in one clear line."""

from __future__ import annotations

import os
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from epiline._images import read_image
from epiline.sources import Frame, open_source, pair_lists, pair_mixed, pair_names

DATA = Path(os.environ.get("EPILINE_DATA", Path(__file__).resolve().parents[1] / "../shared/data"))


def picture(number=0, size=(24, 16), channels=3):
    rng = np.random.default_rng(number)
    shape = (size[1], size[0]) if channels == 1 else (size[1], size[0], channels)
    return rng.integers(0, 256, shape, dtype=np.uint8)


def write(path, number=0, **options):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), picture(number, **options))
    return path


def names(pairing):
    return [(pair.left.name, pair.right.name) for pair in pairing.pairs]


# ---- what is recognised ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left", "right"),
        ("Left", "Right"),
        ("image_0", "image_1"),
        ("image_2", "image_3"),
        ("image_02/data", "image_03/data"),
        ("cam0/data", "cam1/data"),
    ],
)
def test_two_folders_in_one(tmp_path, left, right):
    for i in (2, 10, 1):
        write(tmp_path / left / f"{i}.png", i)
        write(tmp_path / right / f"{i}.png", 100 + i)
    with open_source(tmp_path) as source:
        frames = list(source)
    assert source.size == (24, 16)
    assert len(source) == source.length == 3
    assert [frame.name for frame in frames] == ["1", "2", "10"]
    assert [frame.seq for frame in frames] == [0, 1, 2]
    for frame, number in zip(frames, (1, 2, 10), strict=True):
        assert isinstance(frame, Frame)
        assert (frame.left_stamp_nanos, frame.right_stamp_nanos) == (None, None)
        np.testing.assert_array_equal(frame.left, picture(number))
        np.testing.assert_array_equal(frame.right, picture(100 + number))
    assert len(list(source)) == 3


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("left{}.png", "right{}.png"),
        ("{}_left.png", "{}_right.png"),
        ("img{}Left.png", "img{}Right.png"),
        ("bright_{}_left.png", "bright_{}_right.png"),
        ("L{}.png", "R{}.png"),
        ("scene-l_{}.png", "scene-r_{}.png"),
        ("im0_{}.png", "im1_{}.png"),
        ("cam0_{}.png", "cam1_{}.png"),
        ("{}_image_00.png", "{}_image_01.png"),
    ],
)
def test_pairs_by_name(tmp_path, left, right):
    for i in (7, 11):
        write(tmp_path / left.format(i), i)
        write(tmp_path / right.format(i), 100 + i)
    source = open_source(str(tmp_path))
    frames = list(source)
    assert len(frames) == 2
    np.testing.assert_array_equal(frames[1].left, picture(11))
    np.testing.assert_array_equal(frames[1].right, picture(111))


@pytest.mark.parametrize("stems", [("im0", "im1"), ("left", "right"), ("image_0", "image_1")])
def test_a_single_pair_with_its_truth_beside_it(tmp_path, stems):
    write(tmp_path / f"{stems[0]}.png", 1)
    write(tmp_path / f"{stems[1]}.png", 2)
    write(tmp_path / "gt_left.png", 3)
    write(tmp_path / "gt_right.png", 4)
    write(tmp_path / "occl_mask.png", 5)
    (frame,) = open_source(tmp_path)
    np.testing.assert_array_equal(frame.left, picture(1))


def test_two_globs_two_files_and_a_shells_list(tmp_path):
    lefts = [write(tmp_path / f"left{i}.jpg", i) for i in (1, 2, 10)]
    rights = [write(tmp_path / f"right{i}.jpg", 9) for i in (1, 2, 10)]
    by_globs = open_source([str(tmp_path / "left*.jpg"), str(tmp_path / "right*.jpg")])
    by_glob = open_source(str(tmp_path / "*.jpg"))
    by_list = open_source([*lefts, *rights])
    for source in (by_globs, by_glob, by_list):
        assert [frame.name for frame in source] == ["left1", "left2", "left10"]
    (frame,) = open_source([lefts[0], rights[2]])  # two files named by hand are a pair whatever their names
    assert frame.left.shape == (16, 24, 3)


def test_a_shells_list_of_two_folders(tmp_path):
    lefts = [write(tmp_path / "left" / f"{i}.png", i) for i in range(3)]
    rights = [write(tmp_path / "right" / f"{i}.png", i) for i in range(3)]
    for files in ([*lefts, *rights], [*rights, *lefts]):
        pairing = pair_mixed(files)
        assert [(p.left.parent.name, p.right.parent.name) for p in pairing.pairs] == [("left", "right")] * 3


def test_side_by_side_images(tmp_path):
    both = np.hstack([picture(1), picture(2)])
    cv2.imwrite(str(tmp_path / "a.png"), both)
    for source in (
        open_source(f"sbs:{tmp_path / 'a.png'}"),
        open_source(tmp_path / "a.png", layout="side-by-side"),
        open_source(f"sbs:{tmp_path}"),
        open_source(f"sbs:{tmp_path}/*.png"),
    ):
        (frame,) = source
        assert source.size == (24, 16)
        np.testing.assert_array_equal(frame.left, picture(1))
        np.testing.assert_array_equal(frame.right, picture(2))
        assert frame.left.flags.c_contiguous


def test_grey_stays_grey_and_a_mixed_pair_becomes_colour(tmp_path):
    write(tmp_path / "left1.png", 1, channels=1)
    write(tmp_path / "right1.png", 2, channels=1)
    (frame,) = open_source(tmp_path)
    assert frame.left.shape == frame.right.shape == (16, 24)
    write(tmp_path / "right1.png", 2)
    (frame,) = open_source(tmp_path)
    assert frame.left.shape == frame.right.shape == (16, 24, 3)


def test_demo():
    source = open_source("demo:frames=2,size=64x48,seed=3")
    assert source.size == (64, 48)
    assert [frame.name for frame in source] == ["demo 0", "demo 1"]
    assert open_source("demo:").length == 12
    for spec in ("demo:frames=x", "demo:size=64", "demo:colour=1"):
        with pytest.raises(ValueError, match="demo:"):
            open_source(spec)


# ---- videos ------------------------------------------------------------------------------------


def write_video(path, count, size=(64, 48), offset=0):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20, size)
    assert writer.isOpened()
    for i in range(count):
        writer.write(np.full((size[1], size[0], 3), 20 * i + offset, np.uint8))
    writer.release()
    return path


def test_two_videos(tmp_path):
    left, right = write_video(tmp_path / "l.avi", 6), write_video(tmp_path / "r.avi", 6, offset=5)
    with open_source([left, right]) as source:
        for _ in range(2):  # it can be read again
            frames = list(source)
            assert len(frames) == len(source) == 6
            for i, frame in enumerate(frames):
                assert abs(float(frame.left.mean()) - 20 * i) < 3
                assert abs(float(frame.right.mean()) - 20 * i - 5) < 3
                assert frame.left_stamp_nanos == pytest.approx(i * 50_000_000, abs=1000)
    assert source.size == (64, 48)


def test_side_by_side_video(tmp_path):
    path = write_video(tmp_path / "both.avi", 3, size=(128, 48))
    with open_source(f"sbs:{path}") as source:
        assert source.size == (64, 48)
        assert [frame.right.shape for frame in source] == [(48, 64, 3)] * 3


def test_videos_that_do_not_fit(tmp_path):
    a, b = write_video(tmp_path / "a.avi", 6), write_video(tmp_path / "b.avi", 5)
    with pytest.raises(ValueError, match=r"a\.avi has 6 frames.*b\.avi has 5"):
        open_source([a, b])
    c = write_video(tmp_path / "c.avi", 6, size=(32, 48))
    with pytest.raises(ValueError, match=r"c\.avi is 32x48 px.*a\.avi is 64x48 px"):
        open_source([a, c])
    with pytest.raises(OSError, match=r"none\.avi: no such"):
        open_source([a, tmp_path / "none.avi"])
    (tmp_path / "text.avi").write_text("no video")
    with pytest.raises(OSError, match=r"text\.avi: cannot be opened as a video"):
        open_source([a, tmp_path / "text.avi"])


# ---- pairing never guesses ---------------------------------------------------------------------


def test_a_missing_partner_is_an_error_or_left_out(tmp_path):
    for i in range(5):
        write(tmp_path / f"left{i}.png", i)
        if i != 2:
            write(tmp_path / f"right{i}.png", 100 + i)
    with pytest.raises(ValueError, match=r"1 images without a partner beside 4 pairs: .*left2\.png"):
        open_source(tmp_path)
    source = open_source(tmp_path, unpaired="skip")
    assert [frame.name for frame in source] == ["left0", "left1", "left3", "left4"]
    for frame, number in zip(source, (0, 1, 3, 4), strict=True):
        np.testing.assert_array_equal(frame.right, picture(100 + number))


def test_padding_does_not_matter_but_doubles_do():
    pairing = pair_names([Path("left1.png"), Path("left10.png"), Path("right010.png"), Path("right001.png")])
    assert names(pairing) == [("left1.png", "right001.png"), ("left10.png", "right010.png")]
    with pytest.raises(ValueError, match="same frame"):
        pair_names([Path("left1.png"), Path("left01.png"), Path("right1.png")])


def test_lists_pair_by_name_then_by_last_number():
    by_name = pair_lists([Path(f"l/{i}_10.png") for i in (3, 4)], [Path(f"r/{i}_10.png") for i in (4, 3, 5)])
    assert names(by_name) == [("3_10.png", "3_10.png"), ("4_10.png", "4_10.png")]
    assert by_name.unpaired == (Path("r/5_10.png"),)
    by_number = pair_lists([Path("cam0_0007.png")], [Path("cam1_0007.png")])
    assert names(by_number) == [("cam0_0007.png", "cam1_0007.png")]
    assert pair_lists([Path("a.png")], [Path("b.png")]).pairs == ()


def test_a_sequence_is_not_a_pair(tmp_path):
    """im0 … im4 are five frames of one camera."""
    for i in range(5):
        write(tmp_path / f"im{i}.png", i)
    with pytest.raises(ValueError, match="whether it is left or right"):
        open_source(tmp_path)


def test_folders_with_nothing_in_common(tmp_path):
    write(tmp_path / "left" / "100.png")
    write(tmp_path / "right" / "101.png")
    with pytest.raises(ValueError, match="no left image has a right one"):
        open_source(tmp_path)


# ---- bad input ---------------------------------------------------------------------------------


def one_line(error):
    assert "\n" not in str(error.value)
    return str(error.value)


def test_bad_specs(tmp_path):
    write(tmp_path / "one.png")
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("hello")
    cases = [
        ([], ValueError, "no source given"),
        (tmp_path / "empty", OSError, "empty: no images"),
        (tmp_path / "none", OSError, "none: no such file"),
        (str(tmp_path / "x*.png"), OSError, "no image has such a name"),
        (tmp_path / "one.png", ValueError, "one file is no pair"),
        (tmp_path / "notes.txt", ValueError, "neither a folder"),
        ([tmp_path / "one.png", tmp_path], ValueError, "not of one kind"),
        ("rtsp://127.0.0.1/left", ValueError, "rtsp: are not known; known are demo:, sbs:"),
        (f"sbs:{tmp_path / 'none.png'}", OSError, r"none\.png: no such file"),
    ]
    for spec, kind, message in cases:
        with pytest.raises(kind, match=message) as error:
            open_source(spec)
        one_line(error)


def test_sizes_differ(tmp_path):
    write(tmp_path / "left1.png", size=(24, 16))
    write(tmp_path / "right1.png", size=(20, 16))
    with pytest.raises(ValueError, match=r"right1\.png is 20x16 px, .*left1\.png is 24x16 px") as error:
        open_source(tmp_path)
    one_line(error)


def test_size_changes_on_the_way(tmp_path):
    for side in ("left", "right"):
        write(tmp_path / f"{side}1.png", size=(24, 16))
        write(tmp_path / f"{side}2.png", size=(26, 16))
    frames = iter(open_source(tmp_path))
    next(frames)
    with pytest.raises(ValueError, match=r"left2\.png is 26x16 px, .*left1\.png is 24x16 px"):
        next(frames)


def test_odd_width_is_not_side_by_side(tmp_path):
    write(tmp_path / "a.png", size=(25, 16))
    with pytest.raises(ValueError, match="25 px wide"):
        open_source(f"sbs:{tmp_path / 'a.png'}")


# ---- read_image --------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["png", "bmp", "tif", "ppm"])
def test_lossless_formats_come_back_as_written(tmp_path, suffix):
    path = write(tmp_path / f"a.{suffix}", 5)
    np.testing.assert_array_equal(read_image(path), picture(5))
    grey = read_image(path, channels="grey")
    assert np.abs(grey.astype(int) - cv2.cvtColor(picture(5), cv2.COLOR_BGR2GRAY)).max() <= 1


def test_channels(tmp_path):
    path = write(tmp_path / "grey.png", 5, channels=1)
    np.testing.assert_array_equal(read_image(path), picture(5, channels=1))
    np.testing.assert_array_equal(read_image(path, channels="bgr"), np.dstack([picture(5, channels=1)] * 3))
    deep = picture(5, channels=1).astype(np.uint16) * 256
    assert cv2.imwrite(str(tmp_path / "deep.png"), deep)
    np.testing.assert_array_equal(read_image(tmp_path / "deep.png"), picture(5, channels=1))


@pytest.mark.parametrize("suffix", ["png", "jpg"])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.9, "one byte"])
def test_truncated_files_are_refused(tmp_path, suffix, share):
    path = write(tmp_path / f"a.{suffix}", size=(320, 240))
    data = path.read_bytes()
    path.write_bytes(data[:-1] if share == "one byte" else data[: int(len(data) * share)])
    with pytest.raises(OSError, match=rf"a\.{suffix}: truncated") as error:
        read_image(path)
    one_line(error)


def test_jpeg_thumbnails_end_does_not_count(tmp_path):
    """A thumbnail inside EXIF has an end marker of its own."""
    path = write(tmp_path / "a.jpg", size=(320, 240))
    data = path.read_bytes()
    thumbnail = b"\xff\xe1" + struct.pack(">H", 2 + 6) + b"xx\xff\xd9xx"
    path.write_bytes(data[:2] + thumbnail + data[2:])
    assert read_image(path).shape == (240, 320, 3)
    path.write_bytes(data[:2] + thumbnail + data[2 : len(data) // 2])
    with pytest.raises(OSError, match="truncated JPEG"):
        read_image(path)


def test_damaged_and_foreign_files_are_refused(tmp_path):
    path = write(tmp_path / "a.png", size=(320, 240))
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    with pytest.raises(OSError, match="damaged PNG: wrong checksum"):
        read_image(path)
    (tmp_path / "empty.png").write_bytes(b"")
    with pytest.raises(OSError, match=r"empty\.png: the file is empty"):
        read_image(tmp_path / "empty.png")
    (tmp_path / "text.jpg").write_text("no picture")
    with pytest.raises(OSError, match=r"text\.jpg: not an image"):
        read_image(tmp_path / "text.jpg")
    with pytest.raises(FileNotFoundError):
        read_image(tmp_path / "none.png")


def test_huge_images_are_refused_before_decoding(tmp_path):
    """Only the header says 20000 px; there is nothing behind it."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", 20000, 100, 8, 0, 0, 0, 0)
    path = tmp_path / "huge.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IEND", b""))
    with pytest.raises(ValueError, match=r"huge\.png: 20000x100 px is too large"):
        read_image(path)


# ---- real data ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("folder", "count", "size"),
    [
        ("calib/boofcv_Bumblebee2_Chess", 11, (640, 480)),
        ("calib/opencv_bouguet", 13, (640, 480)),
        ("calib/sourishg_2", 28, (270, 180)),
        ("calib/shubhamwagh_charuco", 18, (1280, 800)),
        ("scenes_unrectified/boofcv_bumblebee2", 8, (640, 480)),
        ("karlsruhe_2010_03_09_drive_0023", 40, None),
        ("middlebury2003/teddy", 1, (450, 375)),
        ("eth3d/playground", 1, (941, 490)),
        ("kitti2015/000002_10", 1, (1242, 375)),
    ],
)
def test_real_recordings_open(folder, count, size):
    if not (DATA / folder).is_dir():
        pytest.skip(f"no {DATA / folder}: set EPILINE_DATA")
    source = open_source(DATA / folder)
    assert source.length == count
    assert size is None or source.size == size
    frame = next(iter(source))
    assert frame.left.shape == frame.right.shape
