"""The search engine: proposers add candidates, rounds thin and fit them, the better pose is taken.

A policy (`Search`) lists functions: what proposes, and what fits. Policies stand beside the functions that they name; `SEARCHES` in
docs/searches.py lists them all. An objective is one frame as a search sees it: what its functions read.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps
from typing import Any, Protocol, TypeVar

import numpy as np

from handtrack.arrays import D3, D21, Floats, P, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.parallel import in_parallel
from handtrack.sampling.suppression import MERGED_RAD, distinct
from handtrack.tracking.frame.control import Control, Search, SearchReport, Tried
from handtrack.tracking.frame.result import FrameResult, Step
from handtrack.tracking.search.scores import HandShape


@array_dataclass
class Candidate:
    """A pose that may be the frame's, with its cost."""

    model: ArticulatedModel
    params: Floats[P]
    """solver parameters"""
    cost: float = np.inf
    """negative log-likelihood, or another misfit; comparable within a round"""
    origin: str = "given"
    """which proposer it comes from"""
    shape: HandShape | None = None
    """the rigid shape that it started from, in a search by silhouettes and clouds"""
    solved: Step | None = None
    """the frame's result there, once it was fitted as the tracker fits"""
    normal: Floats[P, P] | None = None
    """Gauss-Newton matrix of its cost, where the fit gives one"""
    confidence: float = 0.0
    """probability that its joints are within 12 mm of the true ones on average, among the poses of a frame; 0: not assessed"""
    p_in_basin: float = 1.0
    """that probability if it is the right one of these poses"""

    @property
    def result(self) -> FrameResult:
        """The frame's result there, once it was fitted as the tracker fits."""
        assert self.solved is not None
        return self.solved.result

    @property
    def rigid(self) -> HandShape:
        """The rigid shape that it started from, in a search by silhouettes and clouds."""
        assert self.shape is not None
        return self.shape

    @property
    def joints(self) -> Floats[D21, D3]:
        """Its joints, world [m]"""
        return self.model.keypoints21(self.model.bones(self.params))


C = TypeVar("C", bound=Candidate)


class Objective(Protocol[C]):
    """One frame, as a search sees it: it keeps candidates apart; the functions of a policy know the rest of it."""

    @property
    def control(self) -> Control: ...

    def distinct(self, candidates: Sequence[C], most: int) -> list[C]:
        """Return the best, at most so many, each pose once, by rising cost."""
        ...


def differing(candidates: Sequence[C], most: int, least_rad: float = MERGED_RAD) -> list[C]:
    """Return the best, at most so many, by rising cost: none whose angles are nearer to a better one's, root mean square."""
    params = np.array([c.params for c in candidates])
    rows = distinct(params, np.array([c.cost for c in candidates]), least_rad)
    return [candidates[row] for row in rows[:most]]


def each(fit: Callable[[Any, C, int], C]) -> Callable[[Any, Sequence[C], int], list[C]]:
    """Return a fitter of one candidate after the other, on all cores, until it is stopped."""

    @wraps(fit)
    def fitted(objective: Any, candidates: Sequence[C], iterations: int) -> list[C]:
        stop = objective.control.should_stop
        found = in_parallel(lambda c: None if stop() else fit(objective, c, iterations), candidates)
        return [c for c in found if c is not None]

    return fitted


def run_rounds(
    search: Search,
    objective: Objective[C],
    candidates: Sequence[C],
    on_round: Callable[[int, int], None] | None = None,
    tried: Tried | None = None,
) -> list[C]:
    """Return the candidates after all rounds.

    Parameters
    ----------
    candidates
        What the first round begins with.
    on_round
        Called before each round's fits with its number and how many are fitted.
    tried
        Gathers what was tried, for a report.
    """
    found = list(candidates)
    for number, step in enumerate(search.rounds):
        for _ in range(step.times):
            proposed = [
                c for propose, most in step.propose for c in propose(objective, found, most)
            ]
            kept = found if step.keep is None else objective.distinct(found, step.keep)
            entering = proposed if step.adds else [*kept, *proposed]
            if step.enter is not None:
                entering = objective.distinct(entering, step.enter)
            if on_round is not None:
                on_round(number, len(entering))
            for fit, iterations in step.fits:
                entering = fit(objective, entering, iterations)
            if tried is not None:
                tried.append((len(proposed), tuple((c.origin, c.cost) for c in entering)))
            before, now = (min((c.cost for c in row), default=np.inf) for row in (found, entering))
            found = [*found, *entering] if step.adds else entering
            if not search.is_better(now, before):
                break
    return found


def improved(
    search: Search,
    objective: Objective[C],
    standing: C,
    frame: int,
    why: str,
    compared: Callable[[Sequence[C]], list[C]] = list,
) -> C:
    """Return the best candidate that is better than the standing one, or that one itself.

    Reports what was tried.

    Parameters
    ----------
    compared
        Measures them by the same pixels, where their costs are not.
    """
    control = objective.control
    for _ in range(search.repeats):
        tried: Tried = []
        found = run_rounds(search, objective, [standing], tried=tried)
        if control.should_stop():
            return standing
        standing, *found = compared([standing, *found])
        best = min(found, key=lambda c: c.cost, default=standing)
        taken = search.is_better(best.cost, standing.cost)
        report(search, control, frame, why, tried, best if taken else None, standing.cost)
        if not taken:
            return standing
        standing = best
    return standing


def report(
    search: Search,
    control: Control,
    frame: int,
    why: str,
    tried: Tried,
    winner: Candidate | None,
    standing: float = np.nan,
) -> None:
    """Report a search that was made."""
    best = None if winner is None else (winner.origin, winner.cost)
    control.observer.search(SearchReport(search, frame, why, tried, standing, best))
