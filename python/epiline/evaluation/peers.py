"""OpenCV's matchers, treated fairly: padded so that they answer the left border, with their tests, filled as ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from epiline._core import grey
from epiline.evaluation.interpolation import interpolate_background


@dataclass(frozen=True)
class Peer:
    """One of OpenCV's matchers.

    Attributes
    ----------
    name : str
    kind : {"bm", "3way", "hh"}
        `cv2.StereoBM`, or `cv2.StereoSGBM` in one of its modes.
    block_size : int
    fill : bool
        Answer every pixel: KITTI's background interpolation, then a 3x3 median.
    """

    name: str
    kind: Literal["bm", "3way", "hh"]
    block_size: int
    fill: bool

    def __call__(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8], num_disparities: int, threads: int | None
    ) -> NDArray[np.float32]:
        """(H, W) float32 px, NaN where there is no answer."""
        import cv2

        cv2.setNumThreads(-1 if threads is None else threads)
        # OpenCV wants a multiple of 16.
        count = -(-num_disparities // 16) * 16
        padded = [cv2.copyMakeBorder(grey(image), 0, 0, count, 0, cv2.BORDER_REPLICATE) for image in (left, right)]
        raw = self._matcher(count).compute(*padded)[:, count:]
        values: NDArray[np.float32] = raw.astype(np.float32) / np.float32(16)
        values[raw < 0] = np.nan
        if not self.fill:
            return values
        return np.asarray(cv2.medianBlur(np.nan_to_num(interpolate_background(values)), 3), np.float32)

    def _matcher(self, count: int) -> Any:
        import cv2

        if self.kind == "bm":
            matcher = cv2.StereoBM.create(count, self.block_size)
            matcher.setPreFilterCap(31)
            matcher.setTextureThreshold(10)
            matcher.setUniquenessRatio(10)
            matcher.setDisp12MaxDiff(1)
            matcher.setSpeckleWindowSize(100)
            # In sixteenths here, in whole pixels below.
            matcher.setSpeckleRange(2 * 16)
            return matcher
        mode = cv2.STEREO_SGBM_MODE_SGBM_3WAY if self.kind == "3way" else cv2.STEREO_SGBM_MODE_HH
        area = self.block_size**2
        return cv2.StereoSGBM.create(0, count, self.block_size, 8 * area, 32 * area, 1, 31, 10, 100, 2, mode)


BM = Peer("OpenCV StereoBM w9, padded, all tests", "bm", 9, fill=False)
BM_FILLED = Peer("OpenCV StereoBM w9, padded, filled", "bm", 9, fill=True)
SGBM = Peer("OpenCV SGBM 3WAY, padded, all tests", "3way", 5, fill=False)
SGBM_FILLED = Peer("OpenCV SGBM 3WAY, padded, filled", "3way", 5, fill=True)
PEERS = (BM, BM_FILLED, SGBM, SGBM_FILLED)
