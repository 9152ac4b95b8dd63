"""Tables as text for programs."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence


def table_as_csv(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A header line, then a line per row."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return text.getvalue()
