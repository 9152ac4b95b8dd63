"""Speed of the matcher against OpenCV's: both in one run, in turns, their answers compared."""

from epiline.benchmarking.contests import Curve, Plan, Row
from epiline.benchmarking.levels import levels_here, measure_level
from epiline.benchmarking.pipeline import Stage
from epiline.benchmarking.record import machine_line, record_path, rows_as_csv

__all__ = [
    "Curve",
    "Plan",
    "Row",
    "Stage",
    "levels_here",
    "machine_line",
    "measure_level",
    "record_path",
    "rows_as_csv",
]
