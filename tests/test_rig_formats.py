"""Rigs in other systems' files: read as those systems mean them, round trips, refusals, hostile content."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

import epiline as ep
from epiline.cli import main

LENSES: dict[str, list[float]] = {
    "brown-conrady": [-0.28, 0.09, 1.2e-3, -3e-4, 1 / 3],
    "rational": [0.48, 0.027, 4e-5, -1e-5, 9e-5, 0.77, 0.096, 1.4e-3],
    "thin-prism": [0.48, 0.027, 4e-5, -1e-5, 9e-5, 0.77, 0.096, 1.4e-3, 2e-3, -7e-4, -1e-3, 3e-4],
    "kannala-brandt": [-0.02, 4e-3, -3e-3, 2e-4],
    "tsai": [0.21],
}
# Which lenses each format holds, and the names of its files.
FORMATS = {
    "epiline": (list(LENSES), ["rig.yaml"]),
    "opencv": (["brown-conrady", "rational", "thin-prism", "kannala-brandt"], ["rig.yml"]),
    "opencv pair": (
        ["brown-conrady", "rational", "thin-prism", "kannala-brandt"],
        ["intrinsics.yml", "extrinsics.yml"],
    ),
    "opencv xml": (["brown-conrady", "rational", "thin-prism", "kannala-brandt"], ["rig.xml"]),
    "ros": (["brown-conrady", "rational", "kannala-brandt"], ["left.yaml", "right.yaml"]),
    "kalibr": (["radtan", "kannala-brandt"], ["camchain.yaml"]),
    "mrcal": (["brown-conrady", "rational", "thin-prism"], ["left.cameramodel", "right.cameramodel"]),
}


def camera(lens: str, shift: float = 0.0) -> ep.CameraModel:
    matrix = [[533.1 + shift, 0, 342.7], [0, 536.9, 235.5 - shift], [0, 0, 1]]
    if lens == "radtan":
        return ep.CameraModel(matrix, [-0.28, 0.09, 1.2e-3, -1e-4 / 3], width=640, height=480)
    return ep.CameraModel(matrix, LENSES[lens], width=640, height=480, lens=lens)  # type: ignore[arg-type]


def rig(lens: str = "brown-conrady") -> ep.StereoCalibration:
    rotation, _ = cv2.Rodrigues(np.array([0.01, -0.02, 0.005]))
    return ep.StereoCalibration(camera(lens), camera(lens, 1 / 7), rotation, [-0.12, 1e-3, -2e-4])


def aligned_rig() -> ep.StereoCalibration:
    def pinhole(cx: float) -> ep.CameraModel:
        return ep.CameraModel([[994.978, 0, cx], [0, 994.978, 254.877], [0, 0, 1]], [0] * 5, width=741, height=500)

    return ep.StereoCalibration(pinhole(311.193), pinhole(342.279), np.eye(3), [-0.193001, 0, 0])


def files(folder: Path, names: list[str]) -> Path | tuple[Path, Path]:
    return folder / names[0] if len(names) == 1 else (folder / names[0], folder / names[1])


def assert_same(a: ep.StereoCalibration, b: ep.StereoCalibration) -> None:
    for ours, theirs in [(a.left, b.left), (a.right, b.right)]:
        assert ours.lens == theirs.lens
        np.testing.assert_allclose(ours.camera_matrix, theirs.camera_matrix, rtol=1e-12)
        np.testing.assert_allclose(ours.distortion, theirs.distortion, rtol=1e-12, atol=0)
        assert (ours.width, ours.height) == (theirs.width, theirs.height)
    np.testing.assert_allclose(a.rotation, b.rotation, atol=1e-12)
    np.testing.assert_allclose(a.translation_m, b.translation_m, atol=1e-12)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("lens", [*LENSES, "radtan"])
def test_round_trips_are_exact_and_the_rest_is_refused(tmp_path: Path, kind: str, lens: str) -> None:
    lenses, names = FORMATS[kind]
    paths = files(tmp_path, names)
    name = kind.split()[0]
    held = lens in lenses or (lens == "radtan" and "brown-conrady" in lenses)
    if not held:
        with pytest.raises(ep.Error, match=r"cannot|has no k3") as caught:
            rig(lens).save(paths, format=name)  # type: ignore[arg-type]
        assert names[0] in str(caught.value)
        assert list(tmp_path.iterdir()) == []
        return
    rig(lens).save(paths, format=name)  # type: ignore[arg-type]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(names)
    assert_same(ep.StereoCalibration.load(paths), rig(lens))
    assert_same(ep.StereoCalibration.load(paths, format=name), rig(lens))  # type: ignore[arg-type]


@pytest.mark.parametrize(("name", "file"), [("middlebury", "calib.txt"), ("kitti", "calib_cam_to_cam.txt")])
def test_aligned_pairs(tmp_path: Path, name: str, file: str) -> None:
    path = tmp_path / file
    aligned_rig().save(path, format=name)  # type: ignore[arg-type]
    back = ep.StereoCalibration.load(path, format="kitti-grey" if name == "kitti" else None)
    assert_same(back, aligned_rig())
    with pytest.raises(ep.Error, match=rf"{file}.*distortion"):
        rig().save(path, format=name)  # type: ignore[arg-type]
    left = aligned_rig().left
    turned = ep.StereoCalibration(left, left, cv2.Rodrigues(np.array([0, 1e-3, 0]))[0], [-0.1, 0, 0])
    with pytest.raises(ep.Error, match="a rotation between the cameras"):
        turned.save(path, format=name)  # type: ignore[arg-type]
    raised = ep.StereoCalibration(left, left, np.eye(3), [-0.1, 1e-3, 0])
    with pytest.raises(ep.Error, match="not along the rows"):
        raised.save(path, format=name)  # type: ignore[arg-type]


def test_names_choose_the_format(tmp_path: Path) -> None:
    rig().save((tmp_path / "left.yaml", tmp_path / "right.yaml"))
    assert "distortion_model: plumb_bob" in (tmp_path / "left.yaml").read_text()
    rig().save((tmp_path / "l.cameramodel", tmp_path / "r.cameramodel"))
    assert "LENSMODEL_OPENCV5" in (tmp_path / "l.cameramodel").read_text()
    rig().save(tmp_path / "rig.xml")
    assert "<opencv_storage>" in (tmp_path / "rig.xml").read_text()
    aligned_rig().save(tmp_path / "calib.txt")
    assert (tmp_path / "calib.txt").read_text().startswith("cam0=[")
    rig().save(tmp_path / "rig.yml")
    assert (tmp_path / "rig.yml").read_text().startswith("format: epiline")
    for bad in ("matlab", ""):
        with pytest.raises(ValueError, match="expected one of epiline, opencv"):
            rig().save(tmp_path / "rig.mat", format=bad)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="'ros' has two files"):
        rig().save(tmp_path / "left.yaml", format="ros")
    with pytest.raises(ValueError, match="'kalibr' has one file"):
        rig().save((tmp_path / "a.yaml", tmp_path / "b.yaml"), format="kalibr")
    with pytest.raises(ValueError, match="'ros' has two files"):
        ep.StereoCalibration.load(tmp_path / "left.yaml")
    with pytest.raises(ValueError, match="not written"):
        rig().save(tmp_path / "stereo.yaml", format="boofcv")  # type: ignore[arg-type]


@pytest.mark.parametrize("extension", ["yml", "xml", "json"])
def test_what_opencv_writes(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"stereo.{extension}"
    truth = rig("rational")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    for i, side in [(1, truth.left), (2, truth.right)]:
        storage.write(f"M{i}", side.camera_matrix)
        storage.write(f"D{i}", side.distortion.reshape(1, -1))
    storage.write("R", truth.rotation)
    storage.write("T", truth.translation_m.reshape(3, 1) * 1e3)
    storage.write("Q", np.eye(4))
    storage.release()
    # FileStorage prints 17 digits.
    assert_same(ep.StereoCalibration.load(path, unit_m=1e-3), truth)


@pytest.mark.parametrize("names", [["rig.yml"], ["rig.xml"], ["intrinsics.yml", "extrinsics.yml"]])
def test_what_opencv_reads(tmp_path: Path, names: list[str]) -> None:
    truth = rig("thin-prism")
    truth.save(files(tmp_path, names), format="opencv")
    found: dict[str, NDArray[np.float64]] = {}
    for name in names:
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_READ)
        found |= {key: m for key in ("M1", "D1", "M2", "D2", "R", "T") if (m := storage.getNode(key).mat()) is not None}
        storage.release()
    for key, expected in [
        ("M1", truth.left.camera_matrix),
        ("D1", truth.left.distortion.reshape(1, -1)),
        ("M2", truth.right.camera_matrix),
        ("D2", truth.right.distortion.reshape(1, -1)),
        ("R", truth.rotation),
        ("T", truth.translation_m.reshape(3, 1)),
    ]:
        np.testing.assert_array_equal(found[key], expected)


def test_the_opencv_samples_two_files(tmp_path: Path, data: Path) -> None:
    """The sample's own intrinsics, and extrinsics as it writes them: no size, squares of 25 units."""
    intrinsics = data / "calib" / "opencv_bouguet" / "intrinsics.yml"
    extrinsics = tmp_path / "extrinsics.yml"
    storage = cv2.FileStorage(str(extrinsics), cv2.FILE_STORAGE_WRITE)
    rotation, _ = cv2.Rodrigues(np.array([0.01, 0.005, -0.004]))
    storage.write("R", rotation)
    storage.write("T", np.array([[-83.2], [1.0], [0.1]]))
    storage.release()
    with pytest.raises(ep.Error, match="'image_size' is not in the file"):
        ep.StereoCalibration.load((intrinsics, extrinsics))
    found = ep.StereoCalibration.load((intrinsics, extrinsics), image_size=(640, 480), unit_m=1e-3)
    assert found.left.camera_matrix[0, 0] == 534.80326845051309
    assert found.right.distortion[0] == -0.16916358306948096
    assert found.translation_m == pytest.approx([-0.0832, 1e-3, 1e-4], rel=1e-12)
    np.testing.assert_array_equal(found.rotation, rotation)
    with pytest.raises(ep.Error, match=r"intrinsics\.yml.*'R' is missing"):
        ep.StereoCalibration.load(intrinsics, image_size=(640, 480))


def test_boofcv(data: Path) -> None:
    found = ep.StereoCalibration.load(data / "calib" / "boofcv_Bumblebee2_Chess" / "stereo.yaml", unit_m=1e-3)
    # `rightToLeft`: where the left camera sees the right one's centre.
    right_center = -found.rotation.T @ found.translation_m
    assert right_center == pytest.approx([0.12004374261980637, 8.974418603859871e-4, -9.149583203134171e-4], rel=1e-9)
    assert found.left.distortion.tolist() == [-0.3625365821238732, 0.17532754393079863, 0, 0, 0]
    assert found.image_size == (640, 480)


def test_mrcal(tmp_path: Path, data: Path) -> None:
    """A published model, as mrcal writes it: comments, single quotes, packed inputs; poses from a reference."""
    model = json.loads((data / "calib" / "mrcal_samyang_corners" / "reference_model_opencv8.json").read_text())
    paths = (tmp_path / "a.cameramodel", tmp_path / "b.cameramodel")
    poses = ([0.1, -0.2, 0.3, 1.0, 2.0, 3.0], [0.11, -0.22, 0.29, 0.8, 2.05, 3.1])
    for path, key, pose in zip(paths, ("extrinsics", "rt_cam_ref"), poses, strict=True):
        path.write_text(
            "# generated on 2024-01-01 with mrgingham\n"
            "# Npoints_all: {12}\n"
            "{\n"
            f"    'lensmodel':  '{model['lensmodel']}',\n\n"
            "    # intrinsics are fx,fy,cx,cy,distortion0,distortion1,....\n"
            f"    'intrinsics': [ {', '.join(map(str, model['intrinsics']))},],\n\n"
            "    'valid_intrinsics_region': [\n    [ 622, 0 ],\n    [ 0, 634 ],\n],\n\n"
            f"    # extrinsics are rt_fromref\n    '{key}': [ {', '.join(map(str, pose))} ],\n\n"
            "    'imagersize': [ 6016, 4016,],\n\n"
            "    'icam_intrinsics': 0,\n"
            "    'optimization_inputs': b'P)h>@6aWAK2mk;8K>#{}[],:;|`~!$%^&*()_+-=<>?',\n"
            "}\n"
        )
    found = ep.StereoCalibration.load(paths)
    assert found.left.lens == "rational"
    assert found.left.distortion.tolist() == model["intrinsics"][4:]
    left, right = (cv2.Rodrigues(np.array(p[:3]))[0] for p in poses)
    np.testing.assert_allclose(found.rotation, right @ left.T, atol=1e-12)
    np.testing.assert_allclose(found.translation_m, poses[1][3:] - right @ left.T @ poses[0][3:], atol=1e-12)
    paths[0].write_text(
        paths[0].read_text().replace("OPENCV8", "SPLINED_STEREOGRAPHIC_order=3_Nx=30_Ny=20_fov_x_deg=150")
    )
    with pytest.raises(ep.Error, match=r"a\.cameramodel.*'lensmodel'.*SPLINED"):
        ep.StereoCalibration.load(paths)


ROS = """\
image_width: 640
image_height: 480
camera_name: {name}
camera_matrix:
  rows: 3
  cols: 3
  data: [533.1, 0, 342.7, 0, 536.9, 235.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.28, 0.09, 0.0012, -0.0003, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [{turn}]
projection_matrix:
  rows: 3
  cols: 4
  data: [500., 0., 320., {shift}, 0., 500., 240., 0., 0., 0., 1., 0.]
"""


def test_ros_means_what_stereo_rectify_means(tmp_path: Path) -> None:
    truth = rig()
    R1, R2, _, P2, *_ = cv2.stereoRectify(
        truth.left.camera_matrix, truth.left.distortion, truth.right.camera_matrix, truth.right.distortion,
        (640, 480), truth.rotation, truth.translation_m.reshape(3, 1),
    )  # fmt: skip
    paths = (tmp_path / "left.yaml", tmp_path / "right.yaml")
    for path, turn, shift in [(paths[0], R1, 0.0), (paths[1], R2, 500 * P2[0, 3] / P2[0, 0])]:
        numbers = ", ".join(repr(float(v)) for v in turn.ravel())
        path.write_text(ROS.format(name=path.stem, turn=numbers, shift=repr(float(shift))))
    found = ep.StereoCalibration.load(paths)
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation_m, truth.translation_m, atol=1e-12)
    with pytest.raises(ep.Error, match="swapped"):
        ep.StereoCalibration.load((paths[1], paths[0]))
    with pytest.raises(ep.Error, match="no baseline"):
        ep.StereoCalibration.load((paths[0], paths[0]))


def test_ros_files_rectify_the_pictures_as_ours_do(tmp_path: Path) -> None:
    paths = (tmp_path / "left.yaml", tmp_path / "right.yaml")
    rig().save(paths)
    image = np.random.default_rng(0).integers(0, 256, (480, 640)).astype(np.uint8)
    theirs, ours = (ep.Rectifier(r)(image, image) for r in (ep.StereoCalibration.load(paths), rig()))
    # Positions that differ by rounding may fall on either side of a 256th of a pixel.
    assert (theirs.left == ours.left).mean() > 0.999
    assert (theirs.right == ours.right).mean() > 0.999


CAMCHAIN = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.8e-05]
  distortion_model: {model}
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.999997256, 0.002312067, 0.000376008, -0.110073808]
  - [-0.002317135, 0.999898049, 0.014089835, 0.000399122]
  - [-0.000343393, -0.014090668, 0.999900662, -0.000853703]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, -0.0001, -3.5e-05]
  distortion_model: {model}
  intrinsics: [457.6, 456.1, 379.9, 255.2]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""


def test_kalibr(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(CAMCHAIN.format(model="radtan"))
    found = ep.StereoCalibration.load(path)
    assert found.translation_m.tolist() == [-0.110073808, 0.000399122, -0.000853703]
    assert found.left.distortion.tolist() == [-0.28, 0.07, 0.0002, 1.8e-05, 0]
    assert found.image_size == (752, 480)
    path.write_text(CAMCHAIN.format(model="equidistant"))
    assert ep.StereoCalibration.load(path).left.lens == "kannala-brandt"
    path.write_text(CAMCHAIN.format(model="fov"))
    with pytest.raises(ep.Error, match=r"cam0\.distortion_model' is 'fov'"):
        ep.StereoCalibration.load(path)


MIDDLEBURY = """\
cam0=[994.978 0 311.193; 0 994.978 254.877; 0 0 1]
cam1=[994.978 0 342.279; 0 994.978 254.877; 0 0 1]
doffs=31.086
baseline=193.001
width=741
height=500
ndisp=70
isint=0
vmin=6
vmax=61
dyavg=0.082
dymax=0.325
"""


def test_middlebury(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(MIDDLEBURY)
    assert_same(ep.StereoCalibration.load(path), aligned_rig())
    path.write_text(MIDDLEBURY.replace("doffs=31.086", "doffs=3.1"))
    with pytest.raises(ep.Error, match=r"calib\.txt.*'doffs' is 3.1 px"):
        ep.StereoCalibration.load(path)
    path.write_text(MIDDLEBURY.replace("193.001", "nan"))
    with pytest.raises(ep.Error, match="'baseline' holds 'nan'"):
        ep.StereoCalibration.load(path)


# KITTI 2015, training 000002: four cameras of one aligned rig.
KITTI = """\
P0: 7.215377e+02 0 6.095593e+02 0 0 7.215377e+02 1.728540e+02 0 0 0 1 0
P1: 7.215377e+02 0 6.095593e+02 -3.875744e+02 0 7.215377e+02 1.728540e+02 0 0 0 1 0
P2: 7.215377e+02 0 6.095593e+02 4.485728e+01 0 7.215377e+02 1.728540e+02 2.163791e-01 0 0 1 2.745884e-03
P3: 7.215377e+02 0 6.095593e+02 -3.395242e+02 0 7.215377e+02 1.728540e+02 2.199936e+00 0 0 1 2.729905e-03
R0_rect: 1 0 0 0 1 0 0 0 1
"""


def test_kitti(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(KITTI)
    with pytest.raises(ep.Error, match="'image_size' is not in the file"):
        ep.StereoCalibration.load(path)
    colour = ep.StereoCalibration.load(path, image_size=(1242, 375))
    assert colour.baseline_m == pytest.approx(0.532725, abs=1e-6)
    grey = ep.StereoCalibration.load(path, image_size=(1242, 375), format="kitti-grey")
    assert grey.baseline_m == pytest.approx(0.537150, abs=1e-6)
    assert grey.left.camera_matrix[0, 2] == 609.5593


def raw_kitti(rig_of: dict[int, tuple[ep.CameraModel, np.ndarray, np.ndarray]]) -> str:
    """A `calib_cam_to_cam.txt` of cameras and where camera 0 is to them, in KITTI's digits."""

    def line(name: str, values: np.ndarray) -> str:
        return f"{name}: {' '.join(f'{value:.6e}' for value in np.ravel(values))}"

    lines = ["calib_time: 09-Jan-2012 13:57:47", "corner_dist: 9.950000e-02"]
    for number, (camera, turn, shift_m) in rig_of.items():
        lines += [
            line(f"S_{number:02}", np.array([camera.width, camera.height])),
            line(f"K_{number:02}", camera.camera_matrix),
            line(f"D_{number:02}", camera.distortion),
            line(f"R_{number:02}", turn),
            line(f"T_{number:02}", shift_m),
        ]
    return "\n".join(lines) + "\n"


def test_kitti_before_it_was_aligned(tmp_path: Path) -> None:
    """The projection of a point through the file's own words: x_i = R_i x_0 + T_i, then K_i and D_i by OpenCV."""
    rng = np.random.default_rng(0)
    cameras = {}
    for number, x_m in enumerate((0.0, 0.54, 0.06, 0.6)):
        matrix = np.array([[984.2 + number, 0, 690.5 - number], [0, 980.8, 233.2], [0, 0, 1]])
        lens = [-0.373, 0.205, 2.2e-4, 1.8e-3, -7.2e-2]
        turn = cv2.Rodrigues(rng.normal(0, 0.01, 3))[0]
        model = ep.CameraModel(matrix, lens, width=1392, height=512)
        cameras[number] = (model, turn, np.array([-x_m, 0.002, -0.01]))
    path = tmp_path / "calib_cam_to_cam.txt"
    path.write_text(raw_kitti(cameras))
    point = np.array([0.7, -0.4, 6.0])
    for left, right in ((2, 3), (0, 1), (0, 3), (2, 1)):
        rig = ep.StereoCalibration.load(path, format="kitti-raw", cameras=(left, right))
        in_left, in_right = (cameras[i][1] @ point + cameras[i][2] for i in (left, right))
        np.testing.assert_allclose(rig.rotation @ in_left + rig.translation_m, in_right, atol=1e-5)
        model, _, _ = cameras[right]
        expected, _ = cv2.projectPoints(
            in_right[None], np.zeros(3), np.zeros(3), np.array(model.camera_matrix), np.array(model.distortion)
        )
        np.testing.assert_allclose(rig.right.project(in_right[None]), expected[0], atol=1e-3)
        assert rig.image_size == (1392, 512)
    # By default the colour pair; content decides, as there are no aligned pictures in the file.
    assert_same(ep.StereoCalibration.load(path), ep.StereoCalibration.load(path, format="kitti-raw", cameras=(2, 3)))


def test_kitti_files_choose_their_pair(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(KITTI)
    size = (1242, 375)
    grey = ep.StereoCalibration.load(path, image_size=size, cameras=(0, 1))
    assert_same(grey, ep.StereoCalibration.load(path, image_size=size, format="kitti-grey"))
    mixed = ep.StereoCalibration.load(path, image_size=size, cameras=(0, 3))
    assert mixed.baseline_m == pytest.approx(339.5242 / 721.5377)
    with pytest.raises(ep.Error, match="to the left of the left"):
        ep.StereoCalibration.load(path, image_size=size, cameras=(3, 2))
    with pytest.raises(ep.Error, match="'P7' is missing"):
        ep.StereoCalibration.load(path, image_size=size, cameras=(0, 7))
    with pytest.raises(ValueError, match=r"cameras = \[2, 2\]"):
        ep.StereoCalibration.load(path, image_size=size, cameras=(2, 2))
    with pytest.raises(ep.Error, match="'S_02' is missing"):
        ep.StereoCalibration.load(path, format="kitti-raw")
    with pytest.raises(ValueError, match="can be read but not written"):
        grey.save(path, format="kitti-raw")  # type: ignore[arg-type]
    rig = tmp_path / "rig.yaml"
    grey.save(rig)
    with pytest.raises(ValueError, match=r"cameras = .* is for KITTI's files"):
        ep.StereoCalibration.load(rig, cameras=(0, 1))


def test_the_real_karlsruhe_file_is_a_rig(data: Path) -> None:
    found = ep.StereoCalibration.load(data / "karlsruhe_2010_03_09_drive_0023" / "calib.txt")
    assert found.baseline_m == pytest.approx(0.5707, abs=5e-5)
    assert found.image_size == (1344, 372)


LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join([f'*{chr(97 + i)}'] * 9)}]\n" for i in range(9)
)
XML_LAUGHS = (
    '<?xml version="1.0"?><!DOCTYPE z [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><opencv_storage>&b;</opencv_storage>'
)
HOSTILE = [
    ("billion laughs", "rig.yaml", LAUGHS, "document"),
    ("entities", "rig.xml", XML_LAUGHS, "document"),
    ("deep lists", "rig.yaml", "[" * 100_000, "document"),
    ("deep elements", "rig.xml", "<a>" * 2_000 + "</a>" * 2_000, "document"),
    ("unknown", "rig.yaml", "answer: 42\n", "document"),
    ("empty", "rig.yml", "", "document"),
    ("only a head", "rig.yml", "%YAML:1.0\n---\n", "document"),
    ("unclosed", "rig.xml", "<opencv_storage><M1>", "document"),
    (
        "huge matrix",
        "rig.yml",
        "R: !!opencv-matrix\n   rows: 3\n   cols: 99999999\n   dt: d\n   data: [ 1. ]\n",
        "R.cols",
    ),
    ("no numbers", "rig.yml", "R: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ a, b ]\n", "R.data"),
    ("NaN", "rig.yml", "R: !!opencv-matrix\n   rows: 1\n   cols: 1\n   dt: d\n   data: [ .Nan ]\n", "R.data[0]"),
]


@pytest.mark.parametrize(("file", "text", "field"), [h[1:] for h in HOSTILE], ids=[h[0] for h in HOSTILE])
def test_hostile_files_are_one_clear_error(tmp_path: Path, file: str, text: str, field: str) -> None:
    path = tmp_path / file
    path.write_text(text)
    with pytest.raises(ep.Error) as caught:
        ep.StereoCalibration.load(path, image_size=(640, 480))
    message = str(caught.value)
    assert file in message
    assert f"'{field}'" in message
    assert "\n" not in message
    assert len(message) < 500


@pytest.mark.parametrize("kind", ["opencv", "opencv xml", "kalibr", "ros", "mrcal"])
def test_no_truncated_or_damaged_file_is_a_different_rig(tmp_path: Path, kind: str) -> None:
    _, names = FORMATS[kind]
    paths = files(tmp_path, names)
    truth = rig("radtan")
    truth.save(paths, format=kind.split()[0])  # type: ignore[arg-type]
    last = tmp_path / names[-1]
    text = last.read_text()
    for end in range(0, len(text) - 1, 7):
        last.write_text(text[:end])
        try:
            found = ep.StereoCalibration.load(paths)
        except (ep.Error, ValueError):
            continue
        # A cut inside the last, unused entries may leave the rig whole.
        assert_same(found, truth)
    for key in ("nan", "1e999", "'x'", "[]"):
        for number in ("533.1", "536.9", "342.7"):
            if number not in text:
                continue
            last.write_text(text.replace(number, key, 1))
            with pytest.raises((ep.Error, ValueError)):
                ep.StereoCalibration.load(paths)


@pytest.mark.parametrize("lens", LENSES)
def test_lenses_are_opencvs(lens: str) -> None:
    model = camera(lens)
    rng = np.random.default_rng(3)
    points = rng.uniform([-0.7, -0.5, 0.9], [0.7, 0.5, 1.6], (200, 3))
    pixels = model.project(points)
    zero = np.zeros(3)
    if lens == "kannala-brandt":
        expected, _ = cv2.fisheye.projectPoints(
            points.reshape(-1, 1, 3), zero, zero, model.camera_matrix, model.distortion
        )
    elif lens == "tsai":
        # u = d (1 + kappa1 d²), solved by the roots of the cubic.
        ideal = points[:, :2] / points[:, 2:]
        radius = np.linalg.norm(ideal, axis=1)
        roots = [np.roots([0.21, 0, 1, -r]) for r in radius]
        distorted = np.array([float(r[np.abs(r.imag) < 1e-9].real[0]) for r in roots])
        K = model.camera_matrix
        expected = ideal * (distorted / radius)[:, None] * [K[0, 0], K[1, 1]] + [K[0, 2], K[1, 2]]
    else:
        expected, _ = cv2.projectPoints(points, zero, zero, model.camera_matrix, model.distortion)
    np.testing.assert_allclose(pixels, expected.reshape(-1, 2), atol=1e-9)
    # And back, by the directions and by cv2's own inverse.
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(model.directions(pixels), directions, atol=1e-9)
    if lens not in ("kannala-brandt", "tsai"):
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
        theirs = cv2.undistortPoints(
            pixels.reshape(-1, 1, 2),
            model.camera_matrix,
            model.distortion,
            None,
            None,
            model.camera_matrix,
            criteria=criteria,
        )
        inner = np.linalg.norm(points[:, :2] / points[:, 2:], axis=1) < 0.6
        np.testing.assert_allclose(model.undistort(pixels)[inner], theirs.reshape(-1, 2)[inner], atol=1e-5)


def test_a_fisheye_behind_the_image_plane() -> None:
    model = ep.CameraModel(
        [[200, 0, 320], [0, 200, 240], [0, 0, 1]], [0, 0, 0, 0], width=640, height=480, lens="kannala-brandt"
    )
    sideways = np.array([[1.0, 0.0, -0.2]])
    pixel = model.project(sideways)
    assert pixel[0] == pytest.approx([320 + 200 * (np.pi / 2 + np.arctan(0.2)), 240])
    np.testing.assert_allclose(model.directions(pixel), sideways / np.linalg.norm(sideways), atol=1e-12)
    assert np.isnan(model.undistort(pixel)).all(), "no pinhole image sees it"


def test_the_command_line_describes_and_converts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, target = tmp_path / "camchain.yaml", (tmp_path / "left.yaml", tmp_path / "right.yaml")
    rig("radtan").save(source, format="kalibr")
    assert main(["info", "--rig", str(source), "--save-as", *map(str, target), "--format", "ros", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["baseline_m"] == pytest.approx(rig().baseline_m)
    assert facts["left"]["lens"] == "brown-conrady"
    # Wider than the 61.9 degrees of a pinhole: barrel distortion.
    assert 62 < facts["left"]["fov_deg"][0] < 70
    assert_same(ep.StereoCalibration.load(target), rig("radtan"))
    assert main(["info", "--rig", *map(str, target)]) == 0
    assert "brown-conrady" in capsys.readouterr().out
    assert main(["info", "--rig", str(source), "--save-as", str(tmp_path / "calib.txt")]) == 1
    assert "cannot hold the left lens's distortion" in capsys.readouterr().err
    assert main(["info", "--save-as", str(source)]) == 1
    assert "--rig" in capsys.readouterr().err


def test_the_command_line_reads_any_pair_of_kittis_cameras(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, target = tmp_path / "calib_cam_to_cam.txt", tmp_path / "rig.yaml"
    turn = cv2.Rodrigues(np.array([0.01, -0.02, 0.005]))[0]
    model = ep.CameraModel([[984, 0, 690], [0, 980, 233], [0, 0, 1]], [-0.37, 0.2, 0, 0, -0.07], width=1392, height=512)
    cameras = {n: (model, turn, np.array([-0.2 * n, 0.0, 0.0])) for n in range(4)}
    aligned = "".join(
        f"S_rect_{n:02}: 1242 375\nP_rect_{n:02}: 721 0 609 {-721 * 0.2 * n} 0 721 172 0 0 0 1 0\n" for n in range(4)
    )
    path.write_text(raw_kitti(cameras) + aligned)
    arguments = ["info", "--rig", str(path), "--cameras", "0", "3", "--json"]
    assert main(arguments) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["baseline_m"] == pytest.approx(0.6)
    assert facts["left"]["width"] == 1242
    assert main([*arguments, "--read-as", "kitti-raw", "--save-as", str(target)]) == 0
    assert_same(ep.StereoCalibration.load(target), ep.StereoCalibration.load(path, format="kitti-raw", cameras=(0, 3)))
    assert ep.StereoCalibration.load(target).left == model
