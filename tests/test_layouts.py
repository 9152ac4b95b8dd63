"""Data sets as downloaded: small trees of real files in each layout, scored a second time here in plain NumPy."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from epiline.evaluation import load_scenes
from epiline.evaluation.interpolation import interpolate_background
from epiline.evaluation.measures import Measure, mean, score
from epiline.evaluation.pictures import NO_ANSWER_BGR, error_picture
from epiline.sinks.disparity import pfm_bytes

Map = NDArray[np.float32]
Tree = Callable[[Path, Path], Path]


def stored(path: Path, scale: float) -> Map:
    """Truth by OpenCV's reader: nothing of ours."""
    levels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    levels = levels if levels.ndim == 2 else levels[..., 0]
    return np.where(levels == 0, np.nan, levels / scale).astype(np.float32)


def answers(truth: Map) -> Map:
    """A made-up answer with errors of every size and holes."""
    random = np.random.default_rng(1)
    error = random.normal(0, 1, truth.shape) * random.choice([0.2, 1, 3, 12], truth.shape)
    values = np.clip(np.nan_to_num(truth, nan=9.0) + error, 0, None).astype(np.float32)
    values[random.random(truth.shape) < 0.15] = np.nan
    return values


def copy(pairs: dict[Path, Path]) -> None:
    for source, target in pairs.items():
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)


def as_png(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(target), cv2.imread(str(source), cv2.IMREAD_UNCHANGED))


def middlebury2001(data: Path, root: Path) -> Path:
    venus = data / "middlebury2001" / "venus"
    names = {"left.ppm": "im2.ppm", "right.ppm": "im6.ppm", "gt_left.pgm": "disp2.pgm", "gt_right.pgm": "disp6.pgm"}
    copy({venus / a: root / "venus" / b for a, b in names.items()})
    tsukuba = data / "middlebury2001" / "tsukuba"
    for a, b in (("left", "scene1.row3.col3"), ("right", "scene1.row3.col4")):
        copy({tsukuba / f"{a}.ppm": root / "tsukuba" / f"{b}.ppm"})
    copy({tsukuba / "gt_left.pgm": root / "tsukuba" / "truedisp.row3.col3.pgm"})
    return root


def middlebury2003(data: Path, root: Path) -> Path:
    cones = data / "middlebury2003" / "cones"
    names = {"left.png": "im2.png", "right.png": "im6.png", "gt_left.png": "disp2.png", "gt_right.png": "disp6.png"}
    copy({cones / a: root / "cones" / b for a, b in names.items()})
    return root


def middlebury2005(data: Path, root: Path) -> Path:
    names = {"left.png": "view1.png", "right.png": "view5.png", "gt_left.png": "disp1.png", "gt_right.png": "disp5.png"}
    for family, name in (("middlebury2005", "Art"), ("middlebury2005_b", "Art"), ("middlebury2006", "Cloth3")):
        copy({data / family / name / a: root / family / name / b for a, b in names.items()})
    return root


def middlebury2014(data: Path, root: Path) -> Path:
    source, folder = data / "middlebury2014" / "Motorcycle", root / "trainingQ" / "Motorcycle"
    for a, b in (("left.png", "im0.png"), ("right.png", "im1.png")):
        as_png(source / a, folder / b)
    truth = np.load(source / "gt_left.npz")["arr_0"].astype(np.float32)
    (folder / "disp0GT.pfm").write_bytes(pfm_bytes(truth))
    mask = np.where(np.isfinite(truth), 255, 0).astype(np.uint8)
    mask[:, :100][mask[:, :100] > 0] = 128
    cv2.imwrite(str(folder / "mask0nocc.png"), mask)
    (folder / "calib.txt").write_text("cam0=[994.978 0 311.193; 0 994.978 254.877; 0 0 1]\nndisp=70\nisint=0\n")
    return root


def eth3d(data: Path, root: Path) -> Path:
    source = data / "eth3d" / "playground"
    images, truth = root / "two_view_training" / "playground_1l", root / "two_view_training_gt" / "playground_1l"
    for a, b in (("left.png", "im0.png"), ("right.png", "im1.png")):
        as_png(source / a, images / b)
    copy({source / "calib.txt": images / "calib.txt", source / "gt_left.pfm": truth / "disp0GT.pfm"})
    mask = np.full(cv2.imread(str(source / "left.png"), 0).shape, 255, np.uint8)
    mask[:60] = 0
    cv2.imwrite(str(truth / "mask0nocc.png"), mask)
    return root


def kitti(data: Path, root: Path, names: tuple[str, str, str, str], *, objects: bool) -> Path:
    left, right, occluded, seen = names
    for frame in ("000002_10", "000004_10"):
        source = data / "kitti2015" / frame
        for a, b in (("left", left), ("right", right), ("gt_noc_left", occluded)):
            as_png(source / f"{a}.png", root / "training" / b / f"{frame}.png")
        levels = cv2.imread(str(source / "gt_noc_left.png"), cv2.IMREAD_UNCHANGED)
        levels[:, :300] = 0
        (root / "training" / seen).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(root / "training" / seen / f"{frame}.png"), levels)
        if objects:
            moving = np.zeros(levels.shape, np.uint8)
            moving[200:, 400:700] = 3
            (root / "training" / "obj_map").mkdir(exist_ok=True)
            cv2.imwrite(str(root / "training" / "obj_map" / f"{frame}.png"), moving)
    return root


def kitti2015(data: Path, root: Path) -> Path:
    return kitti(data, root, ("image_2", "image_3", "disp_occ_0", "disp_noc_0"), objects=True)


def kitti2012(data: Path, root: Path) -> Path:
    return kitti(data, root, ("colored_0", "colored_1", "disp_occ", "disp_noc"), objects=False)


@pytest.mark.parametrize(
    ("tree", "expected"),
    [
        (middlebury2001, {"middlebury2001/tsukuba": (16, 16), "middlebury2001/venus": (8, 32)}),
        (middlebury2003, {"middlebury2003/cones": (4, 64)}),
        (
            middlebury2005,
            {
                "middlebury2005-2006/middlebury2005/Art": (3, 96),
                "middlebury2005-2006/middlebury2005_b/Art": (2, 128),
                "middlebury2005-2006/middlebury2006/Cloth3": (2, 128),
            },
        ),
        (middlebury2014, {"middlebury2014-2021/trainingQ/Motorcycle": (1, 80)}),
        (eth3d, {"eth3d/two_view_training/playground_1l": (1, 64)}),
        (kitti2012, {"kitti2012/000002_10": (256, 192), "kitti2012/000004_10": (256, 192)}),
        (kitti2015, {"kitti2015/000002_10": (256, 192), "kitti2015/000004_10": (256, 192)}),
    ],
)
def test_a_download_is_recognised(tree: Tree, expected: dict[str, tuple[int, int]], data: Path, tmp_path: Path) -> None:
    scenes = list(load_scenes(tree(data, tmp_path)))
    assert {s.name: (s.truth_file.scale, s.num_disparities) for s in scenes} == expected
    for scene in scenes:
        assert scene.left.shape == scene.right.shape
        assert scene.truth.shape == scene.non_occluded.shape == scene.left.shape[:2]
        assert 0 < scene.non_occluded.sum() < scene.non_occluded.size
        assert np.nanmax(scene.truth) < scene.num_disparities


def test_the_manifest_and_the_download_are_the_same_scenes(data: Path, tmp_path: Path) -> None:
    (mine,) = load_scenes(middlebury2003(data, tmp_path))
    (theirs,) = (s for s in load_scenes(data) if s.name == "middlebury2003/cones")
    np.testing.assert_array_equal(mine.truth, theirs.truth)
    np.testing.assert_array_equal(mine.non_occluded, theirs.non_occluded)
    assert mine.num_disparities == theirs.num_disparities


def test_middlebury_measures_equal_a_second_scoring(data: Path, tmp_path: Path) -> None:
    (scene,) = load_scenes(middlebury2014(data, tmp_path))
    truth = np.load(data / "middlebury2014" / "Motorcycle" / "gt_left.npz")["arr_0"].astype(np.float64)
    truth[~np.isfinite(truth)] = np.nan
    values = answers(truth.astype(np.float32))
    seen = np.isfinite(truth)
    seen[:, :100] = False
    for region, mask in (("all", np.isfinite(truth)), ("non-occluded", seen)):
        found = {name: m.value for name, m in score(values, scene)[region].items()}
        error = np.sort(np.abs(values.astype(float) - truth)[mask])  # NaN goes last
        count = error.size
        known = error[~np.isnan(error)]
        assert found["invalid"] == pytest.approx(100 * (count - known.size) / count)
        for name, limit in (("bad0.5", 0.5), ("bad1", 1), ("bad2", 2), ("bad4", 4)):
            assert found[name] == pytest.approx(100 * (count - np.count_nonzero(known <= limit)) / count, abs=1e-4)
        assert found["avgerr"] == pytest.approx(known.sum() / known.size, rel=1e-5)
        assert found["rms"] ** 2 == pytest.approx((known**2).sum() / known.size, rel=1e-5)
        for name, share in (("A50", 0.5), ("A90", 0.9), ("A95", 0.95), ("A99", 0.99)):
            at = int(share * known.size)
            assert known[at - 2] - 1e-4 <= found[name] <= known[at + 2] + 1e-4


def background_filled(values: Map) -> Map:
    """KITTI's interpolateBackground, pixel by pixel as its C++ reads."""
    out = values.copy()
    height, width = out.shape
    for v in range(height):
        count = 0
        for u in range(width):
            if np.isfinite(out[v, u]):
                if count and u - count > 0:
                    out[v, u - count : u] = min(out[v, u - count - 1], out[v, u])
                count = 0
            else:
                count += 1
        known = np.flatnonzero(np.isfinite(out[v]))
        if known.size:
            out[v, : known[0]] = out[v, known[0]]
            out[v, known[-1] + 1 :] = out[v, known[-1]]
    rows = np.flatnonzero(np.isfinite(out).any(axis=1))
    out[: rows[0]] = out[rows[0]]
    out[rows[-1] + 1 :] = out[rows[-1]]
    return out


def test_background_interpolation_is_the_development_kits() -> None:
    random = np.random.default_rng(5)
    values = random.uniform(1, 60, (40, 50)).astype(np.float32)
    values[random.random(values.shape) < 0.5] = np.nan
    values[:4] = values[-3:] = np.nan
    np.testing.assert_array_equal(interpolate_background(values), background_filled(values))
    nothing = np.full((3, 4), np.nan, np.float32)
    assert np.isnan(interpolate_background(nothing)).all()


def test_kitti_measures_equal_a_second_scoring(data: Path, tmp_path: Path) -> None:
    for tree in (kitti2012, kitti2015):
        scene = next(iter(load_scenes(tree(data, tmp_path / tree.__name__))))
        truth = stored(data / "kitti2015" / "000002_10" / "gt_noc_left.png", 256)
        values = answers(truth)
        dense = background_filled(values)
        columns = np.arange(truth.shape[1])[None, :]
        moving = np.zeros(truth.shape, bool)
        moving[200:, 400:700] = True
        found = score(values, scene)
        for region, mask in (
            ("all", np.isfinite(truth)),
            ("non-occluded", np.isfinite(truth) & (columns >= 300)),
        ):
            error = np.abs(dense - truth)
            wrong = (error > 3) & (error / truth > 0.05)
            figures = {name: m.value for name, m in found[region].items()}
            assert figures["density"] == pytest.approx(100 * np.isfinite(values[mask]).mean())
            if tree is kitti2012:
                assert figures["out3"] == pytest.approx(100 * (error[mask] > 3).mean())
                assert figures["avg"] == pytest.approx(error[mask].mean(), rel=1e-4)
            else:
                for name, part in (("D1-all", mask), ("D1-fg", mask & moving), ("D1-bg", mask & ~moving)):
                    assert figures[name] == pytest.approx(100 * wrong[part].mean())
                    assert found[region][name].weight == part.sum()


def test_means_are_weighted_where_the_benchmark_pools_pixels() -> None:
    scenes = [{"D1": Measure(10.0, 100)}, {"D1": Measure(20.0, 300)}, {"D1": Measure(float("nan"), 0)}]
    assert mean(scenes) == {"D1": 17.5}
    assert np.isnan(mean([{"D1": Measure(float("nan"))}])["D1"])


def test_error_colours_step_with_the_logarithm() -> None:
    truth = np.full((1, 6), 100.0, np.float32)
    truth[0, 5] = np.nan
    # Wrong is min(error / 3, error / 5 % of the truth) >= 1: 5 px here.
    values = truth + np.array([[0.1, 4.9, 5.1, np.nan, 200.0, 0.0]], np.float32)
    seen = np.array([[True, True, True, True, False, False]])
    picture = error_picture(values, truth, seen)[0].tolist()
    assert picture[0] == [149, 54, 49]
    assert picture[1] == [248, 243, 224]
    assert picture[2] == [144, 224, 254]
    assert picture[3] == list(NO_ANSWER_BGR)
    assert picture[4] == [38 // 2, 0, 165 // 2]
    assert picture[5] == [0, 0, 0]


# ---- hostile folders ----------------------------------------------------------------------------


def test_a_folder_without_scenes_names_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no scene with ground truth.*Middlebury.*KITTI.*ETH3D"):
        list(load_scenes(tmp_path))
    with pytest.raises(FileNotFoundError, match="nowhere"):
        list(load_scenes(tmp_path / "nowhere"))


def test_a_missing_right_image_is_named(data: Path, tmp_path: Path) -> None:
    root = kitti2015(data, tmp_path)
    (root / "training" / "image_3" / "000002_10.png").unlink()
    scene = next(iter(load_scenes(root)))
    with pytest.raises(OSError, match=r"image_3/000002_10\.png"):
        _ = scene.right


def test_truncated_truth_is_named(data: Path, tmp_path: Path) -> None:
    (scene,) = load_scenes(middlebury2014(data, tmp_path))
    path = scene.truth_file.path
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(OSError, match=r"disp0GT\.pfm: truncated PFM"):
        _ = scene.truth


@pytest.mark.parametrize("which", ["im6.png", "disp2.png", "disp6.png"])
def test_files_of_another_size_are_named(which: str, data: Path, tmp_path: Path) -> None:
    root = middlebury2003(data, tmp_path)
    cv2.imwrite(str(root / "cones" / which), np.full((50, 60), 80, np.uint8))
    (scene,) = load_scenes(root)
    with pytest.raises(ValueError, match=rf"{which}: 60x50 px, but im2\.png has 450x375 px"):
        _ = scene.right, scene.non_occluded


@pytest.mark.parametrize("name", [("view1", "disp1"), ("im2", "disp2")])
def test_a_size_of_unknown_scale_is_refused(name: tuple[str, str], tmp_path: Path) -> None:
    for stem in name:
        cv2.imwrite(str(tmp_path / f"{stem}.png"), np.full((500, 600), 80, np.uint8))
    with pytest.raises(ValueError, match=rf"{name[0]}\.png: 600x500 px.*scale of its truth is unknown"):
        list(load_scenes(tmp_path))


def test_calib_without_ndisp_is_named(data: Path, tmp_path: Path) -> None:
    root = middlebury2014(data, tmp_path)
    (root / "trainingQ" / "Motorcycle" / "calib.txt").write_text("doffs=31\n")
    with pytest.raises(ValueError, match=r"calib\.txt: no entry 'ndisp=N'"):
        list(load_scenes(root))


@pytest.mark.parametrize("content", ["[1, 2]", json.dumps({"a": 3}), json.dumps({"a": {}}), "{"])
def test_hostile_manifests_are_named(content: str, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(content)
    with pytest.raises(ValueError, match=r"manifest\.json: "):
        list(load_scenes(tmp_path))
