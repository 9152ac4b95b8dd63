"""The process that measures one level: a JSON order as its argument, a line of JSON for each result."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from epiline._core import simd_level
from epiline.benchmarking.contests import Curve, Plan, Row, rows
from epiline.benchmarking.curves import curves
from epiline.benchmarking.pairs import pair_from
from epiline.benchmarking.pipeline import Stage, pipeline_rows
from epiline.benchmarking.stages import stages


def main(order: str) -> None:
    given = json.loads(order)
    plan = Plan(**{**given["plan"], "sizes": tuple(tuple(size) for size in given["plan"]["sizes"])})
    pair = pair_from(Path(given["data"]) if given["data"] else None)
    level = simd_level()
    tables: Iterator[Row] = chain(rows(level, pair, plan), stages(level, pair, plan)) if plan.tables else iter(())
    points: Iterator[Curve] = curves(level, pair, plan) if plan.curves else iter(())
    whole: Iterator[Row | Stage] = pipeline_rows(level, plan) if plan.pipeline else iter(())
    results: Iterator[Row | Curve | Stage] = chain(whole, tables, points)
    for result in results:
        print(json.dumps(dataclasses.asdict(result)), flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
