"""`epiline evaluate`: its tables against an independent scoring, its pictures, and hostile folders."""

from __future__ import annotations

import csv
import io
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep
from epiline.cli import main
from epiline.evaluation import load_scenes
from epiline.evaluation.peers import BM, SGBM, SGBM_FILLED
from epiline.evaluation.perturbations import perturbations

CONES = ("--scenes", "2003/cones", "--threads", "1")


def output(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["evaluate", *map(str, arguments)]) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def failure(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main(["evaluate", *map(str, arguments)]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.strip().splitlines()
    return line


def padded_3way(left: NDArray[np.uint8], right: NDArray[np.uint8], count: int) -> NDArray[np.float32]:
    """The fair treatment of ../shared/tools/anchors_dense.py, written down a second time."""
    grey = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (left, right)]
    wide = [np.pad(image, ((0, 0), (count, 0)), mode="edge") for image in grey]
    matcher = cv2.StereoSGBM.create(0, count, 5, 200, 800, 1, 31, 10, 100, 2, cv2.STEREO_SGBM_MODE_SGBM_3WAY)
    raw = matcher.compute(*wide)[:, count:].astype(np.float32) / 16
    return np.where(raw < 0, np.float32(np.nan), raw)


def test_settings_are_scored_as_the_library_scores_them(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (data, *CONES, "--preset", "fast", "--param", "block_size=9", "fill=true", "--json")
    report = json.loads(output(capsys, *arguments))
    (row,) = report["scenes"]
    (scene,) = (s for s in load_scenes(data) if s.name == "middlebury2003/cones")
    disparity = ep.match(scene.left, scene.right, preset="fast", block_size=9, fill=True, num_disparities=64)
    error = np.abs(disparity.values - scene.truth)[scene.non_occluded]
    assert row["density"] == 100.0
    assert row["bad1_total"] == pytest.approx(100 * (error > 1).mean())
    assert row["avg"] == pytest.approx(error.mean(), rel=1e-4)
    assert report["means"][0]["bad1_total"] == row["bad1_total"]


def test_opencv_is_treated_as_the_anchors_treat_it(data: Path) -> None:
    (scene,) = (s for s in load_scenes(data) if s.name == "middlebury2003/cones")
    expected = padded_3way(scene.left, scene.right, 64)
    kept = SGBM(scene.left, scene.right, 64, 1)
    np.testing.assert_array_equal(kept, expected)
    filled = SGBM_FILLED(scene.left, scene.right, 64, 1)
    assert np.isfinite(filled).all()
    # Away from the median's and the filling's reach nothing changes by more than the median does.
    known = np.isfinite(expected)
    assert np.mean(np.abs(filled - expected)[known] <= 1) > 0.99
    assert 0.5 < np.isfinite(BM(scene.left, scene.right, 64, 1)).mean() < 1


def test_tables_with_opencv_and_both_halves(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = (data, "--scenes", "2001/venus", "2001/bull", "--preset", "fast", "--opencv", "--halves")
    text = output(capsys, *arguments)
    for expected in ("preset fast", "OpenCV SGBM 3WAY, padded, filled", "even half", "odd half", "all 2 scenes"):
        assert expected in text
    rows = list(csv.DictReader(io.StringIO(output(capsys, *arguments[:-1], "--csv"))))
    assert len(rows) == 2 * 5
    assert {row["scene"] for row in rows} == {"middlebury2001/venus", "middlebury2001/bull"}
    # The halves are the scenes themselves here.
    report = json.loads(output(capsys, *arguments[:-1], "--json"))
    means = {m["group"]: m["bad2_total"] for m in report["means"] if m["setting"] == "preset fast"}
    single = {r["scene"]: r["bad2_total"] for r in report["scenes"] if r["setting"] == "preset fast"}
    assert means["even half"] == single["middlebury2001/bull"]
    assert means["odd half"] == single["middlebury2001/venus"]
    assert means["all 2 scenes"] == pytest.approx(sum(single.values()) / 2)


def test_official_measures_of_a_download(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cones = data / "middlebury2003" / "cones"
    names = {"left.png": "im2.png", "right.png": "im6.png", "gt_left.png": "disp2.png", "gt_right.png": "disp6.png"}
    for source, target in names.items():
        shutil.copyfile(cones / source, tmp_path / target)
    text = output(capsys, tmp_path, "--preset", "fast", "--threads", 1)
    for expected in ("invalid", "bad0.5", "bad4", "A99", "non-occluded", ", all"):
        assert expected in text
    rows = json.loads(output(capsys, tmp_path, "--preset", "fast", "--threads", 1, "--json"))["scenes"]
    by_manifest = json.loads(output(capsys, data, *CONES, "--preset", "fast", "--json"))["scenes"][0]
    (seen,) = (row for row in rows if row["region"] == "non-occluded")
    assert seen["bad2"] == pytest.approx(by_manifest["bad2_total"])
    assert seen["invalid"] == pytest.approx(100 - by_manifest["density"])
    assert seen["rms"] == pytest.approx(by_manifest["rms"], rel=1e-4)


def test_pictures_show_what_was_scored(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new" / "pictures"
    output(capsys, data, *CONES, "--preset", "fast", "--opencv", "--pictures", folder)
    names = sorted(path.name for path in folder.iterdir())
    assert len([n for n in names if n.endswith("-disparity.png")]) == 5
    assert len([n for n in names if n.endswith("-error.png")]) == 5
    # Only our own maps have reasons, and nothing temporary is left.
    assert [n for n in names if n.endswith("-reasons.png")] == ["middlebury2003-cones-preset-fast-reasons.png"]
    assert len(names) == 11
    (scene,) = (s for s in load_scenes(data) if s.name == "middlebury2003/cones")
    reasons = cv2.imread(str(folder / "middlebury2003-cones-preset-fast-reasons.png"))
    validity = ep.match(scene.left, scene.right, preset="fast", num_disparities=64).validity
    np.testing.assert_array_equal((reasons == 0).all(axis=2), validity == 0)
    error = cv2.imread(str(folder / "middlebury2003-cones-preset-fast-error.png"))
    np.testing.assert_array_equal((error == 0).all(axis=2), ~np.isfinite(scene.truth))


def test_perturbations_do_what_they_say() -> None:
    random = np.random.default_rng(0)
    left, right = (cv2.GaussianBlur(random.integers(0, 200, (80, 100), np.uint8), (0, 0), 2) for _ in "lr")
    done = {name: perturb(left, right) for name, perturb in perturbations().items()}
    for name, (a, b) in done.items():
        assert a.dtype == b.dtype == np.uint8
        np.testing.assert_array_equal(a, left) if "noise" not in name else None
    np.testing.assert_array_equal(done["none"][1], right)
    np.testing.assert_allclose(done["gain 0.6"][1], 0.6 * right, atol=0.51)
    np.testing.assert_allclose(done["offset 20"][1], right + 20.0, atol=0.01)
    np.testing.assert_allclose(done["gamma 1.5"][1], 255 * (right / 255) ** 1.5, atol=0.51)
    vignette = done["vignette 40 %"][1] / np.maximum(right, 1)
    assert vignette[0, 0] == pytest.approx(0.6, abs=0.02)
    assert vignette[40, 50] == pytest.approx(1.0, abs=0.02)
    np.testing.assert_array_equal(done["shift 1 px"][1][1:], right[:-1])
    between = (right[:-1].astype(float) + right[1:]) / 2
    assert np.abs(done["shift 0.5 px"][1][1:] - between).mean() < 1.0
    for name, sigma in (("noise 3", 3), ("noise 8", 8)):
        for noisy, clean in zip(done[name], (left, right), strict=True):
            assert np.std(noisy.astype(float) - clean) == pytest.approx(sigma, rel=0.1)
        again = perturbations()[name](left, right)
        np.testing.assert_array_equal(again[1], done[name][1])
    assert done["blur 1 px"][1].std() < right.std()


def test_robustness_prints_both_and_their_ratio(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = json.loads(output(capsys, data, *CONES, "--robustness", "--preset", "fast", "--json"))
    assert report["columns"][1] == "OpenCV SGBM 3WAY, padded, filled"
    assert list(report["bad1"]) == list(perturbations())
    for mine, peer, ratio in report["bad1"].values():
        assert ratio == pytest.approx(mine / peer)
    plain = json.loads(output(capsys, data, *CONES, "--preset", "fast", "--param", "fill=true", "--json"))["scenes"][0]
    # The table is on grey images; the matcher makes colour grey itself.
    assert report["bad1"]["none"][0] == pytest.approx(plain["bad1_total"])
    assert report["bad1"]["noise 8"][0] > report["bad1"]["none"][0]
    assert "ratio" in output(capsys, data, *CONES, "--robustness", "--preset", "fast")


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        (["--preset", "fast", "--param", "block_size=4"], "block_size = 4"),
        (["--param", "windw=4"], "windw"),
        (["--method", "magic"], "magic"),
        (["--param", "fill=7"], "fill"),
    ],
)
def test_wrong_parameters_are_named_before_any_image_is_read(
    wrong: list[str], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert complaint in failure(capsys, tmp_path, *wrong)


@pytest.mark.parametrize("wrong", [["--param", "block_size"], ["--param", "=3"], ["--json", "--csv"]])
def test_wrong_usage(wrong: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["evaluate", ".", *wrong])
    assert caught.value.code == 2


def test_hostile_folders(data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "no scene with ground truth" in failure(capsys, tmp_path)
    assert "no scene's name contains moon" in failure(capsys, data, "--scenes", "moon")
    cones = data / "middlebury2003" / "cones"
    for source, target in {"left.png": "im2.png", "gt_left.png": "disp2.png"}.items():
        shutil.copyfile(cones / source, tmp_path / target)
    assert "im6.png" in failure(capsys, tmp_path)
    (tmp_path / "im6.png").write_bytes((cones / "right.png").read_bytes()[:9999])
    assert "im6.png: truncated PNG" in failure(capsys, tmp_path)


def test_a_single_file_of_another_size_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    np.save(tmp_path / "d.npy", np.ones((4, 5), np.float32))
    np.save(tmp_path / "t.npy", np.ones((5, 4), np.float32))
    line = failure(capsys, tmp_path / "d.npy", "--truth", tmp_path / "t.npy")
    assert "d.npy: 5x4 px" in line
    assert "t.npy: 4x5 px" in line


def test_sparsification_is_the_librarys(data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from epiline.evaluation.sparsification import sparsification

    arguments = (data, "--scenes", "2003/cones", "2001/venus", "--preset", "fast", "--sparsification")
    rows = {row["scene"]: row for row in json.loads(output(capsys, *arguments, "--json"))["curves"]}
    (scene,) = (s for s in load_scenes(data) if s.name == "middlebury2003/cones")
    disparity = ep.match(scene.left, scene.right, preset="fast", num_disparities=64)
    curve = sparsification(disparity, disparity.confidence, scene.truth, scene.non_occluded)
    assert rows[scene.name]["area"] == pytest.approx(curve.area)
    assert rows[scene.name]["ratio"] == pytest.approx(curve.ratio)
    assert rows["even half"]["ratio"] == rows["middlebury2001/venus"]["ratio"]
    assert rows["all 2 scenes"]["area"] == pytest.approx((curve.area + rows["even half"]["area"]) / 2)
    assert "ratio" in output(capsys, *arguments)
