"""The timeline as the engine tells it: the whole recording at a glance, and what is new of it while tracking goes on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from handtrack.arrays import Array, F, Floats, Ints, N

PROBABILITY, VIEWS, AT_LIMITS, MOVED, APART = (
    "probably off", "views", "at limits", "changed mm", "apart mm",
)  # fmt: skip
"""lanes: how probably a joint is 25 mm off; the views a frame's energy is of; joints at their limits; how far the take that
shows moved a joint from the one below it; how far a joint lies from the take that is compared"""


@dataclass(frozen=True)
class StretchCard:
    """Frames, first to last, that are worth a look."""

    first: int
    last: int
    worst: int
    """the frame that is most probably off"""
    expected: float
    """how many of its frames are off, by their probabilities"""
    brief: str
    """the reason in a few words"""
    words: str
    """and in a clause"""


@dataclass(frozen=True)
class TakeSpan:
    """Frames, first to last, that a take shows."""

    take: int
    first: int
    last: int


@dataclass(frozen=True)
class TimelineSnapshot:
    """The whole recording at a glance; rows are frames from `start`."""

    start: int
    status: Ints[F]
    """contracts §5; −1 untracked"""
    energy: Floats[F]
    error_mm: Floats[F]
    """NaN where unknown"""
    by_hand: tuple[int, ...]
    """frames whose pose was given, by hand or by a search"""
    terms: dict[str, Floats[F]] = field(default_factory=dict)
    """the energy's parts in words"""
    found: tuple[int, ...] = ()
    """those of `by_hand` that a search gave"""
    lanes: dict[str, Floats[F]] = field(default_factory=dict)
    """other numbers by their words, NaN where unknown"""
    accepted: frozenset[int] = frozenset()
    """frames that no tracking changes"""
    stretches: tuple[StretchCard, ...] = ()
    """worth a look, the worst first"""
    takes: tuple[TakeSpan, ...] = ()
    """what the track is composed of, ascending"""
    hidden: tuple[TakeSpan, ...] = ()
    """likewise, of takes that cannot show: they were tracked with another model than the one in force"""
    is_posed: bool = False
    """somebody said where the model is: by a first pose, by hand, or by tracking"""


@dataclass(frozen=True)
class TimelineChange:
    """Some rows of the timeline anew, while tracking goes on: what is told does not grow with the recording."""

    frames: range
    """of the whole timeline"""
    row: Ints[N]
    status: Ints[N]
    energy: Floats[N]
    error_mm: Floats[N]
    terms: dict[str, Floats[N]]
    lanes: dict[str, Floats[N]] = field(default_factory=dict)

    def over(self, strip: TimelineSnapshot) -> TimelineSnapshot:
        """Return a timeline with these rows; as it was if it is of other frames, as a whole one is on its way then."""
        count = len(strip.status)
        if self.frames != range(strip.start, strip.start + count):
            return strip

        def put(values: Array[F], new: Array[N]) -> Array[F]:
            whole = values.copy()
            whole[self.row] = new
            return whole

        unknown = np.full(count, np.nan)
        return replace(
            strip,
            status=put(strip.status, self.status),
            energy=put(strip.energy, self.energy),
            error_mm=put(strip.error_mm, self.error_mm),
            terms=strip.terms
            | {word: put(strip.terms.get(word, unknown), new) for word, new in self.terms.items()},
            lanes=strip.lanes
            | {word: put(strip.lanes.get(word, unknown), new) for word, new in self.lanes.items()},
        )
