"""The whole pipeline on rendered courses, with the cameras known exactly."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from epiline._core import (
    CameraModel,
    FrameResult,
    Pipeline,
    Rectifier,
    Region,
    StereoCalibration,
    StereoMatcher,
    Tracker,
    default_disparities,
    scan,
)
from epiline.evaluation.obstacles.followed import Followed
from epiline.evaluation.obstacles.ground import ground_sample
from epiline.evaluation.obstacles.photographs import photographs
from epiline.evaluation.obstacles.scans import HEADROOM_M, STEP_M, ScanScore, score_scan
from epiline.evaluation.obstacles.scoring import RangeSample, Report, Rules, score_frame
from epiline.evaluation.obstacles.tally import Tally
from epiline.evaluation.obstacles.truth import SUPPORT_PX, Flags, FrameTruth, frame_truth
from epiline.sources.rendered import RigTruth, Tracer, ViewTruth, nearest_supported, true_aligned
from epiline.sources.rendered.courses import Course


@dataclass(frozen=True)
class Entry:
    """A pipeline to evaluate: parameters of the matcher, over those of the pipeline's own, and of the pipeline.

    It has a tracker unless `pipeline` says otherwise.
    """

    name: str
    matcher: Mapping[str, Any] | None = None
    pipeline: Mapping[str, Any] | None = None

    def pipeline_for(self, calibration: StereoCalibration, width: int) -> Pipeline:
        """The pipeline for cameras of that width."""
        given: dict[str, Any] = {"tracker": Tracker(), **(self.pipeline or {})}
        if self.matcher is not None:
            # A preset or a method starts from its own defaults.
            chosen = self.matcher.keys() & {"preset", "method"}
            own = {} if chosen else Pipeline(calibration, alignment=False, **given).matcher_parameters
            defaults = {"num_disparities": default_disparities(width)}
            given["matcher"] = StereoMatcher(**{**own, **defaults, **self.matcher})
        return Pipeline(calibration, alignment=False, **given)


def calibration_of(truth: RigTruth) -> StereoCalibration:
    """The rig as a perfect calibration would find it."""
    left, right = (
        CameraModel(c.camera_matrix, (*c.distortion, 0.0), width=c.width, height=c.height)
        for c in (truth.left, truth.right)
    )
    return StereoCalibration(left, right, truth.rotation, truth.translation_m)


def evaluate_courses(
    courses: Iterable[Course],
    entry: Entry,
    *,
    rules: Rules | None = None,
    cache: Path | None = None,
    advance: Callable[[], object] = lambda: None,
) -> Iterator[tuple[Course, Tally]]:
    """Each course with its score; `advance` is called after each frame."""
    for course in courses:
        yield course, evaluate_course(course, entry, rules=rules, cache=cache, advance=advance)


def evaluate_course(
    course: Course,
    entry: Entry,
    *,
    rules: Rules | None = None,
    cache: Path | None = None,
    advance: Callable[[], object] = lambda: None,
) -> Tally:
    """Drives through one course."""
    chosen = Rules() if rules is None else rules
    tally, followed = Tally(), Followed(chosen)
    for frame in drive(course, entry, cache=cache):
        result, truth = frame.result, frame.truth
        reports = [Report.of(obstacle) for obstacle in result.obstacles]
        tally.frames.append(score_frame(reports, truth, chosen))
        followed.add(result.tracks, truth)
        if course.matchable:
            _add_regions(tally, result, truth, chosen)
        tally.grounds.append(ground_sample(result.ground, frame.view.world_from_view))
        tally.scans.append(_score_scan(frame, chosen))
        advance()
    tally.followed, tally.switches = followed.frames, followed.switches
    return tally


@dataclass(frozen=True)
class DrivenFrame:
    """A frame's result beside its truth.

    Attributes
    ----------
    result : FrameResult
    truth : FrameTruth
    view : ViewTruth
        Of the aligned left image.
    """

    result: FrameResult
    truth: FrameTruth
    view: ViewTruth


def drive(course: Course, entry: Entry, *, cache: Path | None = None) -> Iterator[DrivenFrame]:
    """Drives through a course."""
    cameras = course.rig().truth
    calibration = calibration_of(cameras)
    pipeline = entry.pipeline_for(calibration, course.size[0])
    disparities = int(pipeline.matcher_parameters["num_disparities"])
    geometry = pipeline.geometry
    tracer = Tracer(course.scene)
    valid: tuple[Flags, Flags] | None = None
    for photograph in photographs(course, cache):
        if valid is None:
            aligned = Rectifier(calibration)(photograph.left, photograph.right)
            valid = aligned.left_valid, aligned.right_valid
        view = true_aligned(tracer, photograph.world_from_left, geometry)
        truth = frame_truth(view, geometry, valid=valid, num_disparities=disparities, ground=course.ground)
        result = pipeline.process(photograph.left, photograph.right, stamp_nanos=photograph.stamp_nanos)
        yield DrivenFrame(result, truth, view)


def _score_scan(frame: DrivenFrame, rules: Rules) -> ScanScore:
    found = scan(
        frame.result.disparity,
        frame.result.pair.geometry,
        ground=frame.result.ground,
        step_m=STEP_M,
        headroom_m=HEADROOM_M,
        max_range_m=rules.reach_m,
    )
    pose = frame.view.world_from_view
    away = frame.view.points_world_m[..., :2] - pose[:2, 3]
    ahead = pose[:2, 2] / np.linalg.norm(pose[:2, 2])
    angle = np.arctan2(ahead[0] * away[..., 1] - ahead[1] * away[..., 0], away @ ahead)
    return score_scan(found, frame.truth, angle, np.linalg.norm(away, axis=-1), rules)


def _add_regions(tally: Tally, result: FrameResult, truth: FrameTruth, rules: Rules) -> None:
    for profile in result.profiles:
        true_m = region_range_m(truth, profile.region)
        if not true_m <= rules.reach_m:
            continue
        tally.regions_asked += 1
        if np.isfinite(profile.range_m):
            tally.regions.append(RangeSample(profile.region.name, profile.range_m, true_m, profile.sigma_m))


def region_range_m(truth: FrameTruth, region: Region) -> float:
    """The nearest supported range of what both cameras see in a region, metres; NaN where there is none."""
    box = np.s_[region.y : region.y + region.height, region.x : region.x + region.width]
    return nearest_supported(truth.range_m[box][truth.seen[box]], SUPPORT_PX)
