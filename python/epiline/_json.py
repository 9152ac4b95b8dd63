"""JSON has neither NaN nor infinity."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def finite(record: Mapping[str, Any]) -> dict[str, Any]:
    """The same record with NaN and infinities as None, and keys as text, however deep."""
    return {str(key): _finite(value) for key, value in record.items()}


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return finite(value)
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    return value
