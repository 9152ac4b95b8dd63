"""The scorer of obstacles on frames made by hand: what it counts as found, missed, doubled and not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from epiline import Detection, Tracker
from epiline.evaluation.obstacles import FrameScore, FrameTruth, RangeSample, Report, Rules, Tally, score_frame
from epiline.evaluation.obstacles.followed import FIRST_FRAME, Followed
from epiline.evaluation.obstacles.tally import range_figures
from epiline.evaluation.obstacles.truth import NOTHING, seen_by_both

FOCAL_PX, WIDTH, HEIGHT = 100.0, 160, 60
CX = (WIDTH - 1) / 2
WALL_M = 5.0
WALL, BOX, POLE = 2, 6, 7
NAMES = ("floor", "ceiling", "front wall", "back wall", "left wall", "right wall", "box", "pole")


def frame(*, wall_m: float = WALL_M) -> FrameTruth:
    """A wall across the image, before it a box at 3 m (columns 20 to 59) and a pole at 2 m (columns 100 to 103)."""
    depth = np.full((HEIGHT, WIDTH), wall_m)
    standing = np.full((HEIGHT, WIDTH), WALL, np.int16)
    for object_id, z, first, last, top in ((BOX, 3.0, 20, 59, 20), (POLE, 2.0, 100, 103, 5)):
        depth[top:50, first : last + 1] = z
        standing[top:50, first : last + 1] = object_id
    standing[50:] = NOTHING
    lateral = (np.arange(WIDTH) - CX) / FOCAL_PX * depth
    down = (np.arange(HEIGHT) - 30)[:, None] / FOCAL_PX * depth
    range_m = np.sqrt(depth**2 + lateral**2 + down**2)
    height = np.where(standing == NOTHING, 0.0, 0.5)
    return FrameTruth(
        range_m, depth, lateral, height, standing, np.ones_like(standing, bool), NAMES, frozenset({BOX, POLE})
    )


def report(z: float, first: int, last: int, *, sigma_m: float = 0.03) -> Report:
    """A report of something square on at depth `z`."""
    tangent = ((first + last) / 2 - CX) / FOCAL_PX
    return Report(z * np.hypot(1, tangent), sigma_m, z, float(np.arctan(tangent)), (first, last))


BOX_REPORT, POLE_REPORT = report(3.0, 20, 59), report(2.0, 100, 103)
PERFECT = [BOX_REPORT, POLE_REPORT]


def figures(*scores: FrameScore) -> dict[str, float]:
    return Tally(list(scores)).figures()


def test_a_perfect_answer() -> None:
    score = score_frame(PERFECT, frame(), Rules())
    assert score.verdicts == ["real", "real"]
    assert [asked.name for asked in score.found] == ["pole", "box"]
    assert score.missed == []
    counted = figures(score)
    assert (counted["precision"], counted["recall"]) == (100.0, 100.0)
    assert [sample.name for sample in score.ranges] == ["pole", "box"]
    assert counted["bias"] == pytest.approx(0, abs=1e-9)


def test_the_order_of_reports_does_not_matter() -> None:
    assert score_frame(PERFECT[::-1], frame(), Rules()) == score_frame(PERFECT, frame(), Rules())


def test_a_missing_report_is_a_missed_obstacle() -> None:
    score = score_frame([BOX_REPORT], frame(), Rules())
    assert [asked.name for asked in score.missed] == ["pole"]
    assert (figures(score)["precision"], figures(score)["recall"]) == (100.0, 50.0)
    assert figures(score_frame([], frame(), Rules()))["recall"] == 0
    assert np.isnan(figures(score_frame([], frame(), Rules()))["precision"])


@pytest.mark.parametrize("again", [BOX_REPORT, report(3.1, 25, 50), report(2.95, 20, 30)])
def test_a_second_report_at_the_same_place_is_a_double(again: Report) -> None:
    score = score_frame([*PERFECT, again], frame(), Rules())
    assert sorted(score.verdicts) == ["double", "real", "real"]
    assert (figures(score)["precision"], figures(score)["recall"]) == (pytest.approx(200 / 3), 100.0)


def test_two_halves_of_a_solid_are_no_double_but_both_real() -> None:
    score = score_frame([report(3.0, 20, 38), report(3.0, 40, 59), POLE_REPORT], frame(), Rules())
    assert score.verdicts == ["real", "real", "real"]


@pytest.mark.parametrize(
    "ghost",
    [
        report(1.0, 60, 80),  # before the wall
        report(4.0, 60, 80),  # between box and wall
        report(2.5, 20, 59),  # before the box
        report(3.0, 104, 159),  # the box's range at other columns
        report(5.8, 60, 80),  # behind the wall
    ],
)
def test_what_is_not_there_is_a_ghost(ghost: Report) -> None:
    score = score_frame([*PERFECT, ghost], frame(), Rules())
    assert sorted(score.verdicts) == ["ghost", "real", "real"]
    assert figures(score)["precision"] == pytest.approx(200 / 3)


def test_a_wall_is_real_however_often_but_not_asked_for() -> None:
    walls = [report(5.0, 60, 99), report(5.0, 60, 99), report(5.0, 104, 159)]
    score = score_frame([*PERFECT, *walls], frame(), Rules())
    assert score.verdicts == ["real"] * 5
    assert figures(score)["asked"] == 2


def test_a_report_on_floor_alone_is_a_ghost() -> None:
    truth = frame()
    floor = replace(truth, standing=np.full_like(truth.standing, NOTHING), solids=frozenset())
    assert score_frame([BOX_REPORT], floor, Rules()).verdicts == ["ghost"]


def test_a_report_far_off_in_range_neither_finds_nor_is_real() -> None:
    score = score_frame([report(3.3, 20, 59)], frame(), Rules())
    assert score.verdicts == ["ghost"]
    assert len(score.missed) == 2


def test_a_wide_sigma_widens_the_tolerance_up_to_a_limit() -> None:
    assert score_frame([report(3.3, 20, 59, sigma_m=0.15)], frame(), Rules()).verdicts == ["real"]
    for sigma_m in (10.0, float("inf"), float("nan")):
        assert score_frame([report(2.4, 20, 59, sigma_m=sigma_m)], frame(), Rules()).verdicts == ["ghost"]


def test_beyond_reach_nothing_is_asked_for_and_reports_are_not_judged() -> None:
    truth = frame(wall_m=9.0)
    score = score_frame([*PERFECT, report(7.0, 60, 80)], truth, Rules())
    assert score.verdicts == ["real", "real"]
    assert score_frame([], truth, Rules(reach_m=2.5)).missed[0].name == "pole"
    assert len(score_frame([], truth, Rules(reach_m=2.5)).missed) == 1


def test_what_both_cameras_hardly_see_is_not_asked_for_but_may_be_reported() -> None:
    truth = frame()
    hidden = replace(truth, seen=truth.seen & (truth.standing != POLE))
    score = score_frame(PERFECT, hidden, Rules())
    assert [asked.name for asked in score.found] == ["box"]
    assert score.verdicts == ["real", "real"]
    one_column = replace(truth, seen=truth.seen & ((truth.standing != POLE) | (np.arange(WIDTH) == 101)))
    assert [asked.name for asked in score_frame([], one_column, Rules()).missed] == ["box"]


def test_a_partly_hidden_solid_is_asked_for_by_what_is_seen() -> None:
    truth = frame()
    half = replace(truth, seen=truth.seen & ((truth.standing != BOX) | (np.arange(WIDTH) >= 40)))
    (box,) = (a for a in score_frame([], half, Rules()).missed if a.name == "box")
    assert box.columns == (40, 59)
    assert box.pixels == 20 * 30


def test_a_sliver_behind_the_edge_of_something_nearer_is_not_asked_for() -> None:
    truth = frame()
    for width, asked in ((3, ["box"]), (4, ["box"]), (12, ["box", "pole"])):
        depth, standing = truth.depth_m.copy(), np.where(truth.standing == POLE, WALL, truth.standing).astype(np.int16)
        depth[truth.standing == POLE] = WALL_M
        # The second solid shows right of the box, half a metre behind it.
        depth[20:50, 60 : 60 + width], standing[20:50, 60 : 60 + width] = 3.5, POLE
        hidden = replace(truth, depth_m=depth, range_m=depth, standing=standing)
        assert sorted(a.name for a in score_frame([], hidden, Rules()).missed) == asked
    # What stands before something, be it as thin, is asked for.
    assert [a.name for a in score_frame([], truth, Rules()).missed] == ["pole", "box"]


def test_a_report_in_a_free_corridor_blocks_it() -> None:
    truth = frame(wall_m=9.0)
    ghost = report(2.0, 75, 85)
    clear = replace(truth, standing=np.where(truth.standing == POLE, NOTHING, truth.standing).astype(np.int16))
    # The box at 3 m ends 0.6 m left of the axis; the pole, gone, was 0.44 m right of it.
    assert score_frame([BOX_REPORT], clear, Rules()).corridor_free
    assert score_frame([BOX_REPORT], clear, Rules()).intrusions == 0
    assert score_frame([BOX_REPORT, ghost], clear, Rules()).intrusions == 1
    assert figures(score_frame([BOX_REPORT, ghost], clear, Rules()))["blocked_frames"] == 1
    # A wall at the side that is seen as far as the middle does not stand in the corridor; its near end decides.
    beside = report(2.0, 0, 10)
    along = replace(beside, columns=(0, 85))
    walled = replace(clear, depth_m=clear.depth_m.copy(), standing=clear.standing.copy())
    walled.depth_m[:, :11], walled.standing[:, :11] = 2.0, WALL
    assert score_frame([along], walled, Rules()).verdicts == ["real"]
    assert score_frame([along], walled, Rules()).intrusions == 0
    assert score_frame([along], clear, Rules()).verdicts == ["ghost"]
    assert score_frame([along], clear, Rules()).intrusions == 1
    # Something stands there: whatever is said about the corridor, it was not free.
    assert not score_frame([ghost], truth, Rules()).corridor_free
    assert score_frame([ghost], truth, Rules()).intrusions == 0


def test_ranges_are_held_to_where_the_report_points() -> None:
    """A slanting face: its nearest end is not where its middle is."""
    truth = frame()
    slant = 3.0 + 0.4 * (np.arange(WIDTH) - 20) / 39
    depth = np.where(truth.standing == BOX, slant, truth.depth_m)
    lateral = (np.arange(WIDTH) - CX) / FOCAL_PX * depth
    slanted = replace(truth, depth_m=depth, lateral_m=lateral, range_m=truth.range_m * depth / truth.depth_m)
    at_end, at_middle = report(3.03, 20, 24), report(3.2, 20, 59, sigma_m=0.1)
    for said, z in ((at_end, 3.02), (at_middle, 3.2)):
        samples = [sample for sample in score_frame([said], slanted, Rules()).ranges if sample.name == "box"]
        assert samples[0].true_m == pytest.approx(z / np.cos(said.bearing_rad), rel=0.01)


def test_the_far_part_of_a_long_solid_does_not_find_it() -> None:
    truth = frame()
    depth = np.where(truth.standing == BOX, 3.0 + (np.arange(WIDTH) - 20) / 39, truth.depth_m)
    lateral = (np.arange(WIDTH) - CX) / FOCAL_PX * depth
    long = replace(truth, depth_m=depth, lateral_m=lateral, range_m=truth.range_m * depth / truth.depth_m)
    far, near = report(3.9, 50, 59), report(3.05, 20, 30)
    assert score_frame([far], long, Rules()).verdicts == ["real"]
    assert "box" in [asked.name for asked in score_frame([far], long, Rules()).missed]
    assert "box" in [asked.name for asked in score_frame([far, near], long, Rules()).found]


def test_of_a_slanting_face_the_point_of_smallest_depth_or_of_smallest_range_finds_it() -> None:
    """The face recedes toward the axis: its far end has the larger depth and may yet be the nearest point."""
    truth = frame()
    depth = np.where(truth.standing == BOX, 3.0 + 0.35 * (np.arange(WIDTH) - 20) / 39, truth.depth_m)
    lateral = (np.arange(WIDTH) - CX) / FOCAL_PX * depth
    range_m = np.where(truth.standing == BOX, 3.0 + 0.35 * (59 - np.arange(WIDTH)) / 39, truth.range_m)
    slanting = replace(truth, depth_m=depth, lateral_m=lateral, range_m=range_m)
    smallest_depth, smallest_range = report(3.0, 20, 22), replace(report(3.35, 20, 59), range_m=3.0)
    neither = replace(report(3.35, 20, 59), range_m=3.35)
    for said, found in ((smallest_depth, True), (smallest_range, True), (neither, False)):
        assert ("box" in [a.name for a in score_frame([said], slanting, Rules()).found]) == found


def test_shares_within_one_and_two_sigma() -> None:
    z = np.random.default_rng(5).standard_normal(4000)
    samples = [RangeSample("a", 2.0 + 0.01 * value, 2.0, 0.01) for value in z]
    counted = range_figures(samples)
    assert counted["within_1"] == pytest.approx(68.3, abs=2)
    assert counted["within_2"] == pytest.approx(95.4, abs=1)
    assert counted["bias"] == pytest.approx(0, abs=0.02)
    assert counted["gross"] == 0
    boastful = range_figures([replace(sample, sigma_m=0.005) for sample in samples])
    assert boastful["within_1"] < 45
    shifted = range_figures([replace(sample, reported_m=1.01 * sample.reported_m) for sample in samples])
    assert shifted["bias"] == pytest.approx(1.0, abs=0.03)
    assert range_figures([RangeSample("a", 2.2, 2.0, 0.0)])["gross"] == 100
    assert range_figures([RangeSample("a", 2.2, 2.0, 0.0)])["within_2"] == 0


def test_who_sees_what() -> None:
    """A board at 20 px before a wall at 4 px: the right camera misses 16 columns of wall left of the board."""
    disparity = np.full((4, 100), 4.0)
    disparity[:, 50:70] = 20.0
    seen = seen_by_both(disparity, np.ones((4, 100), bool))
    expected = np.ones(100, bool)
    expected[:4] = False  # outside the right image
    expected[34:50] = False  # the board covers right columns 30 to 49
    np.testing.assert_array_equal(seen, np.tile(expected, (4, 1)))
    no_source = np.ones((4, 100), bool)
    no_source[:, 40:60] = False
    expected[60:70] = False  # the board's right half, by its partners
    np.testing.assert_array_equal(seen_by_both(disparity, no_source), np.tile(expected, (4, 1)))


def detection(of: Report) -> Detection:
    """What a finder hands to a tracker for that report."""
    first, last = of.columns
    width_m = (last + 1 - first) * of.depth_m / FOCAL_PX
    return Detection(
        of.range_m,
        of.bearing_rad,
        of.sigma_m,
        depth_m=of.depth_m,
        width_m=width_m,
        height_m=0.5,
        support=200,
        box=(first, 20, last + 1 - first, 30),
    )


def test_confirmed_tracks_are_scored_from_the_first_frame_they_can_be() -> None:
    tracker, followed, truth = Tracker(), Followed(Rules()), frame()
    for i in range(6):
        followed.add(tracker.update([detection(report) for report in PERFECT], i * 100_000_000), truth)
    assert len(followed.frames) == 6 - FIRST_FRAME
    scored = Tally(followed=followed.frames, switches=followed.switches).figures()
    assert (scored["track_recall"], scored["track_precision"], scored["track_switches"]) == (100, 100, 0)


def test_a_ghost_of_one_frame_is_no_confirmed_track() -> None:
    tracker, followed, truth = Tracker(), Followed(Rules()), frame()
    for i in range(6):
        said = [*PERFECT, report(1.0, 60, 80)] if i == 3 else PERFECT
        followed.add(tracker.update([detection(report) for report in said], i * 100_000_000), truth)
    assert all(score.verdicts == ["real", "real"] for score in followed.frames)


def test_a_solid_that_is_followed_by_another_track_than_before_is_a_switch() -> None:
    tracker, followed, truth = Tracker(), Followed(Rules()), frame()
    for i in range(10):
        if i == 5:
            tracker.reset()
        followed.add(tracker.update([detection(report) for report in PERFECT], i * 100_000_000), truth)
    assert followed.switches == 2
    assert [len(score.missed) for score in followed.frames] == [0, 0, 0, 2, 2, 0, 0, 0]
