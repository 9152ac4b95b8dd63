"""What verbs print: tables and progress for people, JSON for programs."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from epiline._json import finite


def _console(*, stderr: bool = False) -> Console:
    # A pipe has no width: rich would fold tables at 80 columns there and hide figures.
    stream = sys.stderr if stderr else sys.stdout
    return Console(stderr=stderr, highlight=False, soft_wrap=True, width=None if stream.isatty() else 160)


def say(text: str) -> None:
    """One line on standard output."""
    _console().print(text, markup=False)


def note(text: str) -> None:
    """One line on standard error: for people, out of the way of data."""
    _console(stderr=True).print(text, markup=False)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """A table: the first column reads from the left, the others are figures."""
    table = Table(title=title, title_justify="left", title_style="bold", header_style="bold", box=None, pad_edge=False)
    for i, column in enumerate(columns):
        table.add_column(column, justify="left" if i == 0 else "right", no_wrap=True)
    for row in rows:
        table.add_row(*(_cell(value) for value in row))
    _console().print(table)


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "-" if math.isnan(value) else f"{value:.2f}"
    return "-" if value is None else str(value)


def print_json(value: Mapping[str, Any]) -> None:
    """One JSON document on one line; what is not finite is null."""
    json.dump(finite(value), sys.stdout, allow_nan=False, separators=(", ", ": "))
    sys.stdout.write("\n")


class Steps:
    """Advances one line of progress."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task

    def __call__(self, steps: int = 1) -> None:
        self._progress.advance(self._task, steps)


@contextmanager
def progress(what: str, total: int | None) -> Iterator[Steps]:
    """A progress line on standard error; silent unless that is a terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    console = _console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield Steps(bar, bar.add_task(what, total=total))
