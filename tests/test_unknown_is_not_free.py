"""A wall without texture is unknown, and what is unknown is never reported as free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

import epiline as ep
from epiline.evaluation.obstacles.rendered import calibration_of
from epiline.sources.rendered import Box, RenderedRig, Room, Scene, ViewTruth, true_aligned, world_from_optical
from epiline.sources.rendered.scene import CARDBOARD, PLANKS, WHITEWASH

WALL_M = 2.5
NOTHING_IN_RANGE = 1


@dataclass(frozen=True)
class Seen:
    """A frame's result and the truth of its left aligned image."""

    result: ep.FrameResult
    view: ViewTruth

    def of(self, name: str) -> np.ndarray:
        return self.view.object_id == self.view.scene.names.index(name)


@pytest.fixture(scope="module", params=["fast", "balanced", "accurate"])
def seen(request: pytest.FixtureRequest) -> Seen:
    """A blank wall 2.5 m ahead, as wide as the view, over a floor of planks; a box stands before its right half."""
    room = Room((-2.0, WALL_M), (-3.0, 3.0), 2.6, floor=PLANKS, ceiling=WHITEWASH, front=WHITEWASH)
    box = Box("box", (1.9, -0.6, 0.4), (0.3, 0.5, 0.8), CARDBOARD)
    rig = RenderedRig(seed=8, size=(320, 240), scene=Scene(room, (box,), seed=8))
    pose = world_from_optical((0.0, 0.0, 0.6), 0.0, 0.1)
    calibration = calibration_of(rig.truth)
    matcher = ep.StereoMatcher(preset=request.param, num_disparities=64, threads=1)
    pipeline = ep.Pipeline(calibration, matcher=matcher, alignment=False)
    g = pipeline.geometry
    view = true_aligned(rig.tracer, pose, g)
    return Seen(pipeline.process(*rig.photograph(pose)), view)


def inner(flags: np.ndarray, by: int) -> np.ndarray:
    """Without what lies within `by` pixels of its edge, where windows see other things."""
    kept = np.zeros_like(flags)
    size = 2 * by + 1
    windows = np.lib.stride_tricks.sliding_window_view(flags, (size, size))
    kept[by:-by, by:-by] = windows.all(axis=(2, 3))
    return kept


def test_the_wall_itself_has_no_range_and_says_why(seen: Seen) -> None:
    wall = inner(seen.of("front wall"), 12)
    assert wall.sum() > 5000
    answered = np.isfinite(seen.result.range.depth_m)
    disparity = seen.result.disparity
    # Not none: shading that 8 bits cut into level contours is a texture of a kind.
    assert answered[wall].mean() < 0.15
    assert (disparity.validity[wall & ~np.isfinite(disparity.values)] != 0).all()
    # The rest of the picture is answered: a matcher that answers nothing would pass the above.
    assert answered[inner(seen.of("floor"), 4)].mean() > 0.5
    assert answered[inner(seen.of("box"), 4)].mean() > 0.8


def test_few_answers_put_anything_behind_the_wall(seen: Seen) -> None:
    wall = inner(seen.of("front wall"), 12)
    assert np.mean(seen.result.range.depth_m[wall] > 1.1 * WALL_M) < 0.15


def test_the_scan_never_calls_the_wall_free(seen: Seen) -> None:
    """The box's directions apart, every direction ends at the wall: none is free behind it, and none is clear."""
    result, view = seen.result, seen.view
    assert result.ground is not None
    scan = ep.scan(result.disparity, result.pair.geometry, ground=result.ground, max_range_m=6.0)
    pose = view.world_from_view
    away = view.points_world_m[..., :2] - pose[:2, 3]
    ahead = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
    angle = np.arctan2(ahead[0] * away[..., 1] - ahead[1] * away[..., 0], away @ ahead)
    box = angle[seen.of("box")]
    at_box = (scan.angle_rad > box.min() - 0.03) & (scan.angle_rad < box.max() + 0.03)
    wall_m = (WALL_M - pose[0, 3]) / np.cos(scan.angle_rad + np.arctan2(ahead[1], ahead[0]))
    assert at_box.sum() > 20
    assert (~at_box).sum() > 100
    assert not (scan.seen[~at_box] == NOTHING_IN_RANGE).any()
    free = scan.free_to_m > scan.free_from_m
    assert free.mean() > 0.5, "the floor before the wall is free"
    assert (scan.free_to_m[free & ~at_box] <= 1.2 * wall_m[free & ~at_box]).all()
    laser = scan.to_laser_scan()
    assert not np.isposinf(np.asarray(laser["ranges"])).any()
    assert np.isnan(np.asarray(laser["ranges"])).mean() > 0.3
    # The box, which has texture, is what the same scan does report.
    inner_box = (scan.angle_rad > box.min() + 0.02) & (scan.angle_rad < box.max() - 0.02)
    assert np.median(scan.nearest_m[inner_box]) == pytest.approx(1.75, abs=0.1)
