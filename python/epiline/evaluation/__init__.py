"""Scores disparity against ground truth, one map or a folder of scenes."""

from epiline.evaluation.scenes import Scene, load_scenes
from epiline.evaluation.scores import Evaluation, evaluate

__all__ = ["Evaluation", "Scene", "evaluate", "load_scenes"]
