"""The command line: what it prints, where it ends, and one clear line for everything hostile."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from epiline.cli import main


def failure(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line that a failing command leaves on standard error."""
    assert main([str(a) for a in arguments]) == 1
    out, err = capsys.readouterr()
    assert out == ""
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    return lines[0]


def output(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert main([str(a) for a in arguments]) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def test_wrong_usage_is_status_2() -> None:
    for arguments in (["nothing"], [], ["match", "one.png"], ["run", ".", "--rig", "r", "--window", "x"]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2


def test_every_verb_has_help(capsys: pytest.CaptureFixture[str]) -> None:
    verbs = "demo calibrate rectify match run regions measure fit-range evaluate bench tune info"
    for verb in verbs.split():
        with pytest.raises(SystemExit) as caught:
            main([verb, "--help"])
        assert caught.value.code == 0
        assert verb in capsys.readouterr().out


def test_info_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    facts = json.loads(output(capsys, "info", "--json"))
    assert facts["cores"] >= 1
    assert facts["simd_level"] in {"scalar", "avx2", "avx512", "neon"}


def test_calibrate_writes_a_rig_and_a_report(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, page = tmp_path / "rig.yaml", tmp_path / "report.html"
    text = output(
        capsys, "calibrate", rendered / "boards", "--board", "9x6", "--square", "40mm", "-o", rig, "--report", page
    )
    for expected in ("8 of 8 pairs", "baseline", "held-out epipolar error", "verdict:"):
        assert expected in text
    assert page.read_text().lower().startswith("<!doctype html>")
    # A globbed list of files means the same as the folder.
    files = sorted((rendered / "boards").iterdir())
    again = json.loads(output(capsys, "calibrate", *files, "--board", "9x6", "--square", "4cm", "--json"))
    assert len(again["view_rms_px"]) == 8
    import epiline as ep

    assert ep.StereoCalibration.load(rig).baseline_m == pytest.approx(again["baseline_m"], rel=1e-12)


def test_photographs_without_a_partner_inform_their_camera(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    boards = sorted((rendered / "boards").iterdir())
    left, right = ([p for p in boards if side in p.name] for side in ("left", "right"))
    assert len(left) == len(right) == 8
    options = ("--board", "9x6", "--square", "40mm")
    kept = [*left[:7], *right[:6], right[7]]
    for source in (kept, ["--left", *left[:7], "--right", *right[:6], right[7]]):
        # With seven on either side, --left and --right are pairs in their order: drop one more.
        files = [path for path in source if path != right[5]]
        text = output(capsys, "calibrate", *files, *options)
        assert "5 of 8 pairs" in text
        assert "3 views of one camera alone take part" in text
        assert f"{left[6].name}: no pair, informs the left camera alone" in text
        assert f"{right[7].name}: no pair, informs the right camera alone" in text
        found = json.loads(output(capsys, "calibrate", *files, *options, "--json"))
        assert len(found["view_rms_px"]) == 8
        assert [view["alone"] for view in found["views"]] == [[]] * 5 + [["left"]] * 2 + [["right"]]
    said = failure(capsys, "calibrate", "--left", *left[:2], "--right", right[4], *options)
    assert "no two names belong together" in said


def test_run_writes_a_json_line_per_frame(rendered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = output(capsys, "run", rendered / "drive", "--rig", rendered / "rig.yaml", "--jsonl", "-")
    lines = [json.loads(line) for line in text.splitlines()]
    assert [line["seq"] for line in lines] == [0, 1]
    for line in lines:
        assert len(line["regions"]) == 4
        assert abs(line["alignment"]["median_px"]) < 0.5
        assert all(o["range_m"] > 0 and o["sigma_m"] > 0 for o in line["obstacles"])
        assert set(line["scan"]["seen"]) <= set("o.?")
        assert len(line["scan"]["free_to_m"]) == len(line["scan"]["seen"])
        assert "camera_height_m" in line["ground"] or "reason" in line["ground"]
    # Two frames confirm nothing, but what was seen in both has one id.
    first, second = ({track["id"] for track in line["tracks"]} for line in lines)
    assert not any(track["confirmed"] for line in lines for track in line["tracks"])
    assert bool(lines[0]["obstacles"]) == bool(first & second)


def test_run_draws_pictures_and_a_video(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "run.toml"
    config.write_text("[mounting]\nheight_m = 0.5\n[scan]\nmax_range_m = 6\n[tracks]\nenabled = false\n")
    pictures, video = tmp_path / "pictures", tmp_path / "run.avi"
    run = ("run", rendered / "drive", "--rig", rendered / "rig.yaml", "--config", config)
    text = output(capsys, *run, "--pictures", pictures, "--video", video, "--fps", 5)
    assert f"wrote {video}" in text
    assert len(list(pictures.iterdir())) == 2
    assert video.stat().st_size > 0
    (line, _) = map(json.loads, output(capsys, *run, "--json").splitlines())
    assert line["tracks"] == []
    assert line["scan"]["max_range_m"] == 6


def test_run_obeys_its_configuration(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = tmp_path / "run.toml"
    config.write_text(
        "[matcher]\nblock_size = 7\n[pipeline]\nmax_range_m = 3\n"
        '[[regions]]\nname = "ahead"\nx = 100\ny = 90\nwidth = 120\nheight = 40\n'
    )
    text = output(
        capsys, "run", rendered / "drive", "--rig", rendered / "rig.yaml", "--config", config, "--json", "--limit", 1
    )
    (line,) = map(json.loads, text.splitlines())
    assert [region["name"] for region in line["regions"]] == ["ahead"]
    assert all(o["range_m"] < 3.2 for o in line["obstacles"])


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("[matcher]\nwindow = 9", "matcher.window is unknown"),
        ("[matcher]\nblock_size = 8", "block_size = 8"),
        ("[pipeline]\nequalize = 1", "pipeline.equalize = 1 is not a bool"),
        ("[pipelin]", "unknown table 'pipelin'"),
        ("pipeline = 3", "pipeline is not a table"),
        ("[mounting]\nx_m = 1", "mounting.height_m is missing"),
        ("[mounting]\nheight_m = -1", "mounting: robot_from_camera"),
        ("[mounting]\nheight_m = true", "mounting.height_m = True is not a float"),
        ("[ground]\nheight_m = 1", "ground.height_m is unknown"),
        ("[scan]\nstep_m = 0", "scan: step_m = 0 m"),
        ("[scan]\nmin_support = 1.5", "scan.min_support = 1.5 is not a int"),
        ("[tracks]\ngate_probability = 2", "tracks: gate_probability = 2"),
        ("[[regions]]\nname = 'a'", "region 1 'a': must have exactly one of"),
        ("[[regions]]\nx = 1", "region 1: must be a table with a name"),
        ("[regions]\na = 'paper'\nb = 'paper'", "several sets of regions; choose one of a, b"),
        ("[pipeline]\nregions = 'c'\n[regions]\na = 'paper'", "no set of regions 'c'"),
        ("[pipeline]\nregions = 3", "pipeline.regions = 3 is not the name"),
        ("[[regions]]\nname = 'a'\nheight_m = [0, 1]\nrange_m = [1, 2]", "region 1 'a': needs a [camera]"),
        ("matcher =", "run.toml"),
    ],
)
def test_hostile_configurations(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, complaint: str
) -> None:
    config = tmp_path / "run.toml"
    config.write_text(text)
    line = failure(capsys, "run", rendered / "drive", "--rig", rendered / "rig.yaml", "--config", config)
    assert complaint in line
    assert "run.toml" in line


@pytest.mark.parametrize("suffix", ["pfm", "png", "npy", "ply"])
def test_match_writes_each_format(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], suffix: str
) -> None:
    drive = rendered / "drive"
    out = tmp_path / f"d.{suffix}"
    output(capsys, "match", drive / "left00.png", drive / "right00.png", "--rig", rendered / "rig.yaml", "-o", out)
    assert out.stat().st_size > 1000


def test_match_by_preset_and_filled(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = rendered / "drive"
    pair = (drive / "left00.png", drive / "right00.png", "--rig", rendered / "rig.yaml", "-o", tmp_path / "d.pfm")
    kept = json.loads(output(capsys, "match", *pair, "--preset", "accurate", "--json"))
    filled = json.loads(output(capsys, "match", *pair, "--preset", "accurate", "--fill", "--json"))
    assert kept["parameters"]["method"] == "sgm"
    assert kept["density"] < 1.0
    assert filled["density"] == 1.0


def test_rectify_reports_and_writes(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = output(
        capsys, "rectify", rendered / "drive", "--rig", rendered / "rig.yaml", "-o", tmp_path / "aligned", "--json"
    )
    for pair in json.loads(text)["pairs"]:
        assert abs(pair["after_px"]) < 0.3
    assert len(list((tmp_path / "aligned").iterdir())) == 8


def test_fit_range_from_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "pairs.csv"
    x = np.arange(10, 60, 5)
    z = 6 * np.exp(-0.1 * x) + 2 * np.exp(-0.01 * x)
    table.write_text("disparity,distance\n" + "\n".join(f"{a},{b}" for a, b in zip(x, z, strict=True)))
    figures = json.loads(output(capsys, "fit-range", table, "--json"))
    assert figures["rmse_m"] < 1e-6
    assert max(figures["b"], figures["d"]) == pytest.approx(-0.01, rel=1e-3)


# ---- hostile input: the eight of the first issue, and then some ---------------------------------


def test_sizes_that_differ(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    small = tmp_path / "small.png"
    cv2.imwrite(str(small), np.zeros((100, 130), np.uint8))
    line = failure(capsys, "match", rendered / "drive" / "left00.png", small, "-o", tmp_path / "d.png")
    assert "320x240" in line
    assert "130x100" in line
    assert not (tmp_path / "d.png").exists()


def test_empty_folder(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert str(tmp_path) in failure(capsys, "run", tmp_path, "--rig", rendered / "rig.yaml")
    assert str(tmp_path) in failure(capsys, "calibrate", tmp_path, "--board", "9x6", "--square", "25mm")


def test_truncated_png(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left = tmp_path / "left.png"
    left.write_bytes((rendered / "drive" / "left00.png").read_bytes()[:5000])
    line = failure(capsys, "match", left, rendered / "drive" / "right00.png", "-o", tmp_path / "d.png")
    assert "left.png: truncated PNG" in line


def test_rig_with_a_missing_or_nan_entry(rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (rendered / "rig.yaml").read_text()
    (line,) = (line for line in text.splitlines() if "fx_px" in line and line in text.split("right:")[0])
    for replacement in ("", line.split(":")[0] + ": .nan\n"):
        bad = tmp_path / "bad.yaml"
        bad.write_text(text.replace(line + "\n", replacement, 1))
        said = failure(capsys, "run", rendered / "drive", "--rig", bad)
        assert "bad.yaml" in said
        assert "fx_px" in said


def test_board_that_is_nowhere(rendered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = failure(capsys, "calibrate", rendered / "drive", "--board", "9x6", "--square", "25mm")
    assert "no 9x6 board found in any of 2 pairs" in line


def test_disparity_range_wider_than_the_image(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive = rendered / "drive"
    line = failure(
        capsys, "match", drive / "left00.png", drive / "right00.png", "-o", tmp_path / "d.png", "--disparities", 400
    )
    assert "400" in line
    assert "320" in line


@pytest.mark.parametrize("blocker", ["file", "missing"])
def test_output_that_cannot_be_written(
    rendered: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], blocker: str
) -> None:
    # Root may write anywhere, so the obstacle is a file where a folder should be, or no folder at all.
    folder = tmp_path / "out"
    if blocker == "file":
        folder.write_text("in the way")
    drive = rendered / "drive"
    line = failure(capsys, "match", drive / "left00.png", drive / "right00.png", "-o", folder / "d.pfm")
    assert "out/d.pfm" in line
    line = failure(capsys, "run", drive, "--rig", rendered / "rig.yaml", "--report", folder / "r.html")
    assert "out" in line


def test_swapped_cameras_are_recognised(rendered: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left, right = (sorted((rendered / "boards").glob(f"{side}*")) for side in ("left", "right"))
    line = failure(capsys, "calibrate", "--left", *right, "--right", *left, "--board", "9x6", "--square", "4cm")
    assert "swapped" in line


def test_a_reader_that_goes_away_is_no_traceback(rendered: Path) -> None:
    command = [sys.executable, "-m", "epiline", "run", rendered / "drive", "--rig", rendered / "rig.yaml", "--json"]
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writer)
    assert "Traceback" not in done.stderr
    assert done.returncode == 1
