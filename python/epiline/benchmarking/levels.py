"""A process for each SIMD level: the level is chosen when the library is loaded."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from epiline._core import Error
from epiline.benchmarking.contests import Curve, Plan, Row
from epiline.benchmarking.pipeline import Stage

LEVELS = ("scalar", "avx2", "avx512", "neon")


def levels_here() -> list[str]:
    """The levels this processor has, slowest first."""
    code = "import epiline; print(epiline.simd_level())"
    found = []
    for level in LEVELS:
        done = subprocess.run(
            [sys.executable, "-c", code], env={**os.environ, "EPILINE_SIMD": level}, capture_output=True, text=True
        )
        if done.stdout.strip() == level:
            found.append(level)
    return found


def measure_level(level: str, plan: Plan, data: Path | None) -> Iterator[Row | Curve | Stage]:
    """Measures at one level, in a process of its own; results come as they are ready.

    Raises
    ------
    epiline.Error
        The process failed; the message is its last line.
    """
    order = {"plan": dataclasses.asdict(plan), "data": None if data is None else str(data)}
    command = [sys.executable, "-m", "epiline.benchmarking.worker", json.dumps(order)]
    # Both matchers are told how many threads to take; a cap from outside would hold only ours.
    environment = {name: value for name, value in os.environ.items() if name != "EPILINE_THREADS"}
    with subprocess.Popen(
        command, env={**environment, "EPILINE_SIMD": level}, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        try:
            for line in process.stdout:
                record = json.loads(line)
                kind = Row if "tests" in record else Stage if "stage" in record else Curve
                yield kind(**record)
            complaint = process.stderr.read().strip()
        finally:
            process.kill()
    if process.returncode != 0 and complaint:
        raise Error(f"measuring at level {level}: {complaint.splitlines()[-1]}")
