"""`epiline bench`: what it measures, that its checks can fail, and what it writes. No test looks at a time."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.benchmarking import Plan, Row, levels_here, measure_level, rows_as_csv
from epiline.benchmarking import contestants as run
from epiline.benchmarking import rounds as rounds_of
from epiline.benchmarking.contests import _equal_inside, rows
from epiline.benchmarking.pairs import Pair, pair_from
from epiline.benchmarking.rounds import ratio, time_in_turns
from epiline.cli import main

SMALL = (160, 120, 32)


@pytest.fixture(scope="module")
def pair() -> Pair:
    """A slope with texture: no file, no rendering."""
    noise = np.random.default_rng(0).integers(0, 256, (240, 420), np.uint8)
    scene = cv2.GaussianBlur(noise, (5, 5), 1.2)
    row, column = np.mgrid[0:240, 0:320].astype(np.float32)
    right = cv2.remap(scene, column + 4 + 20 * row / 240, row, cv2.INTER_LINEAR)
    return Pair(np.ascontiguousarray(scene[:, :320]), np.asarray(right, np.uint8), "slope")


def test_ratio_is_the_median_of_the_repetitions_ratios() -> None:
    # The second repetition met a busy machine: it slows both and must not count twice.
    slower, faster = np.array([4.0, 40.0, 6.0]), np.array([1.0, 10.0, 1.0])
    assert ratio(slower, faster).median == 4.0
    assert ratio(slower, faster).high == 5.0


def test_repetitions_alternate_after_a_first_turn_that_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    answer = np.zeros((1, 1), np.float32)
    both = [run.Contestant(n, lambda n=n: calls.append(n), lambda: answer) for n in "ab"]  # type: ignore[misc]
    assert time_in_turns(both, 5, 60.0, one_thread=True).shape == (5, 2)
    assert "".join(calls) == "ab" * 6
    calls.clear()
    # Where one turn takes all the time there is, the first counts, and two more follow.
    assert len(time_in_turns(both, 5, 0.0, one_thread=False)) == 3
    assert "".join(calls) == "ab" * 3
    monkeypatch.setattr(rounds_of, "_LONG_S", 0.0)
    assert len(time_in_turns(both, 5, 60.0, one_thread=True)) == 1


def test_block_matching_is_compared_with_stereo_bm_number_by_number(pair: Pair) -> None:
    """Held to a call of OpenCV written here, so that both contestants cannot be wrong together."""
    small = pair.resized(*SMALL[:2])
    theirs = run.stereo_bm(small, SMALL[2], 9, tests=False)
    theirs.work()
    bm = cv2.StereoBM.create(SMALL[2], 9)
    bm.setTextureThreshold(0)
    bm.setUniquenessRatio(0)
    raw = bm.compute(small.left, small.right)
    np.testing.assert_array_equal(theirs.answer(), np.where(raw < 0, np.nan, raw / 16).astype(np.float32))
    mine = run.sad(small, SMALL[2], 9, 1, tests=False).answer()
    check = _equal_inside(4, SMALL[2], both_answer=False)
    assert check(mine, theirs.answer()) == 1.0
    broken = mine.copy()
    broken[60, 100] += 1 / 16
    assert check(broken, theirs.answer()) < 1.0


def test_padding_gives_sgbm_the_left_border(pair: Pair) -> None:
    small = pair.resized(*SMALL[:2])
    plain, padded = (run.stereo_sgbm("3WAY", small, SMALL[2], tests=False, padded=p) for p in (False, True))
    for contestant in (plain, padded):
        contestant.work()
    assert np.isnan(plain.answer()[:, : SMALL[2]]).all()
    assert np.isfinite(padded.answer()[:, 8 : SMALL[2]]).mean() > 0.9
    inside = np.s_[:, SMALL[2] + 8 :]
    assert np.nanmean(np.abs(plain.answer()[inside] - padded.answer()[inside]) <= 1) > 0.95


def test_rows_name_every_contest(pair: Pair) -> None:
    plan = Plan(sizes=(SMALL,), threads=(1, 2), windows=(9,), repeats=3, budget_s=0.0)
    found = list(rows("here", pair, plan))
    contests = {(r.threads, r.tests, r.ours, r.theirs) for r in found}
    for threads in (1, 2):
        for tests in (False, True):
            assert (threads, tests, "sad, window 9", "StereoBM") in contests
            for method in ("sad5, window 9", "census, window 11", "bt, window 11"):
                assert (threads, tests, method, "StereoBM") in contests
            for preset in ("fast", "balanced", "accurate, filled" if tests else "accurate"):
                for peer in ("SGBM 3WAY", "SGBM 5-path", "SGBM HH", "SGBM 3WAY padded"):
                    assert (threads, tests, preset, peer) in contests
    assert (2, True, "fast", "fast, one thread") in contests
    assert {t for _, t, ours, _ in contests if ours.startswith("4 bands")} == {False, True}
    assert len(found) == 2 * (2 + 2 * (1 + 3 + 12)) + 3
    assert not [r for r in found if r.differs]
    assert all(r.checked > 0.8 for r in found)
    assert all(r.ratio_low <= r.ratio <= r.ratio_high for r in found)


def test_a_level_is_measured_in_a_process_of_that_level() -> None:
    here = levels_here()
    assert here[0] == "scalar"
    assert ep.simd_level() in here
    plan = Plan(sizes=(SMALL,), threads=(1,), windows=(9,), repeats=3, budget_s=0.0)
    first = next(iter(measure_level("scalar", plan, None)))
    assert isinstance(first, Row)
    assert first.level == "scalar"
    assert first.checked == 1.0


def test_a_worker_that_fails_says_why(tmp_path: Path) -> None:
    with pytest.raises(ep.Error, match=r"level scalar: .*manifest\.json"):
        list(measure_level("scalar", Plan(), tmp_path))


def test_rendered_pair_is_aligned() -> None:
    rendered = pair_from(None)
    assert abs(ep.alignment_error(rendered.left, rendered.right).median_px) < 0.1


def test_the_verb_prints_and_writes_what_it_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("EPILINE_DATA", raising=False)
    table = tmp_path / "rows.csv"
    arguments = ["bench", "--quick", "--sizes", "160x120x32", "--threads", "1", "--repeats", "3", "--record"]
    assert main([*arguments, "--csv", str(table), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert "OpenCV" in printed["machine"]
    head, *lines = table.read_text().splitlines()
    assert head == f"# {printed['machine']}"
    kept = list(csv.DictReader(lines))
    assert [row["ours"] for row in kept] == [row["ours"] for row in printed["results"]]
    assert {field.name for field in dataclasses.fields(Row)} == set(kept[0])
    (recorded,) = tmp_path.glob("benchmarks/record/*/*.csv")
    assert recorded.read_text() == table.read_text()


def test_rows_that_differ_end_with_status_1(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], pair: Pair
) -> None:
    import epiline.benchmarking

    plan = Plan(sizes=(SMALL,), threads=(1,), windows=(9,), repeats=3, budget_s=0.0)
    row = dataclasses.replace(next(r for r in rows("here", pair, plan) if r.theirs == "StereoBM"), checked=0.5)
    monkeypatch.delenv("EPILINE_DATA", raising=False)
    monkeypatch.setattr(epiline.benchmarking, "measure_level", lambda *_: [row])
    assert main(["bench", "--quick"]) == 1
    assert "1 rows differ" in capsys.readouterr().err


def test_csv_keeps_tables_and_curves_apart(pair: Pair) -> None:
    from epiline.benchmarking import Curve

    curve = Curve("here", "sad", "StereoBM", "width", 160, 1.0, 2.0)
    row = next(rows("here", pair, Plan(sizes=(SMALL,), threads=(1,), windows=(9,), repeats=3, budget_s=0.0)))
    lines = rows_as_csv("head", [curve, row]).splitlines()
    assert lines[0] == "# head"
    assert lines[1].startswith("level,width")
    assert lines[3].startswith("level,ours")


@pytest.mark.parametrize(
    "wrong",
    [["--sizes", "640x480"], ["--sizes", "640x480x60"], ["--sizes", "32x32x64"], ["--threads", "0"]],
)
def test_wrong_usage(wrong: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["bench", *wrong])
    assert caught.value.code == 2


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [(["--levels", "avx1024"], "avx1024"), (["--data", "/nowhere"], "/nowhere: no such folder")],
)
def test_hostile_arguments(arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bench", "--quick", *arguments]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert complaint in err
    assert len(err.strip().splitlines()) == 1


def test_without_opencv(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import importlib.util

    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert main(["bench"]) == 1
    assert "OpenCV" in capsys.readouterr().err
