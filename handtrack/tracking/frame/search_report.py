"""What a search tried in a frame, as numbers and in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from handtrack.tracking.frame.result import FrameResult

_LISTED = 6  # candidates of a round that are named

Trial = tuple[str, float]
"""what became of one candidate in a round: its origin and cost"""
Tried = list[tuple[int, tuple[Trial, ...]]]
"""of each round how many were proposed, and those fitted"""


@dataclass(frozen=True)
class SearchReport:
    """What a search tried in a frame, and what came of it."""

    frame: int
    situation: str
    why: str
    """why it was made in this frame"""
    measure: str
    """by what finished candidates are compared, in words"""
    rounds: Tried
    standing: float
    """cost of the pose that stood; NaN without one"""
    winner: Trial | None
    """None: nothing was taken"""
    taken: str
    """why the winner is, in words"""

    def lines(self) -> Iterator[str]:
        """Yield the report in words: what was tried, what it cost, why the winner won."""
        yield f"- {self.situation} ({self.why})"
        stands = np.isfinite(self.standing)
        standing = f"standing pose: {self.standing:.2f}, by" if stands else "compared by"
        yield f"  {standing} {self.measure}"
        for number, (proposed, trials) in enumerate(self.rounds, start=1):
            yield f"  round {number}: {proposed} proposed, {len(trials)} fitted: {_grouped(trials)}"
        if self.winner is None:
            nothing = "better was found; the standing pose stays" if stands else "was taken"
            yield f"  nothing {nothing}"
            return
        origin, cost = self.winner
        yield f"  taken: {origin} at {cost:.2f}, {self.taken}"


def explained(frame: int, reports: Sequence[SearchReport], result: FrameResult | None) -> list[str]:
    """Return a frame's searches in words, one line after the other, in the order in which they were made, and its result."""
    own = [one for one in reports if one.frame == frame]
    lines = [
        f"frame {frame}: {len(own)} searches" if own else f"frame {frame}: nothing was searched"
    ]
    for one in own:
        lines += one.lines()
    if result is not None:
        found = f"result: {result.status.words}, cost {result.energy:.1f}"
        lines.append(f"{found}; {result.note}" if result.note else found)
    return lines


def _grouped(trials: Sequence[Trial]) -> str:
    """Return the best of a round's candidates in words, those of one origin together."""
    groups = [list(group) for _, group in groupby(sorted(trials), key=lambda t: t[0])]
    groups.sort(key=lambda group: group[0][1])
    named = [
        f"{origin}{f' ×{len(others) + 1}' if others else ''} {cost:.2f}"
        for (origin, cost), *others in groups[:_LISTED]
    ]
    more = len(groups) - _LISTED
    return ", ".join(named) + (f" and {more} more" if more > 0 else "")
