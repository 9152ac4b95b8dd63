"""Boards in real photographs, in mirrored and hostile ones."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.sources import open_source
from epiline.targets import parse_board, parse_length
from epiline.targets.chessboard import NotFound, find_corners, largest_bend


def pairs(folder: Path) -> tuple[list[Path], list[Path]]:
    source = open_source(str(folder))
    return [pair.left for pair in source.pairs], [pair.right for pair in source.pairs]  # type: ignore[attr-defined]


def drawn_board(columns: int, rows: int, *, square: int = 24, tilt: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """A board drawn by OpenCV under a known homography, and its corners."""
    size = ((columns + 1) * square, (rows + 1) * square)
    y, x = np.mgrid[0 : size[1], 0 : size[0]]
    flat = np.where((x // square + y // square) % 2 == 0, 30, 220).astype(np.uint8)
    flat = cv2.copyMakeBorder(flat, square, square, square, square, cv2.BORDER_CONSTANT, value=220)
    homography = np.array([[1.0, 0.05, 40], [tilt / 4, 1.0, 30], [tilt / 1000, 0, 1]])
    image = cv2.warpPerspective(flat, homography, (560, 420), flags=cv2.INTER_AREA, borderValue=220)
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    grid = np.stack(np.meshgrid(np.arange(1, columns + 1), np.arange(1, rows + 1)), -1).reshape(-1, 2)
    # A corner lies between two pixels: half a pixel before the first one of the next square.
    corners = (grid + 1) * square - 0.5
    return image, cv2.perspectiveTransform(corners[:, None].astype(float), homography).reshape(-1, 2)


def test_corners_of_a_drawn_board() -> None:
    image, truth = drawn_board(9, 6)
    found = find_corners(image, ep.Chessboard(columns=9, rows=6))
    error = min(np.abs(found - truth).max(), np.abs(found[::-1] - truth).max())
    assert error < 0.1


def test_right_corners_come_in_the_left_order() -> None:
    """A detector may start at either end of a board; a pair must start at the same."""
    image, _ = drawn_board(9, 6)
    turned = np.ascontiguousarray(image[::-1, ::-1])
    board = ep.Chessboard(columns=9, rows=6)
    views = ep.find_boards([image], [image], board)
    np.testing.assert_allclose(views.left_px[0], views.right_px[0], atol=1e-6)
    from epiline.targets.search import _in_the_order_of

    left = find_corners(image, board)
    right = find_corners(turned, board)
    ordered = _in_the_order_of(left, right, board)
    rows = (left[8] - left[0]) @ (ordered[8] - ordered[0])
    assert rows > 0


def test_every_rejected_pair_says_why(tmp_path: Path) -> None:
    image, _ = drawn_board(9, 6)
    blank = np.full_like(image, 128)
    small = image[:-2]
    board = ep.Chessboard(columns=9, rows=6)
    broken = tmp_path / "broken.png"
    cv2.imwrite(str(broken), image)
    broken.write_bytes(broken.read_bytes()[:200])
    left = [image, image, blank, blank, image, small, broken]
    right = [image, image, image, blank, small, small, image]
    views = ep.find_boards(left, right, board).views
    reasons = [view.reason for view in views]
    assert [view.accepted for view in views] == [True, True, False, False, False, False, False]
    assert reasons[2] == "left: no 9x6 board"
    assert reasons[3] == "left and right: no 9x6 board"
    assert reasons[4] == "left is 560x420 px, right is 560x418 px"
    assert reasons[5] == "is 560x418 px, most photographs are 560x420 px"
    assert "truncated PNG" in reasons[6]


def test_a_board_that_is_nowhere_is_one_clear_line() -> None:
    blank = np.full((100, 120), 128, np.uint8)
    with pytest.raises(ValueError, match=r"no 9x6 board found in any of 2 pairs"):
        ep.find_boards([blank] * 2, [blank] * 2, ep.Chessboard(columns=9, rows=6))


@pytest.mark.parametrize(
    ("left", "right", "complaint"), [([], [], "no photographs"), ([0], [], "1 left and 0 right photographs")]
)
def test_lists_that_do_not_pair(left: list[object], right: list[object], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        ep.find_boards(left, right, ep.Chessboard())  # type: ignore[arg-type]


def test_one_stray_corner_is_put_back_and_two_are_refused() -> None:
    from epiline.targets.chessboard import _repaired

    _, truth = drawn_board(9, 6)
    board = ep.Chessboard(columns=9, rows=6)
    stray = truth.copy()
    stray[53] += (0.0, 15.0)
    assert largest_bend(stray, board) > 0.25
    assert np.abs(_repaired(stray, board) - truth).max() < 1.0
    stray[22] += (14.0, 0.0)
    np.testing.assert_array_equal(_repaired(stray, board), stray)


def test_boards_and_lengths_as_people_write_them() -> None:
    assert parse_board("9x6") == (9, 6)
    assert parse_board(" 6X4 ") == (6, 4)
    for text, metres in (("25mm", 0.025), ("2.5cm", 0.025), ("0.025m", 0.025), ("0.025", 0.025)):
        assert parse_length(text) == pytest.approx(metres)
    for text in ("9", "9x", "x6", "9x6x3", ""):
        with pytest.raises(ValueError, match="board"):
            parse_board(text)
    for text in ("25 inch", "-3mm", "0", "1..2mm", "nan"):
        with pytest.raises(ValueError, match="length"):
            parse_length(text)


@pytest.mark.parametrize("arguments", [{"columns": 2}, {"rows": 0}, {"square_m": 0.0}, {"square_m": float("nan")}])
def test_impossible_boards(arguments: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(arguments))):
        ep.Chessboard(**arguments)  # type: ignore[arg-type]


def test_every_pair_of_the_opencv_set(data: Path) -> None:
    views = ep.find_boards(*pairs(data / "calib" / "opencv_bouguet"), ep.Chessboard(columns=9, rows=6))
    assert (len(views), views.image_size) == (13, (640, 480))


def test_every_pair_of_the_bumblebee_set(data: Path) -> None:
    board = ep.Chessboard(columns=6, rows=4, square_m=0.03)
    assert len(ep.find_boards(*pairs(data / "calib" / "boofcv_Bumblebee2_Chess"), board)) == 11


def test_the_one_mis_found_grid_of_the_stereopi_set_is_named(data: Path) -> None:
    board = ep.Chessboard(columns=9, rows=6)
    views = ep.find_boards(*pairs(data / "calib" / "stereopi" / "pairs"), board)
    assert [view.name_right for view in views.rejected] == ["right_15.png"]
    assert "right: the grid is not regular" in views.rejected[0].reason


def test_no_board_raises_the_reason() -> None:
    with pytest.raises(NotFound, match="no 9x6 board"):
        find_corners(np.zeros((60, 80), np.uint8), ep.Chessboard(columns=9, rows=6))
