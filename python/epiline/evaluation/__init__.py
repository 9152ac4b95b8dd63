"""Scores disparity against ground truth, one map or a folder of scenes."""

from epiline.evaluation.layouts import load_scenes
from epiline.evaluation.scenes import Scene
from epiline.evaluation.scores import Evaluation, evaluate
from epiline.evaluation.sparsification import Sparsification, sparsification

__all__ = ["Evaluation", "Scene", "Sparsification", "evaluate", "load_scenes", "sparsification"]
