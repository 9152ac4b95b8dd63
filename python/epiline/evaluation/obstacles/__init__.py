"""Scores obstacles, regions and ground: on rendered courses with exact truth, and on photographs that have one."""

from epiline.evaluation.obstacles.rendered import Entry, evaluate_course, evaluate_courses
from epiline.evaluation.obstacles.scoring import FrameScore, RangeSample, Report, Rules, score_frame
from epiline.evaluation.obstacles.tally import Tally
from epiline.evaluation.obstacles.truth import Asked, FrameTruth, frame_truth

__all__ = [
    "Asked",
    "Entry",
    "FrameScore",
    "FrameTruth",
    "RangeSample",
    "Report",
    "Rules",
    "Tally",
    "evaluate_course",
    "evaluate_courses",
    "frame_truth",
    "score_frame",
]
