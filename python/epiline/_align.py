"""Alignment without calibration: features of the pair, matched, then the core's estimate of the cameras."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from epiline._core import CameraModel, PairAlignment, align_candidates, grey

if TYPE_CHECKING:
    from epiline._typing import Floats, Image

# Lowe's ratio test, "Distinctive image features from scale-invariant keypoints", 2004: the nearest descriptor must be
# nearer than this share of the distance to the next.
_RATIO = 0.8
# Two cameras of one kind, side by side, see a feature equally large and equally upright.
_MAX_SCALE_RATIO = 1.6
_MAX_TURN_DEG = 25.0
_MAX_FEATURES = 4000


def align(
    left: Image, right: Image, lens: CameraModel | tuple[CameraModel, CameraModel] | None = None
) -> PairAlignment:
    """Aligns a pair without calibration, from its own content.

    Features are matched, two cameras that explain the matches are estimated (turns only if the lenses are given, else
    also focal length, principal points and radial distortion), and precise matches are sought in the images so aligned.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        Photographs of one size; three channels are blue, green, red.
    lens : CameraModel or (left, right) CameraModel, optional
        The lens of both cameras, or of each, if known. The answer is better for it.

    Returns
    -------
    PairAlignment
        ``trusted`` is false, with a ``reason``, wherever the content does not carry an alignment: one plane, too few
        matches, matches crowded together, unrelated, swapped or mirrored pictures.

    Raises
    ------
    ValueError
        Images of different sizes, or not images.
    """
    pair = _lens_pair(lens)
    left, right = grey(left), grey(right)
    left_px, right_px = match_features(left, right)
    return align_candidates(left, right, left_px, right_px, pair)


def _lens_pair(lens: Any) -> tuple[CameraModel, CameraModel] | None:
    if lens is None:
        return None
    pair = (lens, lens) if isinstance(lens, CameraModel) else tuple(lens)
    if len(pair) != 2 or not all(isinstance(camera, CameraModel) for camera in pair):
        raise ValueError("lens: expected a CameraModel or a pair of them")
    return cast("tuple[CameraModel, CameraModel]", pair)


def match_features(left: Image, right: Image) -> tuple[Floats, Floats]:
    """SIFT features that are each other's nearest and pass the ratio test: (N, 2) float64 each, pixels."""
    import cv2

    detector = cv2.SIFT.create(nfeatures=_MAX_FEATURES, contrastThreshold=0.02)
    points, descriptors = zip(*(detector.detectAndCompute(image, None) for image in (left, right)), strict=True)
    if min(len(p) for p in points) < 2:
        return np.empty((0, 2)), np.empty((0, 2))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    forward = matcher.knnMatch(descriptors[0], descriptors[1], k=2)
    back = {m.queryIdx: m.trainIdx for m in matcher.match(descriptors[1], descriptors[0])}
    kept = []
    for best, second in forward:
        a, b = points[0][best.queryIdx], points[1][best.trainIdx]
        turn = abs((a.angle - b.angle + 180.0) % 360.0 - 180.0)
        scale = max(a.size, b.size) / min(a.size, b.size)
        alike = turn <= _MAX_TURN_DEG and scale <= _MAX_SCALE_RATIO
        if alike and best.distance < _RATIO * second.distance and back[best.trainIdx] == best.queryIdx:
            kept.append((a.pt, b.pt))
    # One place can carry several features; it counts once.
    unique = np.unique(np.array(kept, dtype=np.float64).reshape(-1, 4), axis=0)
    return unique[:, :2], unique[:, 2:]
