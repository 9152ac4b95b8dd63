"""The ground on photographs whose cameras' heights are known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep
from epiline.evaluation.obstacles.ground import car_run


def grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None, path
    return np.asarray(image, np.uint8)


def test_a_car_drives_level(data: Path) -> None:
    """40 frames of Karlsruhe: height within 5 % of its median; pitch, but for the car's nodding, within 0.3 degrees."""
    drive = data / "karlsruhe_2010_03_09_drive_0023"
    if not drive.is_dir():
        pytest.skip(f"{drive} is absent")
    figures = car_run(drive, "fast", None).steadiness()
    assert (figures["frames"], figures["found"]) == (40, 100)
    assert 1.4 < figures["camera_height_m"] < 1.8
    assert figures["height_off_worst"] < 5
    assert figures["pitch_less_nod_off_worst"] < 0.3


def test_kittis_camera_is_1_65_m_high(data: Path) -> None:
    frames = sorted((data / "kitti2015").glob("*_10"))
    if not frames:
        pytest.skip(f"{data / 'kitti2015'} is absent")
    heights = []
    for frame in frames:
        left, right = grey(frame / "left.png"), grey(frame / "right.png")
        geometry = ep.RectifiedGeometry(
            width=left.shape[1],
            height=left.shape[0],
            focal_px=721.5377,
            cx_px=609.5593,
            cy_px=172.854,
            baseline_m=0.532725,
        )
        disparity = ep.StereoMatcher(preset="fast", num_disparities=160)(left, right)
        ground = ep.GroundEstimator()(disparity, geometry)
        assert ground is not None, frame.name
        heights.append(ground.camera_height_m)
    assert abs(float(np.median(heights)) - 1.65) < 0.05
    assert np.abs(np.array(heights) - 1.65).max() < 0.15
