"""The search engine: proposers put candidates in, rounds thin and fit them, the better pose is taken.

What is tried when stands in `policy`; how one frame's candidates are proposed, fitted and compared is its landscape's affair.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

from handtrack.arrays import D3, D21, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.frame_result import Solved
from handtrack.tracking.search.evidence.hand_shapes import HandShape


@dataclass(frozen=True, eq=False)
class Candidate:
    """A pose that may be the frame's."""

    model: ArticulatedModel
    params: Floats[P]
    """solver parameters"""
    cost: float = np.inf
    """how badly it explains what was seen; comparable within a round"""
    origin: str = "given"
    """which proposer it comes from"""
    shape: HandShape | None = None
    """the rigid shape that it started from, in a search by evidence"""
    solved: Solved | None = None
    """the frame's result there, once it was fitted as the tracker fits"""
    normal: Floats[P, P] | None = None
    """Gauss-Newton matrix of its cost, where the fit gives one"""

    @property
    def joints(self) -> Floats[D21, D3]:
        """Its joints, world [m]"""
        return self.model.keypoints21(self.model.bones(self.params))


C = TypeVar("C", bound=Candidate)


@dataclass(frozen=True)
class Propose:
    """One way to come by candidates."""

    name: str
    """a proposer that the landscape knows"""
    most: int = 0
    """how many it proposes at most; 0: as many as there are"""


@dataclass(frozen=True)
class Fit:
    """One way to improve a candidate."""

    kind: str
    """a name that the landscape knows"""
    iterations: int = 0
    """of the solver; 0: as many as the kind has by itself"""


@dataclass(frozen=True)
class Round:
    """One round of a search: who joins, how many are fitted, and how."""

    propose: tuple[Propose, ...] = ()
    keep: int | None = None
    """how many of those found so far stay beside the proposed; None: all"""
    enter: int | None = None
    """the best distinct ones that are fitted; None: all, in their order"""
    fits: tuple[Fit, ...] = ()
    adds: bool = False
    """only what is newly proposed is fitted, and joins those that stand"""
    times: int = 1
    """how often it is made at most: again while it finds what is better, as the search counts it, than all before"""


@dataclass(frozen=True)
class Search:
    """A row of the policy: a situation and what is tried in it."""

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

    def is_better(self, cost: float, standing: float) -> bool:
        """Return whether a candidate of that cost is taken instead of the standing pose."""
        return cost < self.factor * standing - self.margin


class Landscape(Protocol[C]):
    """One frame, as a search sees it."""

    def propose(self, proposer: str, found: Sequence[C], most: int) -> list[C]:
        """Return a proposer's candidates, given those found so far; `most` as in the round."""
        ...

    def fit(self, fit: Fit, candidates: Sequence[C], control: Control) -> list[C]:
        """Return candidates improved, each with its new cost; fewer when stopped."""
        ...

    def distinct(self, candidates: Sequence[C], most: int) -> list[C]:
        """Return the best, at most so many, each pose once, by rising cost."""
        ...


@dataclass(frozen=True)
class Trial:
    """What became of one candidate in a round."""

    origin: str
    cost: float

    @classmethod
    def of(cls, candidate: Candidate) -> Trial:
        return cls(candidate.origin, candidate.cost)


Tried = list[tuple[int, tuple[Trial, ...]]]
"""of each round how many were proposed, and those fitted"""


@dataclass(frozen=True)
class SearchReport:
    """What a search tried in a frame, and what came of it."""

    frame: int
    search: Search
    why: str
    """why it was made in this frame"""
    rounds: Tried
    standing: float
    """cost of the pose that stood; NaN without one"""
    winner: Trial | None
    """None: nothing was taken"""


def tell(
    search: Search,
    control: Control,
    frame: int,
    why: str,
    tried: Tried,
    winner: Candidate | None,
    standing: float = np.nan,
) -> None:
    """Report a search that was made, if anybody listens."""
    if control.on_search is not None:
        best = None if winner is None else Trial.of(winner)
        control.on_search(SearchReport(frame, search, why, tried, standing, best))


def run_rounds(
    search: Search,
    landscape: Landscape[C],
    found: Sequence[C],
    control: Control,
    on_round: Callable[[int, int], None] | None = None,
    tried: Tried | None = None,
) -> list[C]:
    """Return what is found after all rounds.

    on_round: called before each round's fits with its number and how many are fitted. tried: gathers what was tried, for a
    report.
    """
    found = list(found)
    for number, step in enumerate(search.rounds):
        for _ in range(step.times):
            proposed = [c for p in step.propose for c in landscape.propose(p.name, found, p.most)]
            kept = found if step.keep is None else landscape.distinct(found, step.keep)
            entering = proposed if step.adds else [*kept, *proposed]
            if step.enter is not None:
                entering = landscape.distinct(entering, step.enter)
            if on_round is not None:
                on_round(number, len(entering))
            for fit in step.fits:
                entering = landscape.fit(fit, entering, control)
            if tried is not None:
                tried.append((len(proposed), tuple(map(Trial.of, entering))))
            before, now = _least(found), _least(entering)
            found = [*found, *entering] if step.adds else entering
            if not search.is_better(now, before):
                break
    return found


def improved(
    search: Search,
    landscape: Landscape[C],
    standing: C,
    control: Control,
    frame: int,
    why: str,
    compared: Callable[[Sequence[C]], list[C]] = list,
) -> C:
    """Return the best candidate that is better than the standing one, or that one itself. Reports what was tried.

    compared: measures them by the same pixels, where their costs are not.
    """
    for _ in range(search.repeats):
        tried: Tried = []
        found = run_rounds(search, landscape, [standing], control, tried=tried)
        if control.should_stop():
            return standing
        standing, *found = compared([standing, *found])
        best = min(found, key=lambda c: c.cost, default=standing)
        taken = search.is_better(best.cost, standing.cost)
        tell(search, control, frame, why, tried, best if taken else None, standing.cost)
        if not taken:
            return standing
        standing = best
    return standing


def _least(candidates: Sequence[Candidate]) -> float:
    return min((c.cost for c in candidates), default=np.inf)
