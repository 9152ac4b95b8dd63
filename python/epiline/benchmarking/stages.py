"""The stages before matching against OpenCV's: equalisation, rectification, grey levels, low-pass filter."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epiline._core import CameraModel, Rectifier, StereoCalibration, equalize, gaussian_low_pass, grey
from epiline.benchmarking.contestants import Answer, Contestant
from epiline.benchmarking.contests import Plan, Row
from epiline.benchmarking.pairs import Pair
from epiline.benchmarking.rounds import ratio, time_in_turns

# Answers agree when they are within this, grey levels: OpenCV rounds positions to 1/32 px, we to 1/256.
_AGREE = 2.0
_LOW_PASS_SIGMA = 40.0


def stages(level: str, pair: Pair, plan: Plan) -> Iterator[Row]:
    """A row for each stage and size; one thread each, since ours take one."""
    import cv2

    cv2.setNumThreads(1)
    for width, height in dict.fromkeys(size[:2] for size in plan.sizes):
        scene = pair.resized(width, height)
        for mine, theirs in (_equalisation(scene), _rectification(scene), _grey(scene), _low_pass(scene)):
            times = time_in_turns((mine, theirs), plan.repeats, plan.budget_s, one_thread=True)
            faster = ratio(times[:, 1], times[:, 0])
            answer, reference = mine.answer(), theirs.answer()
            yield Row(
                level=level,
                width=width,
                height=height,
                disparities=0,
                threads=1,
                tests=False,
                ours=mine.name,
                theirs=theirs.name,
                ratio=round(faster.median, 3),
                ratio_low=round(faster.low, 3),
                ratio_high=round(faster.high, 3),
                ours_ms=round(1e3 * float(np.median(times[:, 0])), 4),
                theirs_ms=round(1e3 * float(np.median(times[:, 1])), 4),
                check="agree",
                checked=round(float((np.abs(answer - reference) <= _AGREE).mean()), 6),
                ours_density=1.0,
                theirs_density=1.0,
            )


def _contestants(name: str, peer: str, mine: Any, theirs: Any) -> tuple[Contestant, Contestant]:
    """Both from functions that return an image."""

    def answer(work: Any) -> Answer:
        return np.asarray(work(), np.float32)

    return (
        Contestant(name, mine, lambda: answer(mine)),
        Contestant(peer, theirs, lambda: answer(theirs)),
    )


def _equalisation(scene: Pair) -> tuple[Contestant, Contestant]:
    import cv2

    out = np.empty_like(scene.left)
    return _contestants(
        "equalize", "equalizeHist", lambda: equalize(scene.left), lambda: cv2.equalizeHist(scene.left, out)
    )


def _grey(scene: Pair) -> tuple[Contestant, Contestant]:
    import cv2

    colour = np.stack([scene.left, scene.right, scene.left], axis=-1)
    out = np.empty_like(scene.left)
    return _contestants(
        "grey", "cvtColor", lambda: grey(colour), lambda: cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY, dst=out)
    )


def _low_pass(scene: Pair) -> tuple[Contestant, Contestant]:
    """OpenCV has no such filter: its discrete transforms and a multiplication make one."""
    import cv2

    levels = scene.left.astype(np.float32)
    height, width = levels.shape
    u, v = (np.fft.fftfreq(n, 1 / n) for n in (width, height))
    weights = np.exp(-(u[None, :] ** 2 + v[:, None] ** 2) / (2 * _LOW_PASS_SIGMA**2)).astype(np.float32)
    weights = np.repeat(weights[..., None], 2, axis=2)

    def theirs() -> NDArray[np.float32]:
        spectrum = cv2.dft(levels, flags=cv2.DFT_COMPLEX_OUTPUT)
        scaled = cv2.multiply(spectrum, weights)
        return np.asarray(cv2.dft(scaled, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT), np.float32)

    return _contestants("gaussian_low_pass", "dft", lambda: gaussian_low_pass(levels, sigma=_LOW_PASS_SIGMA), theirs)


def _rectification(scene: Pair) -> tuple[Contestant, Contestant]:
    """Both images of a pair, by OpenCV with maps in fixed point; sources as our rig model has them."""
    import cv2

    height, width = scene.left.shape
    focal = 0.82 * width
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])
    distortion = np.array([-0.3, 0.11, 0.0008, -0.0006, 0.0])
    turns = [cv2.Rodrigues(np.array(vector))[0] for vector in ((0.004, -0.008, 0.006), (-0.003, 0.009, -0.005))]
    relative = turns[1].T @ turns[0]
    camera = CameraModel(matrix, distortion, width=width, height=height)
    rectifier = Rectifier(StereoCalibration(camera, camera, relative, relative @ np.array([-0.12, 0.0, 0.0])))
    geometry = rectifier.geometry
    view = np.array([[geometry.focal_px, 0, geometry.cx_px], [0, geometry.focal_px, geometry.cy_px], [0, 0, 1]])
    aligned_from = [geometry.aligned_from_left, geometry.aligned_from_left @ relative.T]
    maps = [
        cv2.initUndistortRectifyMap(matrix, distortion, turn, view, (width, height), cv2.CV_16SC2)
        for turn in aligned_from
    ]
    out = [np.empty_like(scene.left) for _ in maps]

    def theirs() -> NDArray[np.uint8]:
        for image, (whole, fraction), target in zip((scene.left, scene.right), maps, out, strict=True):
            cv2.remap(image, whole, fraction, cv2.INTER_LINEAR, dst=target)
        return out[1]

    return _contestants("rectify, pair", "remap, pair", lambda: rectifier(scene.left, scene.right).right, theirs)
