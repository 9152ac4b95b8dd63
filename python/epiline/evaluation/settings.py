"""Ways to match a scene that are compared with each other: ours by their parameters."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from epiline._core import DisparityMap, StereoMatcher


class Method(Protocol):
    """Whatever turns a pair into disparity: a `Setting`, or a peer."""

    @property
    def name(self) -> str: ...

    def __call__(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8], num_disparities: int, threads: int | None
    ) -> NDArray[np.float32]: ...


@dataclass(frozen=True)
class Setting:
    """Our matcher with these parameters."""

    name: str
    parameters: dict[str, Any] = field(default_factory=dict)

    def map(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8], num_disparities: int, threads: int | None
    ) -> DisparityMap:
        """The whole map, with its reasons."""
        given = {"num_disparities": num_disparities, "threads": threads, **self.parameters}
        return StereoMatcher(**given)(left, right)

    def __call__(
        self, left: NDArray[np.uint8], right: NDArray[np.uint8], num_disparities: int, threads: int | None
    ) -> NDArray[np.float32]:
        """(H, W) float32 px, NaN where there is no answer."""
        return self.map(left, right, num_disparities, threads).values


# Without tests nothing removes a wrong match, and a larger window makes fewer of them.
_UNTESTED_WINDOW = 15
BUILT_IN = (
    Setting("sad, all tests (preset fast)", {"preset": "fast"}),
    Setting("sad, no tests", {"method": "sad", "block_size": _UNTESTED_WINDOW}),
    Setting("sad, all tests, filled", {"preset": "fast", "fill": True}),
    Setting("semi-global, all tests (preset balanced)", {"preset": "balanced"}),
    Setting("semi-global, all tests, filled (preset accurate)", {"preset": "accurate", "fill": True}),
)
