"""Obstacle courses: what stands in them is what they promise, and the evaluation of them from end to end."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from pathlib import Path

import numpy as np
import pytest

import epiline as ep
from epiline.cli import main
from epiline.evaluation.obstacles import Entry, Report, Rules, Tally, evaluate_course, frame_truth, score_frame
from epiline.evaluation.obstacles.photographs import photographs
from epiline.evaluation.obstacles.rendered import calibration_of, drive
from epiline.evaluation.obstacles.truth import FrameTruth
from epiline.sources.rendered import Box, Pole, Tracer, true_depth
from epiline.sources.rendered.courses import HALVES, KERB_HEIGHT_M, KINDS, POLE_DIAMETER_M, Course, course, courses

SMALL = (320, 240)
GEOMETRY = ep.RectifiedGeometry(width=96, height=72, focal_px=66, cx_px=47.5, cy_px=35.5, baseline_m=0.1187)


def coarse_truths(chosen: Course) -> list[FrameTruth]:
    """The truth of every frame of a course, as a small camera would see it."""
    tracer, all_valid = Tracer(chosen.scene), np.ones((72, 96), bool)
    g = GEOMETRY
    shape = {"focal_px": g.focal_px, "cx_px": g.cx_px, "cy_px": g.cy_px, "width": g.width, "height": g.height}
    elapsed = np.linspace(0, chosen.path.duration_s, chosen.frames)
    views = [true_depth(tracer, chosen.path.world_from_left(t), **shape) for t in elapsed]  # type: ignore[arg-type]
    return [
        frame_truth(view, g, valid=(all_valid, all_valid), num_disparities=48, ground=chosen.ground) for view in views
    ]


def test_both_halves_have_every_kind_at_both_sizes_and_share_no_seed() -> None:
    everything = list(courses())
    assert {(c.half, c.kind, c.size) for c in everything} == {
        (half, kind, size) for half in HALVES for kind in KINDS for size in (SMALL, (640, 480))
    }
    assert len({c.seed for c in everything}) == len(everything)
    assert len({c.name for c in everything}) == len(everything)
    capped = list(courses(frames=2))
    assert {c.frames for c in capped} == {2}
    assert capped[0] == dataclasses.replace(course("boxes", "development", 0, SMALL, 2), path=capped[0].path)


def test_five_hundred_frames_of_a_free_path_are_free() -> None:
    rules = Rules()
    wide = rules.corridor_half_width_m + rules.corridor_margin_m
    free = [c for c in courses() if c.kind == "free"]
    clear = [truth.is_clear(wide, 1.05 * rules.reach_m) for c in free for truth in coarse_truths(c)]
    assert len(clear) >= 500
    assert all(clear)


@pytest.mark.parametrize("half", HALVES)
@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "free"])
def test_every_other_course_has_something_to_find(kind: str, half: str) -> None:
    chosen = course(kind, half, 1, SMALL, 3)  # type: ignore[arg-type]
    truths = coarse_truths(chosen)
    assert all(len(truth.asked(reach_m=6, min_pixels=4, min_side_px=1)) >= 1 for truth in truths)
    for truth in truths:
        assert not set(truth.solids) & {truth.names.index(name) for name in chosen.ground}


def test_only_rooms_whose_every_side_can_be_matched_count_as_such() -> None:
    by_kind: dict[str, set[bool]] = {}
    for each in courses():
        by_kind.setdefault(each.kind, set()).add(each.matchable)
    assert by_kind["boxes"] == by_kind["kerbs"] == {True}
    assert by_kind["textureless"] == by_kind["repetitive"] == {False}
    assert by_kind["free"] == {True, False}
    blank_floor = next(c for c in courses() if c.kind == "free" and c.scene.room.floor.pattern == "plain")
    assert not blank_floor.matchable


def test_poles_and_kerbs_are_as_thin_and_low_as_promised() -> None:
    poles = course("poles", "check", 0, SMALL, 1).scene.solids
    assert POLE_DIAMETER_M == 0.03
    assert sum(isinstance(s, Pole) and 2 * s.radius_m == POLE_DIAMETER_M for s in poles) >= 2
    kerbs = [s for s in course("kerbs", "check", 0, SMALL, 1).scene.solids if "kerb" in s.name]
    assert KERB_HEIGHT_M == 0.08
    assert [s.size_m[2] for s in kerbs if isinstance(s, Box)] == [KERB_HEIGHT_M] * 2


def test_a_ramp_of_one_in_twelve_begins_and_ends_without_a_step() -> None:
    chosen = course("ramps", "development", 0, SMALL, 1)
    ramp, platform = (s for s in chosen.scene.solids if isinstance(s, Box) and s.name in {"ramp", "platform"})
    long_m, _, thick_m = ramp.size_m
    ends = [np.array([x, 0, thick_m / 2]) @ ramp.rotation.T + ramp.center_m for x in (-long_m / 2, long_m / 2)]
    assert ends[0][2] == pytest.approx(0, abs=1e-9)
    assert ends[1][2] == pytest.approx(platform.size_m[2], abs=1e-9)
    assert ends[1][0] == pytest.approx(platform.center_m[0] - platform.size_m[0] / 2, abs=1e-9)
    assert (ends[1][2] - ends[0][2]) / (ends[1][0] - ends[0][0]) == pytest.approx(1 / 12)


def test_photographs_from_the_folder_are_those_rendered(tmp_path: Path) -> None:
    chosen = course("kerbs", "development", 0, SMALL, 2)
    fresh, kept, again = (list(photographs(chosen, cache)) for cache in (None, tmp_path, tmp_path))
    for one, two, three in zip(fresh, kept, again, strict=True):
        np.testing.assert_array_equal(one.left, two.left)
        np.testing.assert_array_equal(one.right, three.right)
        np.testing.assert_array_equal(one.world_from_left, three.world_from_left)
        assert one.stamp_nanos == two.stamp_nanos == three.stamp_nanos
    assert [photograph.stamp_nanos for photograph in fresh] == [0, round(1e9 * chosen.path.duration_s)]
    (file,) = tmp_path.iterdir()
    changed = dataclasses.replace(chosen, right_sensor=dataclasses.replace(chosen.right_sensor, gain=0.5))
    darker = next(iter(photographs(changed, tmp_path)))
    assert darker.right.mean() < 0.8 * fresh[0].right.mean()
    file.write_bytes(b"PK not an archive")
    with pytest.raises(ValueError, match=file.name):
        list(photographs(chosen, tmp_path))


def oracle(truth: FrameTruth) -> list[Report]:
    """What a finder that knows everything would say."""
    reports = []
    for asked in truth.asked(reach_m=7, min_pixels=1, min_side_px=1):
        here = truth.visible == asked.object_id
        near = here & (truth.depth_m <= asked.depth_m * 1.02)
        tangent = float(np.median((truth.lateral_m / truth.depth_m)[near]))
        ray = asked.range_m / asked.depth_m
        reports.append(
            Report(asked.depth_m * ray, 0.01 * asked.depth_m, asked.depth_m, float(np.arctan(tangent)), asked.columns)
        )
    return reports


@pytest.mark.parametrize("kind", ["boxes", "poles", "kerbs", "textureless"])
def test_who_knows_everything_scores_full_marks_and_who_says_nothing_none(kind: str) -> None:
    knowing, silent = Tally(), Tally()
    for frame in drive(course(kind, "check", 0, SMALL, 2), Entry("fast", {"preset": "fast", "threads": 1})):
        truth = frame.truth
        knowing.frames.append(score_frame(oracle(truth), truth, Rules()))
        silent.frames.append(score_frame([], truth, Rules()))
    best, worst = knowing.figures(), silent.figures()
    assert (best["recall"], best["precision"], best["doubles"]) == (100, 100, 0)
    assert best["asked"] >= 6
    # Its ranges are those of nearest ends, its bearings those of the near parts' middles: askew they differ a little.
    assert abs(best["bias"]) < 1
    assert best["gross"] == 0
    assert (worst["recall"], worst["found"], worst["asked"]) == (0, 0, best["asked"])


def test_the_pipeline_is_scored_and_its_regions_with_it() -> None:
    chosen = course("corridor", "check", 0, SMALL, 2)
    tally = evaluate_course(chosen, Entry("fast", {"preset": "fast", "threads": 1}))
    figures = tally.figures()
    assert figures["frames"] == 2
    assert figures["recall"] > 50
    assert figures["regions"] == 8
    assert abs(figures["region_bias"]) < 3
    blank = evaluate_course(course("textureless", "check", 0, SMALL, 1), Entry("fast", {"preset": "fast"}))
    assert blank.figures()["regions"] == 0


def test_single_parameters_change_the_pipelines_own_matcher_and_presets_replace_it() -> None:
    calibration = calibration_of(course("boxes", "check", 0, SMALL, 1).rig().truth)
    own = Entry("own").pipeline_for(calibration, 320).matcher_parameters
    changed = Entry("changed", {"threads": 1, "speckle_size": 7}).pipeline_for(calibration, 320).matcher_parameters
    assert changed == {**own, "threads": 1, "speckle_size": 7}
    preset = Entry("preset", {"preset": "fast"}).pipeline_for(calibration, 320).matcher_parameters
    assert preset == ep.StereoMatcher(preset="fast", num_disparities=own["num_disparities"]).parameters
    assert preset["block_size"] != own["block_size"]


def test_its_confirmed_tracks_are_scored_too() -> None:
    figures = evaluate_course(course("boxes", "check", 0, SMALL, 8), Entry("the pipeline's own")).figures()
    assert figures["track_frames"] == 6
    assert figures["track_reports"] > 6
    assert figures["track_recall"] > 30


def test_the_rig_of_a_course_is_known_exactly() -> None:
    rig = course("boxes", "check", 0, SMALL, 1).rig()
    calibration = calibration_of(rig.truth)
    assert calibration.baseline_m == pytest.approx(rig.truth.baseline_m, abs=1e-12)
    np.testing.assert_array_equal(calibration.left.camera_matrix, rig.truth.left.camera_matrix)


def test_the_verb(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    arguments = ["evaluate", "--obstacles", "--frames", "1", "--scenes", "kerbs-1300", "kerbs-2300"]
    arguments += ["--preset", "fast", "--cache", str(tmp_path)]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    for expected in ("preset fast", "development/kerbs", "check half", "precision %", "1 sigma %"):
        assert expected in text
    assert main([*arguments, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert [row["course"] for row in report["courses"]] == [
        "development/kerbs-1300-320x240",
        "check/kerbs-2300-320x240",
    ]
    assert {row["group"] for row in report["totals"]} == {"development half", "check half", "320x240", "all"}
    assert main([*arguments, "--csv"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [float(row["asked"]) for row in rows] == [row["asked"] for row in report["courses"]]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--scenes", "nowhere"], "no course's name contains nowhere"),
        (["--frames", "0"], "--frames 0: at least 1"),
    ],
)
def test_wrong_wishes_are_named(arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "--obstacles", *arguments]) == 1
    assert complaint in capsys.readouterr().err


def test_a_folder_or_obstacles_must_be_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["evaluate"])
    assert stopped.value.code == 2
    assert "name a FOLDER" in capsys.readouterr().err
