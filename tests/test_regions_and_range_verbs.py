"""`epiline regions`, `measure`, `fit-range` and the rig part of `info`, from the command line."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.cli import main

FOCAL_PX, BASELINE_M = 200.0, 0.1


def output(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main([str(a) for a in arguments]) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def failure(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main([str(a) for a in arguments]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    return err.strip().splitlines()[-1]


@pytest.fixture
def walls(tmp_path: Path) -> Path:
    """Aligned pairs of a textured wall at 24, 20, 16, 12, 10 and 8 px of disparity."""
    rng = np.random.default_rng(5)
    texture = cv2.GaussianBlur(rng.integers(0, 256, (120, 240)).astype(np.uint8), (0, 0), 1.0)
    texture = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX)
    for number, disparity in enumerate((24, 20, 16, 12, 10, 8)):
        cv2.imwrite(str(tmp_path / f"{number}_left.png"), texture[:, :160])
        cv2.imwrite(str(tmp_path / f"{number}_right.png"), texture[:, disparity : 160 + disparity])
    return tmp_path


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    camera = ep.CameraModel([[200.0, 0, 80], [0, 200.0, 60], [0, 0, 1]], [0, 0, 0, 0, 0], width=160, height=120)
    path = tmp_path / "rig.yaml"
    ep.StereoCalibration(camera, camera, np.eye(3), [-BASELINE_M, 0, 0]).save(path)
    return path


def disparities_of(table: Path) -> list[tuple[float, float]]:
    with table.open() as file:
        rows = list(csv.reader(file))
    assert rows[0][:2] == ["disparity_px", "distance_m"]
    return [(float(row[0]), float(row[1])) for row in rows[1:]]


def test_measured_pairs_are_what_fit_range_fits(
    walls: Path, rig: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    table = walls / "pairs.csv"
    shifts = [24, 20, 16, 12, 10, 8]
    typed = [f"{FOCAL_PX * BASELINE_M / shift:.4f}" for shift in shifts]
    monkeypatch.setattr("sys.stdin", io.StringIO("\n".join(typed) + "\n"))
    common = ("measure", walls, "--rig", rig, "--region", "60,40,50x40", "--disparities", 40, "-o", table)
    facts = json.loads(output(capsys, *common, "--json"))
    assert (facts["pairs"], facts["new"]) == (6, 6)
    pairs = disparities_of(table)
    np.testing.assert_allclose([x for x, _ in pairs], shifts, atol=0.15)
    fit = json.loads(output(capsys, "fit-range", table, "--rig", rig, "--at", 15, 60, "--json"))
    assert fit["rmse_m"] < 0.02
    # Triangulation by the true rig has nothing left but the noise of matching.
    assert fit["triangulation"]["rmse_m"] < 0.02
    inside, outside = fit["predictions"]
    assert inside["distance_m"] == pytest.approx(20 / 15, rel=0.02)
    assert inside["low_m"] < inside["distance_m"] < inside["high_m"]
    assert (inside["inside_span"], outside["inside_span"]) == (True, False)
    # An empty line skips, q ends; what was there stays.
    monkeypatch.setattr("sys.stdin", io.StringIO("\n1.5m\nq\n9\n"))
    facts = json.loads(output(capsys, *common, "--append", "--json"))
    assert (facts["pairs"], facts["new"]) == (7, 1)
    assert disparities_of(table)[-1] == (pytest.approx(20, abs=0.15), 1.5)


def test_measure_says_what_is_wrong(
    walls: Path, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    table = tmp_path / "t.csv"
    common = ("measure", walls, "--rig", rig, "-o", table, "--disparities", 40)
    assert "expected X,Y,WIDTHxHEIGHT" in failure(capsys, *common, "--region", "60,40,50")
    for answer in ("near", "-1", "inf", "nan"):
        monkeypatch.setattr("sys.stdin", io.StringIO(f"{answer}\n"))
        assert f"'{answer}' is not a distance" in failure(capsys, *common, "--region", "60,40,50x40")
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert "no distance was given" in failure(capsys, *common, "--region", "60,40,50x40")
    assert not table.exists()
    table.write_text("a,b\n1,2\n")
    assert "is no table of epiline measure" in failure(capsys, *common, "--region", "60,40,50x40", "--append")
    sets = tmp_path / "r.toml"
    sets.write_text("[[regions]]\nname = 'target'\nx = 1\ny = 1\nwidth = 20\nheight = 20\n")
    assert "no region 'other'; there are target" in failure(capsys, *common, "--regions", sets, "--region", "other")


def test_regions_of_a_pair_as_table_and_pictures(
    walls: Path, rig: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = tmp_path / "r.toml"
    sets.write_text(
        "camera = { height_m = 0.5 }\n[regions]\npaper = 'paper'\n[[regions.own]]\nname = 'box'\n"
        "shares = [0.25, 0.25, 0.5, 0.25]\n[[regions.own]]\nname = 'ahead'\nheight_m = [0.3, 0.8]\nrange_m = [0.5, 3]\n"
    )
    pair = (walls / "2_left.png", walls / "2_right.png")
    common = ("regions", *pair, "--rig", rig, "--disparities", 40)
    folder = tmp_path / "pictures"
    folder.mkdir()
    facts = json.loads(output(capsys, *common, "--regions", f"{sets}:own", "--profiles", folder, "--json"))
    box, ahead = facts["regions"]
    assert box["box"] == [40, 30, 80, 30]
    for region in (box, ahead):
        assert region["range_m"] == pytest.approx(20 / 16, rel=0.03)
        assert 0 < region["sigma_m"] < 0.1
        assert len(region["columns"]["spread_px"]) == region["box"][2]
    assert sorted(p.name for p in folder.iterdir()) == ["ahead-range.svg", "ahead.svg", "box-range.svg", "box.svg"]
    text = output(capsys, *common)
    assert "band_20" in text
    assert "±" in text
    assert "several sets" in failure(capsys, *common, "--regions", sets)
    assert "does not exist" in failure(capsys, *common, "--profiles", tmp_path / "none")


def test_a_table_with_a_slip_is_fitted_without_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    x = np.linspace(4, 40, 16)
    y = 20 / x + np.random.default_rng(1).normal(0, 0.005, 16)
    y[7] *= 10
    table = tmp_path / "t.csv"
    np.savetxt(table, np.stack([x, y], axis=1), delimiter=",")
    plain = json.loads(output(capsys, "fit-range", table, "--json"))
    robust = json.loads(output(capsys, "fit-range", table, "--robust", "--json"))
    assert plain["rmse_m"] > 1
    assert robust["outliers"] == [7]
    # What two exponentials leave of 1/x.
    assert robust["rmse_m"] < 0.05
    assert len(robust["standard_errors"]) == 4
    page = tmp_path / "r.html"
    text = output(capsys, "fit-range", table, "--robust", "--report", page, "--at", 50)
    assert "left out as outliers: 1 of 16" in text
    assert "standard errors" in text
    assert page.stat().st_size > 1000


def test_a_prediction_outside_the_span_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    x = np.linspace(4, 40, 16)
    table = tmp_path / "t.csv"
    np.savetxt(table, np.stack([x, 20 / x], axis=1), delimiter=",")
    assert main(["fit-range", str(table), "--at", "20", "50"]) == 0
    warning = capsys.readouterr().err
    assert "50 px lies outside the fitted span, 4 to 40 px" in warning
    assert "20 px" not in warning


def test_info_prints_where_a_rig_measures(rig: Path, capsys: pytest.CaptureFixture[str]) -> None:
    facts = json.loads(output(capsys, "info", "--rig", rig, "--disparities", 41, "--json"))
    reach = facts["reach"]
    # Z = f b / d and sigma_Z / Z = Z sigma_d / (f b), by hand.
    assert reach["blind_below_m"] == pytest.approx(20 / 40, rel=0.02)
    assert reach["useful_depth_m"]["0.1"] == pytest.approx(0.1 * 20 / 0.25, rel=0.02)
    text = output(capsys, "info", "--rig", rig, "--disparity-sigma", 0.5)
    assert "blind zone" in text
    assert "sigma <= 10 %: up to 4.0" in text
