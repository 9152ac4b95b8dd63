"""`epiline tune`: the search against a brute-force one, the judges against the truth, and what the verb writes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep
from epiline.cli import main
from epiline.cli.configuration import read_configuration
from epiline.sinks.disparity import pfm_bytes
from epiline.tuning import (
    DisparityRange,
    Quality,
    Tuner,
    consensus_judge,
    find_range,
    parse_objective,
    truth_judge,
)
from epiline.tuning.judges import reference_of
from epiline.tuning.objective import MEASURES
from epiline.tuning.search import Pair

Images = tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.float32]]


def slope(seed: int = 0, nearest: float = 22.0, *, strip: bool = True) -> Images:
    """A textured floor that comes nearer downward, with a strip that the right camera sees differently."""
    random = np.random.default_rng(seed)
    scene = cv2.GaussianBlur(random.integers(0, 256, (120, 320), np.uint8), (5, 5), 1.2)
    row, column = np.mgrid[0:120, 0:240].astype(np.float32)
    truth = 6 + (nearest - 6) * row / 119
    right = np.asarray(cv2.remap(scene, column + truth, row, cv2.INTER_LINEAR), np.uint8)
    if strip:
        right[40:60, 80:140] = random.integers(0, 256, (20, 60), np.uint8)
    return np.ascontiguousarray(scene[:, :240]), right, truth.astype(np.float32)


def test_objectives() -> None:
    quality = Quality(density=60.0, wrong=dict.fromkeys(MEASURES, 10.0))
    assert parse_objective("bad2").cost(quality) == pytest.approx(40 + 6)
    assert parse_objective("d1@60").cost(quality) == 10.0
    # Too few answers are worse than any wrong ones, and fewer are worse still.
    assert parse_objective("bad1@80").cost(quality) == 120.0
    assert str(parse_objective("bad3@5")) == "bad3@5"
    for text in ("bad4", "bad2@", "bad2@101", "", "bad2 @80"):
        with pytest.raises(ValueError, match="objective"):
            parse_objective(text)


def test_range_holds_the_disparities_of_the_pair() -> None:
    left, right, truth = slope(nearest=30.0, strip=False)
    found = find_range([(left, right)], 1)
    assert found.first == 0
    assert 30 < found.first + found.count <= 48
    assert found.lowest_seen == pytest.approx(truth.min(), abs=1)
    assert found.highest_seen == pytest.approx(truth.max(), abs=1.5)


def test_range_starts_above_zero_where_nothing_is_far() -> None:
    random = np.random.default_rng(3)
    scene = cv2.GaussianBlur(random.integers(0, 256, (100, 500), np.uint8), (5, 5), 1.2)
    left, right = np.ascontiguousarray(scene[:, :400]), np.ascontiguousarray(scene[:, 70:470])
    found = find_range([(left, right)], 1)
    assert found.first == 48
    assert found.first + found.count >= 77


def test_a_pair_without_matches_is_refused() -> None:
    blank = np.full((60, 200), 128, np.uint8)
    with pytest.raises(ep.Error, match="no reliable match"):
        find_range([(blank, blank)], 1)


def test_truth_judge_counts_as_the_evaluation_does() -> None:
    truth = np.array([[10.0, 10.0, 10.0, np.nan]], np.float32)
    quality = truth_judge(truth)(np.array([[10.5, 14.0, np.nan, 3.0]], np.float32))
    assert quality.density == pytest.approx(200 / 3)
    assert quality.wrong == {"bad1": 50.0, "bad2": 50.0, "bad3": 50.0, "d1": 50.0}
    assert truth_judge(truth)(np.full((1, 4), np.nan, np.float32)).wrong["bad2"] == 100.0


def test_consensus_judge_tells_good_maps_from_bad() -> None:
    left, right, truth = slope()
    judge = consensus_judge(left, right, DisparityRange(0, 32, 6, 22), 1)
    random = np.random.default_rng(0)
    previous = -1.0
    # The more of a map is off by 5 px, the worse it must look, and by about that share.
    for share in (0.0, 0.1, 0.3, 0.6):
        values = truth.copy()
        off = random.random(truth.shape) < share
        values[off] += 5
        wrong = judge(values).wrong["bad2"]
        assert previous < wrong
        assert wrong == pytest.approx(100 * share, abs=8)
        previous = wrong
    assert judge(np.full_like(truth, np.nan)).density == 0.0


def test_search_finds_what_a_try_of_every_value_finds() -> None:
    """One sweep over one parameter is exhaustive; what is taken must be its minimum, by a loop written here."""
    left, right, truth = slope()
    pair = Pair(left, right, truth_judge(truth))
    objective = parse_objective("bad2")
    found = Tuner([pair], DisparityRange(0, 32, 6, 22), objective, threads=1).search()

    def cost(**parameters: Any) -> float:
        values = ep.match(left, right, num_disparities=32, threads=1, **parameters).values
        error = np.abs(values - truth)
        return float(100 * (~(error <= 2)).mean())

    presets = {name: cost(preset=name) for name in ("fast", "balanced", "accurate")}
    assert found.steps[0].taken == min(presets, key=lambda name: presets[name])
    assert found.best.cost <= min(presets.values())
    assert found.best.cost == pytest.approx(cost(**{k: v for k, v in found.best.parameters.items() if k[:4] != "num_"}))
    current = {"preset": found.steps[0].taken}
    for step in found.steps[1:]:
        for value, trial in step.tried:
            assert trial.cost == pytest.approx(cost(**{**current, step.parameter: value}))
        costs = {value: trial.cost for value, trial in step.tried}
        assert costs[step.taken] <= min(costs.values()) + 0.05
        current[step.parameter] = step.taken


def test_a_time_budget_that_nothing_meets_takes_the_fastest() -> None:
    left, right, truth = slope()
    pair = Pair(left, right, truth_judge(truth))
    found = Tuner([pair], DisparityRange(0, 32, 6, 22), parse_objective("bad2"), max_ms=1e-6, threads=1).search()
    times = {name: trial.milliseconds for name, trial in found.steps[0].tried}
    assert found.steps[0].taken == min(times, key=lambda name: times[name])
    assert "none is within" in found.steps[0].reason


@pytest.fixture
def files(tmp_path: Path) -> Callable[[int], list[str]]:
    def write(seed: int) -> list[str]:
        left, right, truth = slope(seed)
        paths = [tmp_path / f"{name}{seed}" for name in ("left.png", "right.png", "truth.pfm")]
        paths = [p.with_name(f"{p.name[:-1].split('.')[0]}{seed}.{p.name[:-1].split('.')[1]}") for p in paths]
        cv2.imwrite(str(paths[0]), left)
        cv2.imwrite(str(paths[1]), right)
        paths[2].write_bytes(pfm_bytes(truth))
        return [str(p) for p in paths]

    return write


def test_what_it_writes_is_what_run_reads(
    files: Callable[[int], list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    left, right, _ = files(0)
    out = tmp_path / "run.toml"
    assert main(["tune", left, right, "-o", str(out), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["judge"] == "consensus"
    assert report["held_out"] is None
    kept = read_configuration(out).matcher
    assert kept == {k: v for k, v in report["parameters"].items() if v is not None}
    assert ep.StereoMatcher(**kept).parameters["block_size"] == report["parameters"]["block_size"]


def test_every_other_pair_is_held_out(files: Callable[[int], list[str]], capsys: pytest.CaptureFixture[str]) -> None:
    first, second = files(0), files(1)
    pairs = [*first[:2], *second[:2]]
    assert main(["tune", *pairs, "--truth", first[2], second[2], "--json"]) == 0
    both = json.loads(capsys.readouterr().out)
    assert main(["tune", *first[:2], "--truth", first[2], "--json"]) == 0
    alone = json.loads(capsys.readouterr().out)
    assert both["cost"] == pytest.approx(alone["cost"], abs=0.5)
    assert both["held_out"]["cost"] != both["cost"]


def test_it_says_what_it_chose_and_why(files: Callable[[int], list[str]], capsys: pytest.CaptureFixture[str]) -> None:
    left, right, truth = files(0)
    assert main(["tune", left, right, "--truth", truth, "--objective", "bad1@50"]) == 0
    text = capsys.readouterr().out
    for expected in ("ground truth", "bad1@50", "num_disparities", "block_size", "chosen:"):
        assert expected in text


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (lambda f, t: [f[0]], "expected LEFT RIGHT"),
        (lambda f, t: [], "expected LEFT RIGHT"),
        (lambda f, t: [f[0], str(t / "no.png")], "no.png"),
        (lambda f, t: [f[0], f[1], "--truth", f[2], f[2]], "2 ground truths for 1 pairs"),
        (lambda f, t: [f[0], f[1], "--objective", "best"], "objective 'best'"),
        (lambda f, t: [f[0], f[1], "-o", str(t / "none" / "run.toml")], "run.toml"),
        (lambda f, t: [f[0], f[1], "--check", str(t)], "--check takes"),
        (lambda f, t: ["--check", str(t / "nowhere")], "nowhere"),
    ],
)
def test_hostile_arguments(
    change: Callable[[list[str], Path], list[str]],
    complaint: str,
    files: Callable[[int], list[str]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["tune", *change(files(0), tmp_path)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    assert complaint in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize("which", ["right", "truth"])
def test_sizes_that_differ_are_named(
    which: str, files: Callable[[int], list[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    left, right, _ = files(0)
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((30, 40), np.uint8))
    chosen = [left, str(small)] if which == "right" else [left, right, "--truth", str(small)]
    assert main(["tune", *chosen]) == 1
    assert "small.png: 40x30 px" in capsys.readouterr().err


def test_check_compares_both_choices(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", "--check", str(data), "--scenes", "2003/cones", "--json"]) == 0
    (row,) = json.loads(capsys.readouterr().out)["scenes"]
    assert row["with_truth"] <= row["default"]
    assert row["with_truth"] <= row["without_truth"] + 0.5
    assert row["range"]["first"] + row["range"]["count"] > row["highest_truth"]


def test_what_a_nearer_surface_hides_is_not_scored() -> None:
    # A floor at 4 px with a box at 12 px over columns 100 to 139: it hides the 8 columns of floor left of it.
    random = np.random.default_rng(2)
    texture = random.integers(0, 256, (60, 260), np.uint8)
    left, right = texture[:, :240].copy(), np.zeros((60, 240), np.uint8)
    right[:, :236] = left[:, 4:]
    right[:, 88:128] = left[:, 100:140]
    right[:, 128:136] = random.integers(0, 256, (60, 8), np.uint8)
    _, seen = reference_of(left, right, DisparityRange(0, 32, 4, 12), 1)
    hidden = np.flatnonzero(~seen[20:40].mean(axis=0).round().astype(bool))
    assert set(range(93, 99)) <= set(hidden)
    assert set(hidden) <= set(range(12)) | set(range(88, 104))
