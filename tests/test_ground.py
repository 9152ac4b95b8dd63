"""The ground on photographs whose cameras' heights are known."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

import epiline as ep


def grey(path: Path) -> np.ndarray:
    image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert image is not None, path
    return np.asarray(image, np.uint8)


def test_a_car_drives_level(data: Path) -> None:
    """40 frames of Karlsruhe: the camera's height within 5 % of its median, pitch within 0.3 degrees, one sigma."""
    drive = data / "karlsruhe_2010_03_09_drive_0023"
    if not drive.is_dir():
        pytest.skip(f"{drive} is absent")
    lefts = sorted((drive / "left").glob("*.png"))
    height, width = grey(lefts[0]).shape
    geometry = ep.RectifiedGeometry(
        width=width, height=height, focal_px=645.2401, cx_px=635.9587, cy_px=194.1291, baseline_m=0.57073
    )
    matcher = ep.StereoMatcher(preset="fast", num_disparities=96)
    estimator = ep.GroundEstimator()
    grounds = []
    for left in lefts:
        ground = estimator(matcher(grey(left), grey(drive / "right" / left.name)), geometry)
        assert ground is not None, (left.name, estimator.reason)
        grounds.append((ground.camera_height_m, np.degrees(ground.pitch_rad)))
    heights, pitches = np.array(grounds).T
    median = np.median(heights)
    assert 1.4 < median < 1.8
    assert np.abs(heights / median - 1).max() < 0.05
    assert np.std(pitches) < 0.3


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
