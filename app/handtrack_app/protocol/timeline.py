"""The timeline as the engine tells it: the whole recording at a glance, and what is new of it while tracking goes on."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from handtrack.arrays import Array, F, Floats, Ints, N


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
        )
