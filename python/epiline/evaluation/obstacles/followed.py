"""Confirmed tracks against truth: scored as reports are, and whether each solid keeps its track."""

from __future__ import annotations

from collections.abc import Iterable

from epiline._core import Track
from epiline.evaluation.obstacles.scoring import FrameScore, Report, Rules, score_frame
from epiline.evaluation.obstacles.truth import FrameTruth

# No track can be confirmed earlier: `Tracker(confirm_hits=3)`.
FIRST_FRAME = 2


class Followed:
    """The confirmed tracks of one course, frame by frame.

    Attributes
    ----------
    frames : list of FrameScore
        From the first one on in which a track can be confirmed.
    switches : int
        How often a solid was found by another track than before, and no longer by that.
    """

    def __init__(self, rules: Rules) -> None:
        self.frames: list[FrameScore] = []
        self.switches = 0
        self._rules = rules
        self._seen = 0
        self._track_of: dict[int, int | None] = {}

    def add(self, tracks: Iterable[Track], truth: FrameTruth) -> None:
        """Scores the confirmed ones of a frame's tracks that are seen in it: of others no columns are known."""
        self._seen += 1
        if self._seen <= FIRST_FRAME:
            return
        score = score_frame(
            [Report.of_track(track) for track in tracks if track.confirmed and track.misses == 0], truth, self._rules
        )
        self.frames.append(score)
        for asked, finders in zip(score.found, score.finders, strict=True):
            before = self._track_of.get(asked.object_id)
            if any(finder.track == before for finder in finders):
                continue
            self.switches += asked.object_id in self._track_of
            self._track_of[asked.object_id] = finders[0].track
