"""Keeps of a run of any length what a page can show: figures of a few frames, evenly spread, and a row for each."""

import math
from collections.abc import Iterable
from typing import Generic, TypeVar

from epiline.report.encode import jpeg, reduced
from epiline.report.model import FrameSection, FrameSummary, Thumbnail
from epiline.report.reasons import has_value

MAX_FRAMES = 8
MAX_THUMBNAILS = 48
THUMBNAIL_PIXELS = 168 * 126

T = TypeVar("T")


class EvenSample(Generic[T]):
    """At most `maximum` items of a stream of unknown length, evenly spread, the first always among them.

    Keeps every item at first; whenever there are too many, drops every other one and doubles the stride. Once there
    were `maximum` items, at least half as many are kept.
    """

    def __init__(self, maximum: int) -> None:
        if maximum < 1:
            raise ValueError(f"maximum = {maximum}: must be at least 1")
        self._maximum, self._stride, self._seen = maximum, 1, 0
        self._items: list[T] = []

    @property
    def items(self) -> list[T]:
        """What was kept, in order."""
        return list(self._items)

    @property
    def takes_next(self) -> bool:
        """Whether the next item offered may be kept, for items that cost something to make."""
        return self._seen % self._stride == 0

    def offer(self, item: T) -> None:
        """The next item of the stream."""
        if self.takes_next:
            self._items.append(item)
            if len(self._items) > self._maximum:
                self._items = self._items[::2]
                self._stride *= 2
        self._seen += 1

    def skip(self) -> None:
        """Passes the next item over, where `takes_next` is False."""
        if self.takes_next:
            raise ValueError("this item belongs to the sample: offer it")
        self._seen += 1


def evenly_chosen(total: int, maximum: int) -> list[int]:
    """At most `maximum` of the indices 0 … total − 1, evenly spread, first and last among them."""
    if maximum < 1:
        raise ValueError(f"maximum = {maximum}: must be at least 1")
    if total <= maximum:
        return list(range(total))
    if maximum == 1:
        return [0]
    return [round(i * (total - 1) / (maximum - 1)) for i in range(maximum)]


def total_ms(frame: FrameSection) -> float:
    """Milliseconds of the whole frame: its `total` if given, else the sum of its stages; NaN without stages."""
    if "total" in frame.stage_ms:
        return frame.stage_ms["total"]
    return math.fsum(frame.stage_ms.values()) if frame.stage_ms else math.nan


def summarize(frame: FrameSection) -> FrameSummary:
    """The figures of a frame that the tables need."""
    nearest = min(
        (obstacle for obstacle in frame.obstacles if math.isfinite(obstacle.range_m)),
        key=lambda obstacle: obstacle.range_m,
        default=None,
    )
    return FrameSummary(
        index=frame.index,
        name=frame.name,
        region_range_m={profile.region.name: float(profile.range_m) for profile in frame.profiles},
        region_truth_m={} if frame.truth is None else dict(frame.truth.region_range_m),
        obstacles=len(frame.obstacles),
        nearest_m=math.nan if nearest is None else float(nearest.range_m),
        nearest_sigma_m=math.nan if nearest is None else float(nearest.sigma_m),
        nearest_region="" if nearest is None else nearest.region,
        alignment_px=math.nan if frame.alignment is None else abs(float(frame.alignment.median_px)),
        valid_share=float(has_value(frame.disparity.validity).mean()),
        stage_ms={stage: ms for stage, ms in frame.stage_ms.items() if stage != "total"},
        total_ms=total_ms(frame),
        track_range_m={t.id: float(t.range_m) for t in frame.tracks if t.confirmed and t.misses == 0},
    )


def thumbnail(frame: FrameSection) -> Thumbnail:
    """The left view, small."""
    small = reduced(frame.left, THUMBNAIL_PIXELS)
    height, width = small.shape[:2]
    return Thumbnail(index=frame.index, jpeg=jpeg(small, quality=70), width=width, height=height)


class FrameRecorder:
    """Collects a run frame by frame for a `RunReport`.

    Parameters
    ----------
    maximum
        How many frames get their figures.
    expected
        How many frames will come, if that is known: the figures then include the first and the last frame.

    Memory stays bounded by `maximum` full frames and `MAX_THUMBNAILS` small pictures, plus one summary per frame.
    """

    def __init__(self, *, maximum: int = MAX_FRAMES, expected: int | None = None) -> None:
        self._chosen = None if expected is None else frozenset(evenly_chosen(expected, maximum))
        self._planned: list[FrameSection] = []
        self._sample: EvenSample[FrameSection] = EvenSample(maximum)
        self._thumbnails: EvenSample[Thumbnail] = EvenSample(MAX_THUMBNAILS)
        self._summaries: list[FrameSummary] = []

    def add(self, frame: FrameSection) -> None:
        """The next frame. Its arrays are kept by reference if it is chosen: copy first what will be overwritten."""
        place = len(self._summaries)
        self._summaries.append(summarize(frame))
        if self._chosen is None:
            self._sample.offer(frame)
        elif place in self._chosen:
            self._planned.append(frame)
        if self._thumbnails.takes_next:
            self._thumbnails.offer(thumbnail(frame))
        else:
            self._thumbnails.skip()

    @property
    def takes_next(self) -> bool:
        """Whether the next frame may get its figures: what only figures need can be left out of the others."""
        return self._sample.takes_next if self._chosen is None else len(self._summaries) in self._chosen

    def extend(self, frames: Iterable[FrameSection]) -> None:
        """Several frames."""
        for frame in frames:
            self.add(frame)

    @property
    def frames(self) -> list[FrameSection]:
        """The frames that get their figures."""
        return self._sample.items if self._chosen is None else list(self._planned)

    @property
    def summaries(self) -> list[FrameSummary]:
        """Every frame's figures."""
        return list(self._summaries)

    @property
    def thumbnails(self) -> list[Thumbnail]:
        """Small pictures of frames, evenly spread."""
        return self._thumbnails.items
