"""What a caller may ask of a long computation: to stop, to be shown iterations, to be told what was searched."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.result import FrameResult, Step

_LISTED = 6  # candidates of a round that are named

Observe = Callable[[int, BonePoses | None], Observation]
"""what is seen of a frame; the hand's bones where it is expected tell which points of a cloud are the hand's,
None where that is not known"""
Watch = Callable[[int, Floats[P], float], None]
"""called after each accepted solver step with its count, parameters and cost"""
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


class Observer:
    """Is told how tracking goes on; does nothing with it."""

    def search(self, report: SearchReport) -> None:
        """Take the report of a search that was made."""

    def step(self, step: Step) -> None:
        """Take a frame that is solved for good, in the order of tracking, before its result is yielded."""

    def provisional(self, result: FrameResult) -> None:
        """Take a frame's result as soon as it is solved; a search beside may still change it, and the frames after it. What holds is yielded later."""

    def tried(self, result: FrameResult) -> None:
        """Take a frame that was just tracked to fit the size; nothing is kept of it."""

    def progress(self, share: float, words: str = "", stage: str = "refine") -> None:
        """Take how far a stage without frames is: the share that is done, 0 to 1, and what is done in words. Stages: `refine`, of all
        frames together, and `size`.
        """

    def shared(self, refinement: str) -> None:
        """Take, once, what all frames share, as they were refined: `whole.refinement.Refinement` as JSON."""


@dataclass(frozen=True)
class Control:
    """Handed down from whoever started the work."""

    should_stop: Callable[[], bool] = lambda: False
    """asked between solver steps"""
    observer: Observer = Observer()
    on_iteration: Callable[[int, int, Floats[P], float], None] | None = None
    """called as Watch is, with the frame's number before"""
    waits: bool = True
    """False: a search beside that isn't done `FRAMES_AHEAD` frames later is given up, as before a live camera, whose frames do not wait;
    one search is made at a time, and of the frames since only a few are solved anew"""
    refines: bool = True
    """False: frames stay as they come, and aren't refined together once all are tracked"""
    searches: bool = True
    """False: a search for what may be lost isn't made, only told to be due"""

    def watch(self, frame: int) -> Watch | None:
        """Return what the solver calls after each step in a frame; None where nobody looks."""
        shown = self.on_iteration
        if shown is None:
            return None
        return lambda count, params, cost: shown(frame, count, params, cost)


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
