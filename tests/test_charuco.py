"""ChArUco boards: part of the board in sight, another part for each camera, real and drawn."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.cli import main
from epiline.targets.charuco import find_charuco
from epiline.targets.failure import NotFoundError
from epiline.targets.photograph import read_grey

BOARD = ep.Charuco(columns=9, rows=6, square_m=0.03, marker_m=0.022)


def drawn(board: ep.Charuco = BOARD, *, legacy: bool = False, shift: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A board drawn by OpenCV under a known homography, and where its corners are."""
    layout = cv2.aruco.CharucoBoard(
        (board.columns, board.rows),
        board.square_m,
        board.marker_m,
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary)),
    )
    layout.setLegacyPattern(legacy)
    square = 48
    flat = layout.generateImage((board.columns * square, board.rows * square))
    homography = np.array([[1.0, 0.06, 60 + shift], [-0.04, 1.0, 60], [1e-4, 5e-5, 1]])
    image = cv2.warpPerspective(flat, homography, (600, 440), flags=cv2.INTER_AREA, borderValue=255)
    corners = board.points_m[:, :2] / board.square_m * square + square - 0.5
    return cv2.GaussianBlur(image, (0, 0), 0.8), cv2.perspectiveTransform(corners[None], homography)[0]


@pytest.mark.parametrize("legacy", [False, True])
def test_every_corner_of_a_drawn_board(legacy: bool) -> None:
    image, truth = drawn(legacy=legacy)
    corners, ids = find_charuco(image, BOARD)
    np.testing.assert_array_equal(ids, np.arange(40))
    assert np.abs(corners - truth).max() < 0.15


def test_each_camera_sees_another_part() -> None:
    image, truth = drawn()
    left, right = image.copy(), image.copy()
    left[:, 400:], right[:, :170] = 255, 255
    views = ep.find_boards([left], [right], BOARD)
    (view,) = views.accepted
    assert view.left is not None
    assert view.right is not None
    assert set(view.left.ids.tolist()) != set(view.right.ids.tolist())
    common = view.common_ids
    assert 6 <= len(common) < min(len(view.left.ids), len(view.right.ids))
    # Row by row the same corners of the board, in both pictures where they were drawn.
    np.testing.assert_array_equal(views.board_m[0], BOARD.points_m[common])
    for px in (views.left_px[0], views.right_px[0]):
        assert np.abs(px - truth[common]).max() < 0.15
    # What one camera saw alone is kept for it.
    (alone,) = views.single_views("left")
    assert len(alone.px) == len(view.left.ids) - len(common)


def test_parts_that_do_not_meet_are_no_pair() -> None:
    image, _ = drawn()
    left, right = image.copy(), image.copy()
    left[:, 270:], right[:, :330] = 255, 255
    with pytest.raises(ValueError, match="different parts of the board: 0 corners in common"):
        ep.find_boards([left], [right], BOARD)


def test_a_mirrored_board_is_recognised() -> None:
    image, _ = drawn()
    with pytest.raises(NotFoundError, match="mirrored"):
        find_charuco(np.ascontiguousarray(image[:, ::-1]), BOARD)


def test_another_board_is_no_board() -> None:
    image, _ = drawn()
    with pytest.raises(NotFoundError, match="but not where a board of 7x6 squares has them"):
        find_charuco(image, ep.Charuco(columns=7, rows=6, square_m=0.03, marker_m=0.022))
    with pytest.raises(NotFoundError, match=r"no 9x6 ChArUco board: 0 markers"):
        find_charuco(np.full((200, 300), 128, np.uint8), BOARD)


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"columns": 3}, "columns = 3: a board has 4 to 100 squares"),
        ({"marker_m": 0.03}, "must be less than square_m"),
        ({"marker_m": float("nan")}, "marker_m"),
        ({"dictionary": "4X4"}, "expected a name of OpenCV's"),
    ],
)
def test_impossible_boards(change: dict[str, object], complaint: str) -> None:
    options: dict[str, object] = {"columns": 9, "rows": 6, "square_m": 0.03, "marker_m": 0.022, **change}
    with pytest.raises(ValueError, match=complaint):
        ep.Charuco(**options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("dictionary", "complaint"), [("DICT_4X4_50", "has 50 markers.*needs 248"), ("DICT_9X9_50", "not one of OpenCV's")]
)
def test_a_dictionary_that_does_not_do(dictionary: str, complaint: str) -> None:
    board = ep.Charuco(columns=31, rows=16, square_m=0.03, marker_m=0.02, dictionary=dictionary)
    with pytest.raises(ValueError, match=complaint):
        ep.find_boards([np.zeros((60, 80), np.uint8)], [np.zeros((60, 80), np.uint8)], board)


def test_the_command_line_takes_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("left0", "right0"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), drawn()[0][:, ::-1])
    arguments = ["calibrate", str(tmp_path), "--board", "9x6", "--square", "30mm", "--marker", "22mm"]
    assert main(arguments) == 1
    assert "the photograph is mirrored" in capsys.readouterr().err


@pytest.fixture(scope="module")
def real(data: Path, tmp_path_factory: pytest.TempPathFactory) -> ep.Observations:
    folder = data / "calib" / "shubhamwagh_charuco"
    left, right = (sorted((folder / side).glob("*.png")) for side in ("left", "right"))
    board = ep.Charuco(columns=31, rows=16, square_m=0.04933, marker_m=0.03846, dictionary="DICT_4X4_250")
    return ep.find_boards(left, right, board)


def test_the_real_rig_and_its_two_pairs_of_different_moments(real: ep.Observations) -> None:
    """OpenCV's rational model finds 0.31 px and the published 75.00 mm without the two pairs, 6.8 px with them."""
    left_out = {view.name_left: view.reason for view in real.rejected}
    assert set(left_out) == {"06.png", "27.png"}
    assert all("not of one moment" in reason for reason in left_out.values())
    boards, left, right = ([p.astype(np.float32) for p in side] for side in (real.board_m, real.left_px, real.right_px))
    flags = cv2.CALIB_RATIONAL_MODEL
    lenses = [
        cv2.calibrateCamera(boards, seen, real.image_size, None, None, flags=flags)[1:3] for seen in (left, right)
    ]
    rms, *_, shift, _, _ = cv2.stereoCalibrate(
        boards, left, right, *lenses[0], *lenses[1], real.image_size, flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS
    )
    assert rms < 0.32
    assert float(np.linalg.norm(shift)) == pytest.approx(0.07500, abs=0.00015)


def test_a_real_mirrored_photograph(data: Path) -> None:
    image = read_grey(data / "calib" / "shubhamwagh_charuco" / "left" / "01.png")
    board = ep.Charuco(columns=31, rows=16, square_m=0.04933, marker_m=0.03846, dictionary="DICT_4X4_250")
    with pytest.raises(NotFoundError, match="mirrored"):
        find_charuco(np.ascontiguousarray(image[:, ::-1]), board)
