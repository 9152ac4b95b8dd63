"""Views that harm a calibration are named and left out; views that do not, stay."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.sources import open_source
from epiline.targets import Corners, View
from epiline.targets.cache import CornerCache
from epiline.targets.photograph import Look, look_at, read_grey
from epiline.targets.screening import screened
from epiline.targets.sharpness import edge_width_px

BOARD = ep.Chessboard(columns=9, rows=6, square_m=0.025)


@pytest.fixture(scope="module")
def bouguet(data: Path) -> tuple[list[np.ndarray], list[np.ndarray]]:
    source = open_source(str(data / "calib" / "opencv_bouguet"))
    sides = [[getattr(pair, side) for pair in source.pairs] for side in ("left", "right")]  # type: ignore[attr-defined]
    left, right = ([read_grey(path) for path in paths] for paths in sides)
    return left, right


def reasons(left: list[np.ndarray], right: list[np.ndarray]) -> dict[int, str]:
    """Reasons by number of the pair."""
    views = ep.find_boards(left, right, BOARD).views
    return {i: view.reason for i, view in enumerate(views) if not view.accepted}


def test_nothing_is_left_out_of_a_sound_set(bouguet: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    assert reasons(*bouguet) == {}


def test_a_repeated_view_is_left_out_once(bouguet: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    left, right = (list(side) for side in bouguet)
    rng = np.random.default_rng(0)
    for side in (left, right):
        noise = rng.normal(0, 2, side[3].shape)
        side.append(np.clip(side[3] + noise, 0, 255).astype(np.uint8))
    assert reasons(left, right) == {13: "the same view as left 3 / right 3"}


def test_the_same_board_in_one_camera_only_is_another_view(
    bouguet: tuple[list[np.ndarray], list[np.ndarray]],
) -> None:
    ids = np.arange(54)
    first = View("l0", "r0", Corners(np.zeros((54, 2)), ids), Corners(np.zeros((54, 2)), ids), True, "")
    moved = replace(first, name_left="l1", right=Corners(np.full((54, 2), 30.0), ids))
    assert [view.accepted for view in screened((first, moved), BOARD, (640, 480))] == [True, True]


@pytest.mark.parametrize("shake", [(0.0, 3.5), (15.0, 0.0)])
def test_a_blurred_view_is_named(
    bouguet: tuple[list[np.ndarray], list[np.ndarray]], shake: tuple[float, float]
) -> None:
    """Out of focus, and moved sideways while the shutter was open."""
    left, right = (list(side) for side in bouguet)
    along, sigma = shake
    if along:
        right[5] = cv2.blur(right[5], (int(along), 1))
    else:
        right[5] = cv2.GaussianBlur(right[5], (0, 0), sigma)
    found = reasons(left, right)
    assert set(found) == {5}
    assert found[5].startswith("right: blurred: its edges are ")


def test_edge_width_is_that_of_the_blur() -> None:
    """An ideal step blurred by a Gaussian rises from 10 to 90 % over 2.563 sigma."""
    y, x = np.mgrid[0:320, 0:320]
    flat = np.where((x // 40 + y // 40) % 2 == 0, 40.0, 210.0)
    corners = np.stack(np.meshgrid(np.arange(1, 8), np.arange(1, 8)), -1) * 40.0 - 0.5
    for sigma in (1.2, 2.0, 3.0):
        image = np.rint(cv2.GaussianBlur(flat, (0, 0), sigma)).astype(np.uint8)
        # The pixels' own box and the interpolation between them blur by half a pixel more.
        assert edge_width_px(image, corners) == pytest.approx(2.563 * np.hypot(sigma, 0.5), rel=0.06)
    assert np.isnan(edge_width_px(np.full((320, 320), 90, np.uint8), corners))


def test_photographs_of_two_moments_are_named(bouguet: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    left, right = (list(side) for side in bouguet)
    right[2], right[9] = right[9], right[2]
    found = reasons(left, right)
    assert set(found) == {2, 9}
    assert all("not of one moment" in reason for reason in found.values())


def test_a_moved_corner_is_left_out_alone(bouguet: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    views = ep.find_boards(*bouguet, BOARD)
    view = views.views[4]
    assert view.right is not None
    px = view.right.px.copy()
    px[20] += (2.0, -1.5)
    broken = replace(view, right=replace(view.right, px=px))
    moved = replace(views, views=(*views.views[:4], broken, *views.views[5:]))
    found = screened(moved.views, BOARD, views.image_size)
    assert [v.accepted for v in found] == [True] * 13
    # The fit leaves it out by itself.
    outliers = ep.calibrate(moved).outliers
    assert (4, "right", 20) in [(o.view, o.side, o.corner) for o in outliers]
    assert len(outliers) - len(ep.calibrate(views).outliers) == 1


def test_a_board_mis_found_by_a_row_is_named(bouguet: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    """A grid shifted by a square is regular in itself: only the other pairs tell."""
    views = ep.find_boards(*bouguet, BOARD)
    view = views.views[6]
    assert view.right is not None
    grid = view.right.px.reshape(6, 9, 2)
    beyond = 2 * grid[:, -1:] - grid[:, -2:-1]
    shifted = np.concatenate([grid[:, 1:], beyond], axis=1).reshape(-1, 2)
    broken = replace(view, right=replace(view.right, px=shifted))
    found = screened((*views.views[:6], broken, *views.views[7:]), BOARD, views.image_size)
    assert [i for i, v in enumerate(found) if not v.accepted] == [6]


def test_a_pair_that_fits_far_worse_than_the_others_is_named(
    bouguet: tuple[list[np.ndarray], list[np.ndarray]],
) -> None:
    """Its corners are all over the place, but around a board that is where it should be."""
    views = ep.find_boards(*bouguet, BOARD)
    view = views.views[8]
    assert view.left is not None
    rng = np.random.default_rng(0)
    shaken = replace(view, left=replace(view.left, px=view.left.px + rng.normal(0, 1.5, (54, 2))))
    found = screened((*views.views[:8], shaken, *views.views[9:]), BOARD, views.image_size)
    assert [i for i, v in enumerate(found) if not v.accepted] == [8]
    assert "px off where the other pairs put them" in found[8].reason


def test_a_view_of_one_camera_still_informs_it(bouguet: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    left, right = bouguet
    blank = np.full_like(left[0], 128)
    views = ep.find_boards([*left[:6], left[6], None], [*right[:6], blank, right[7]], BOARD)
    assert len(views) == 6
    assert [view.reason for view in views.rejected] == [
        "right: no 9x6 board",
        "left: there is no such photograph",
    ]
    (only_left,), (only_right,) = views.single_views("left"), views.single_views("right")
    assert (only_left.name, only_right.name) == ("left 6", "right 7")
    assert only_left.px.shape == (54, 2)
    np.testing.assert_array_equal(only_right.board_m, BOARD.points_m)


def test_a_look_survives_json() -> None:
    seen = Corners(np.array([[1 / 3, 2.0], [1e-17, 5.5]]), np.array([3, 9]), 2.25, "a remark", True)
    for look in (Look((640, 480), (seen,)), Look((1, 2), (), "no board"), Look(None, (), "damaged")):
        again = Look.from_json(json.loads(json.dumps(look.as_json())))
        assert (again.size, again.failure, len(again.readings)) == (look.size, look.failure, len(look.readings))
        for one, other in zip(again.readings, look.readings, strict=True):
            np.testing.assert_array_equal(one.px, other.px)
            np.testing.assert_array_equal(one.ids, other.ids)
            assert (one.edge_width_px, one.remark, one.found_again) == (
                other.edge_width_px,
                other.remark,
                other.found_again,
            )


def drawn() -> np.ndarray:
    y, x = np.mgrid[0:240, 0:320]
    flat = np.where((x // 24 + y // 24) % 2 == 0, 40, 210)
    inside = (x >= 24) & (x < 264) & (y >= 24) & (y < 192)
    image: np.ndarray = cv2.GaussianBlur(np.where(inside, flat, 210).astype(np.uint8), (0, 0), 0.8)
    return image


def test_the_cache_saves_looking_and_sees_what_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    left, right, cache = tmp_path / "left.png", tmp_path / "right.png", tmp_path / "corners.json"
    cv2.imwrite(str(left), drawn())
    cv2.imwrite(str(right), np.roll(drawn(), 7, axis=1))
    looked: list[str] = []

    def counted(photograph: Path, *rest: object) -> Look:
        looked.append(photograph.name)
        return look_at(photograph, *rest)  # type: ignore[arg-type]

    monkeypatch.setattr("epiline.targets.search.look_at", counted)

    def find(board: ep.Chessboard = BOARD) -> ep.Observations:
        looked.clear()
        return ep.find_boards([left], [right], board, cache=cache)

    first = find()
    assert sorted(looked) == ["left.png", "right.png"]
    second = find()
    assert looked == []
    np.testing.assert_array_equal(first.left_px, second.left_px)
    cv2.imwrite(str(right), np.roll(drawn(), 9, axis=1))
    find()
    assert looked == ["right.png"]
    find(ep.Chessboard(columns=9, rows=6, square_m=0.05))
    assert sorted(looked) == ["left.png", "right.png"]
    # Corners that an older version refined otherwise are not mixed with new ones.
    monkeypatch.setattr("epiline.targets.cache._WAY_OF_LOOKING", -1)
    find()
    assert sorted(looked) == ["left.png", "right.png"]
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_a_broken_off_run_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    files = [tmp_path / f"{i}.png" for i in range(4)]
    for i, file in enumerate(files):
        cv2.imwrite(str(file), np.roll(drawn(), 5 * i, axis=1))

    def broken_off(photograph: Path, *rest: object) -> Look:
        if photograph.name == "3.png":
            raise KeyboardInterrupt
        return look_at(photograph, *rest)  # type: ignore[arg-type]

    cache = tmp_path / "corners.json"
    with monkeypatch.context() as patch:
        patch.setattr("epiline.targets.search.look_at", broken_off)
        with pytest.raises(KeyboardInterrupt):
            ep.find_boards(files[::2], files[1::2], BOARD, cache=cache, threads=1)
    kept = CornerCache(cache, BOARD, None)
    assert [kept.get(file) is not None for file in files] == [True, True, True, False]


def test_a_file_that_is_no_cache_is_left_alone(tmp_path: Path) -> None:
    file = tmp_path / "rig.yaml"
    for content in (b"%YAML", b"{}", b'{"format": "another", "looks": {}}', b""):
        file.write_bytes(content)
        with pytest.raises(OSError, match=r"rig\.yaml: is there and is no cache"):
            CornerCache(file, BOARD, None)
        assert file.read_bytes() == content
