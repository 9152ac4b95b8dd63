"""The whole pipeline's contest: both sides do the same work on the same images. No test looks at a time."""

from __future__ import annotations

import dataclasses
import json

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.benchmarking import Plan, Row, Stage, measure_level, rows_as_csv
from epiline.benchmarking.contests import agreement
from epiline.benchmarking.pipeline import OpenCvChain, ours, pipeline_rows, raw_pair
from epiline.cli import main

WIDTH, HEIGHT, DISPARITIES = 320, 240, 48
TINY = Plan(sizes=((160, 120, 32),), repeats=3, budget_s=0.0, tables=False, pipeline=True)


def test_opencv_rectifies_as_we_do() -> None:
    """Else its matcher would be timed on other images; OpenCV's own stereoRectify is the judge of both."""
    pair = raw_pair(WIDTH, HEIGHT)
    chain = OpenCvChain(pair, DISPARITIES)
    aligned = ep.Rectifier(pair.calibration)(pair.left, pair.right)
    for image, valid, mine, maps in zip(
        (pair.left, pair.right),
        (aligned.left_valid, aligned.right_valid),
        (aligned.left, aligned.right),
        chain.maps,
        strict=True,
    ):
        theirs = cv2.remap(image, *maps, cv2.INTER_LINEAR)
        assert np.percentile(np.abs(theirs.astype(int) - mine)[valid], 99) <= 2


def test_both_sides_see_the_same_distances() -> None:
    pair = raw_pair(WIDTH, HEIGHT)
    mine, last = ours(pair, DISPARITIES)
    chain = OpenCvChain(pair, DISPARITIES)
    theirs = chain.contestant()
    for contestant in (mine, theirs):
        contestant.work()
    assert agreement(mine.answer(), theirs.answer()) > 0.98
    assert np.isfinite(theirs.answer()).mean() > 0.6
    assert sum(map(len, chain.clusters)) >= 4
    # Ours are told from the ground and need not stand in every band; the chain's clusters hold floor too.
    assert last[0].obstacles
    # A division by the wrong number would cluster nothing, or the whole image.
    both = np.isfinite(mine.answer()) & np.isfinite(theirs.answer())
    assert np.median(chain.depth_m[both] / last[0].range.depth_m[both]) == pytest.approx(1, abs=0.01)


def test_rows_and_stage_times_are_written_together() -> None:
    results = list(pipeline_rows("avx2", TINY))
    (row,) = (result for result in results if isinstance(result, Row))
    assert (row.width, row.height, row.disparities, row.threads, row.tests) == (160, 120, 32, 1, True)
    assert row.check == "agree"
    assert row.checked > 0.9
    stages = [result for result in results if isinstance(result, Stage)]
    assert {"rectify", "match", "range", "regions", "obstacles", "total"} <= {stage.stage for stage in stages}
    text = rows_as_csv("head", results)
    assert text.splitlines()[0] == "# head"
    assert ",".join(field.name for field in dataclasses.fields(Stage)) in text
    huge = dataclasses.replace(TINY, sizes=((1920, 1080, 256),))
    assert list(pipeline_rows("avx2", huge)) == []


def test_other_processes_send_stages_too(capsys: pytest.CaptureFixture[str]) -> None:
    level = ep.simd_level()
    kinds = {type(result) for result in measure_level(level, TINY, None)}
    assert kinds == {Row, Stage}
    arguments = ["bench", "--pipeline", "--levels", level, "--sizes", "160x120x32", "--repeats", "3"]
    assert main(arguments) == 0
    text = capsys.readouterr().out
    assert "OpenCV's chain" in text
    assert "our pipeline's stages" in text
    assert main([*arguments, "--json"]) == 0
    assert {"stage", "ms"} <= set(json.loads(capsys.readouterr().out)["results"][-1])
