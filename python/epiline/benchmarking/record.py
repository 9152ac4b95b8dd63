"""A number is recorded with machine, date and commit."""

from __future__ import annotations

import csv
import dataclasses
import datetime
import io
import platform
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path

from epiline._core import __version__
from epiline.benchmarking.contests import Curve, Row
from epiline.benchmarking.pipeline import Stage

_PACKAGE = Path(__file__).resolve().parents[1]


def cpu_name() -> str:
    """The processor as the system names it."""
    info = Path("/proc/cpuinfo")
    found = re.search(r"model name\s*:\s*(.+)", info.read_text()) if info.is_file() else None
    return found.group(1).strip() if found else platform.processor() or platform.machine()


def commit() -> str:
    """The commit of the checkout the package runs from, or its version where there is none."""
    try:
        git = subprocess.run(
            ["git", "-C", str(_PACKAGE), "describe", "--always", "--dirty"], capture_output=True, text=True
        )
    except FileNotFoundError:
        return __version__
    return git.stdout.strip() or __version__


def machine_line(pair_name: str, threads: Sequence[int]) -> str:
    """What a table cannot do without: machine, date, commit, peer, threads, scene."""
    import cv2

    counts = " and ".join(map(str, threads))
    today = datetime.date.today().isoformat()
    return f"{cpu_name()}; {today}; epiline {commit()}; OpenCV {cv2.__version__}; threads {counts}; {pair_name}"


def record_path(root: Path, ending: str = "") -> Path:
    """`benchmarks/record/<cpu>/<date><ending>.csv` under `root`."""
    folder = re.sub(r"[^a-z0-9]+", "-", cpu_name().lower()).strip("-")
    return root / "benchmarks" / "record" / folder / f"{datetime.date.today().isoformat()}{ending}.csv"


def rows_as_csv(head: str, results: Sequence[Row | Curve | Stage]) -> str:
    """A comment line, then the ratio tables, then stage times, then the curves, each under its own header."""
    text = io.StringIO()
    text.write(f"# {head}\n")
    writer = csv.writer(text, lineterminator="\n")
    for kind in (Row, Stage, Curve):
        members = [result for result in results if isinstance(result, kind)]
        if members:
            writer.writerow(field.name for field in dataclasses.fields(kind))
            writer.writerows(dataclasses.astuple(result) for result in members)
    return text.getvalue()
