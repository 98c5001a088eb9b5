"""What a caller may ask of a long computation: to stop, to be shown iterations, to be told what was searched."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

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


Proposer = Callable[[Any, Sequence[Any], int], list[Any]]
"""(objective, candidates so far, how many at most; 0: all) → new candidates"""
Fitter = Callable[[Any, Sequence[Any], int], list[Any]]
"""(objective, candidates, iterations) → the candidates improved, with new costs; fewer when stopped"""


@dataclass(frozen=True)
class Round:
    """One round of a search: who joins, how many are fitted, and how."""

    propose: tuple[tuple[Proposer, int], ...] = ()
    """functions, and how many candidates of each at most; 0: as many as there are"""
    keep: int | None = None
    """how many of the candidates so far stay beside the proposed; None: all"""
    enter: int | None = None
    """the best distinct ones that are fitted; None: all, in their order"""
    fits: tuple[tuple[Fitter, int], ...] = ()
    """functions, and the solver's iterations in each; 0: as many as it has by itself"""
    adds: bool = False
    """only what is newly proposed is fitted, and joins those that stand"""
    times: int = 1
    """how often it is made at most: again while the best cost falls, as the search counts it"""


@dataclass(frozen=True)
class Search:
    """A policy: a situation and what is tried in it."""

    situation: str
    when: str
    rounds: tuple[Round, ...]
    measure: str
    """by what finished candidates are compared, in words"""
    factor: float = 1.0
    margin: float = 0.0
    """a pose is taken that costs less than factor · (the standing one's) − margin"""
    repeats: int = 1
    """how often it is searched on from a better pose"""
    most: int = 1
    """how many distinct poses are taken, the best first"""
    again: str = ""
    """how soon the search is made again if it found nothing, in words"""
    taken: str = ""
    """what is taken, in words, where it is not the best of those that are better than the standing pose"""
    tried: str = ""
    """what is tried, in words, where there are no rounds"""

    def is_better(self, cost: float, standing: float) -> bool:
        """Return whether a candidate of that cost is taken instead of the standing pose."""
        return cost < self.factor * standing - self.margin

    def why_taken(self, standing: float) -> str:
        """Return in words why a candidate is taken instead of a standing pose of that cost."""
        limit = self.factor * standing - self.margin
        return (
            self.taken or f"below {limit:.2f} ({self.factor:g} × {standing:.2f} − {self.margin:g})"
        )


@dataclass(frozen=True)
class SearchReport:
    """What a search tried in a frame, and what came of it."""

    search: Search
    frame: int
    why: str
    """why it was made in this frame"""
    rounds: Tried
    standing: float
    """cost of the pose that stood; NaN without one"""
    winner: Trial | None
    """None: nothing was taken"""

    def lines(self) -> Iterator[str]:
        """Yield the report in words: what was tried, what it cost, why the winner won."""
        yield f"- {self.search.situation} ({self.why})"
        stands = np.isfinite(self.standing)
        standing = f"standing pose: {self.standing:.2f}, by" if stands else "compared by"
        yield f"  {standing} {self.search.measure}"
        for number, (proposed, trials) in enumerate(self.rounds, start=1):
            yield f"  round {number}: {proposed} proposed, {len(trials)} fitted: {_grouped(trials)}"
        if self.winner is None:
            nothing = "better was found; the standing pose stays" if stands else "was taken"
            yield f"  nothing {nothing}"
            return
        origin, cost = self.winner
        yield f"  taken: {origin} at {cost:.2f}, {self.search.why_taken(self.standing)}"


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
