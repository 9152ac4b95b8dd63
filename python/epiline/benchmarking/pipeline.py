"""The whole pipeline against the same chain written with OpenCV: from a raw pair to obstacles in four regions.

Both equalise, rectify, match with all tests, compute depth, and cluster what is near in each region. What OpenCV's
chain leaves out (sigma, profiles, the ground, the size and bearing of an obstacle) is to its advantage.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from epiline._core import CameraModel, FrameResult, Pipeline, StereoCalibration, StereoMatcher, grey, paper_regions
from epiline.benchmarking.contestants import Answer, Contestant
from epiline.benchmarking.contests import Plan, Row, Size, agreement, row
from epiline.benchmarking.rounds import time_in_turns

SIZES: tuple[Size, ...] = ((320, 240, 48), (640, 480, 64), (1280, 720, 128))
_WINDOW = 9
_NEAR_M, _FAR_M = 0.3, 6.0
_FEWEST_PIXELS = 64


@dataclass(frozen=True)
class Stage:
    """Median time of one stage of our pipeline, milliseconds by the wall's clock."""

    level: str
    width: int
    height: int
    disparities: int
    stage: str
    ms: float


@dataclass(frozen=True)
class RawPair:
    """A pair before rectification, (H, W) uint8 each, and its rig."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    calibration: StereoCalibration


@cache
def raw_pair(width: int, height: int) -> RawPair:
    """A photograph of the rendered workshop: lenses and poses that need rectification."""
    from epiline.sources.rendered import RenderedRig

    rig = RenderedRig(size=(width, height))
    (frame,) = rig.frames(1)
    left, right = (
        CameraModel(c.camera_matrix, (*c.distortion, 0.0), width=c.width, height=c.height)
        for c in (rig.truth.left, rig.truth.right)
    )
    calibration = StereoCalibration(left, right, rig.truth.rotation, rig.truth.translation_m)
    return RawPair(np.asarray(grey(frame.left), np.uint8), np.asarray(grey(frame.right), np.uint8), calibration)


def pipeline_rows(level: str, plan: Plan) -> Iterator[Row | Stage]:
    """The contest at every size of the plan up to 1280 columns, one thread; our stage times beside it."""
    import cv2

    cv2.setNumThreads(1)
    for size in plan.sizes:
        width, height, disparities = size
        if width > SIZES[-1][0]:
            continue
        pair = raw_pair(width, height)
        mine, last = ours(pair, disparities)
        theirs = OpenCvChain(pair, disparities).contestant()
        times = time_in_turns((mine, theirs), plan.repeats, plan.budget_s, one_thread=True)
        context = {"level": level, "threads": 1, "width": width, "height": height, "disparities": disparities}
        yield row(mine, theirs, times[:, 0], times[:, 1], "agree", agreement, context | {"tests": True})
        turns = []
        for _ in range(plan.repeats):
            mine.work()
            turns.append(last[0].stage_ms)
        for stage in turns[0]:
            ms = float(np.median([turn[stage] for turn in turns]))
            yield Stage(level, width, height, disparities, stage, round(ms, 4))


def ours(pair: RawPair, disparities: int) -> tuple[Contestant, list[FrameResult]]:
    """Our pipeline with preset `fast`, and the list that holds its last result."""
    width, height = pair.left.shape[1], pair.left.shape[0]
    matcher = StereoMatcher(preset="fast", num_disparities=disparities, threads=1)
    pipeline = Pipeline(
        pair.calibration,
        matcher=matcher,
        regions=paper_regions(width, height),
        equalize=True,
        alignment=False,
        max_range_m=_FAR_M,
    )
    last: list[FrameResult] = []

    def work() -> None:
        # As in a stream, where a frame's result goes before the next one comes: the pipeline takes its buffers back.
        last.clear()
        last.append(pipeline.process(pair.left, pair.right))

    def answer() -> Answer:
        return last[0].disparity.values

    return Contestant("pipeline, fast, 4 regions", work, answer), last


class OpenCvChain:
    """equalizeHist, remap, StereoBM with its tests, division, connectedComponentsWithStats per region."""

    def __init__(self, pair: RawPair, disparities: int) -> None:
        import cv2

        self._pair = pair
        height, width = pair.left.shape
        self._regions = [np.s_[r.y : r.y + r.height, r.x : r.x + r.width] for r in paper_regions(width, height)]
        # Our own aligned geometry, so that both match the same images.
        geometry = Pipeline(pair.calibration, alignment=False).geometry
        self._focal_baseline = geometry.focal_px * geometry.baseline_m
        aligned_from_left = geometry.aligned_from_left
        aligned_from_right = aligned_from_left @ np.asarray(pair.calibration.rotation).T
        k = np.array([[geometry.focal_px, 0, geometry.cx_px], [0, geometry.focal_px, geometry.cy_px], [0, 0, 1.0]])
        k_right = k.copy()
        k_right[0, 2] -= geometry.doffs_px
        self.maps = [
            cv2.initUndistortRectifyMap(
                np.asarray(camera.camera_matrix),
                np.asarray(camera.distortion),
                turn,
                new,
                (width, height),
                cv2.CV_16SC2,
            )
            for camera, turn, new in (
                (pair.calibration.left, aligned_from_left, k),
                (pair.calibration.right, aligned_from_right, k_right),
            )
        ]
        self._matcher: Any = cv2.StereoBM.create(disparities, _WINDOW)
        self._matcher.setPreFilterType(cv2.StereoBM_PREFILTER_XSOBEL)
        self._matcher.setPreFilterCap(31)
        self._matcher.setUniquenessRatio(10)
        self._matcher.setTextureThreshold(10)
        self._matcher.setDisp12MaxDiff(1)
        self._matcher.setSpeckleWindowSize(100)
        self._matcher.setSpeckleRange(2 * 16)
        self.disparity: NDArray[np.int16] = np.zeros((0, 0), np.int16)
        self.depth_m: NDArray[np.float32] = np.zeros((0, 0), np.float32)
        self.clusters: list[NDArray[np.int32]] = []

    def work(self) -> None:
        """One frame."""
        import cv2

        aligned = [
            cv2.remap(cv2.equalizeHist(image), *maps, cv2.INTER_LINEAR)
            for image, maps in zip((self._pair.left, self._pair.right), self.maps, strict=True)
        ]
        self.disparity = np.asarray(self._matcher.compute(*aligned), np.int16)
        self.depth_m = np.asarray(cv2.divide(16 * self._focal_baseline, self.disparity, dtype=cv2.CV_32F))
        self.clusters = []
        for region in self._regions:
            near = cv2.inRange(self.depth_m[region], _NEAR_M, _FAR_M)
            _, _, stats, _ = cv2.connectedComponentsWithStats(near)
            self.clusters.append(stats[1:][stats[1:, cv2.CC_STAT_AREA] >= _FEWEST_PIXELS])

    def answer(self) -> Answer:
        """(H, W) disparity, px."""
        values: Answer = self.disparity.astype(np.float32) / np.float32(16)
        values[self.disparity < 0] = np.nan
        return values

    def contestant(self) -> Contestant:
        """The chain as a contestant."""
        return Contestant("OpenCV's chain", self.work, self.answer)
