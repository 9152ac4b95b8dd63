"""Chooses a matcher's parameters for somebody's own scenes, with ground truth or without."""

from epiline.tuning.judges import Judge, consensus_judge, truth_judge
from epiline.tuning.objective import Objective, Quality, parse_objective
from epiline.tuning.ranges import DisparityRange, find_range
from epiline.tuning.search import Search, Step, Trial, Tuner

__all__ = [
    "DisparityRange",
    "Judge",
    "Objective",
    "Quality",
    "Search",
    "Step",
    "Trial",
    "Tuner",
    "consensus_judge",
    "find_range",
    "parse_objective",
    "truth_judge",
]
