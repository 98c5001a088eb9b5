"""Recovery: a hand that was lost is looked for again, near where it was last, and taken only if energy agrees."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.tracking.frame.assessment import assess
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import FrameResult, Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.evidence.start_shapes import palm_middle, shape_of, start_shapes
from handtrack.tracking.search.finger_flips import finger_flips
from handtrack.tracking.search.laid_shapes import Laid, StartSource, laid_everywhere
from handtrack.tracking.search.start_search import (
    descended_in_rounds,
    distinct,
    narrowly_measured,
    start_sources,
)

_ROUNDS = ((60, 8), (10, 12))
_LAID = 28  # hands that are let go of around the last known place
_FINALISTS = 3
_AGAIN = 5  # frames between two looks in a row where nothing was seen
# how far a palm may be from where it was, and how much further each frame
_NEAR_M, _SPEED_M = (0.10, 0.03)
_GAIN = 0.95  # of the cost that a pose may have at most, to be taken


def worth_restarting(result: FrameResult, previous: Sequence[FrameResult]) -> bool:
    """Return whether a frame that was just solved should be looked at for another pose.

    When it does not fit; of several such frames in a row the first, second, fourth, eighth …: what was not found
    in one of them is rarely found in the next. Frames in which nothing was seen do not count, unless this is one (there
    may be a cloud, but far from where the hand was expected): then every fifth is looked at as well.
    """
    if result.fits or not previous:
        return False
    unseen, row = not np.isfinite(result.energy), 1
    for before in reversed(previous):
        if before.fits or not (unseen or np.isfinite(before.energy)):
            break
        row += 1
    return row & (row - 1) == 0 or (unseen and row % _AGAIN == 0)


def recovered(
    model: ArticulatedModel,
    settings: TrackerSettings,
    seen: Observation,
    result: FrameResult,
    previous: Sequence[FrameResult],
    solved: Callable[[Floats], FrameResult],
    should_stop: Callable[[], bool] | None = None,
) -> FrameResult:
    """Return a frame's result, or another one that fits what was seen clearly better, where the first is in doubt.

    solved: solves the frame as the tracker does, from solver parameters (P,), by what is seen alone. Tries hands laid
    around the last known place, and fingers flipped forwards and backwards along the lines of sight.
    """
    if not worth_restarting(result, previous) or not model.has_keypoints21:
        return result
    if result.poor_cloud:  # among wrong points another hand often fits better
        return result
    sources = start_sources(seen, settings)
    if not sources:
        return result
    stop = should_stop or (lambda: False)
    here = shape_of(model, result.parameters, "last")
    params = model.transform.solver_params(result.parameters)
    standing = narrowly_measured(sources, Laid(here, params, np.inf))
    lost = result.status == Status.LOST
    found = _starts(sources, model, seen, standing, previous, lost, stop)
    best, cost = result, _GAIN * standing.cost
    for laid in distinct(descended_in_rounds(sources, found, _ROUNDS, stop), _FINALISTS):
        if stop():
            return result
        trial = solved(laid.params)
        there = replace(laid, params=model.transform.solver_params(trial.parameters))
        measured = narrowly_measured(sources, there)
        if measured.cost < cost:
            best, cost = trial, measured.cost
    return best if best is result else _judged(model, settings, seen, best, previous)


def _starts(
    sources: Sequence[StartSource],
    model: ArticulatedModel,
    seen: Observation,
    standing: Laid,
    previous: Sequence[FrameResult],
    lost: bool,
    stop: Callable[[], bool],
) -> list[Laid]:
    """Return where to begin: the pose that stands, its fingers flipped, and hands around where the hand was last.

    Of a lost hand nobody knows how far it went: it is looked for everywhere.
    """
    known = [r for r in previous if r.status != Status.LOST and np.isfinite(r.energy)]
    last = known[-1] if known else previous[-1]
    middle = palm_middle(model, model.transform.solver_params(last.parameters))
    far = np.inf if lost else _NEAR_M + _SPEED_M * abs(seen.frame - last.frame)
    shapes = [shape_of(model, last.parameters, "last"), *start_shapes(model)]
    found = laid_everywhere(sources, shapes, _LAID, stop, (middle, far))
    flips = finger_flips(model, seen, standing.params)
    starts = [*found, standing, *(replace(standing, params=flipped) for flipped in flips)]
    return [replace(laid, cost=0.0) for laid in starts]  # all of them descend


def _judged(
    model: ArticulatedModel,
    settings: TrackerSettings,
    seen: Observation,
    result: FrameResult,
    previous: Sequence[FrameResult],
) -> FrameResult:
    """Return a result with its status judged beside the frames before it."""
    bones = model.bones(model.transform.solver_params(result.parameters))
    terms = frame_terms(model, settings, seen, bones, None)
    status, note = assess(terms, bones, result.energy, previous)
    worse = status > result.status or (status != Status.TRACKED and result.unknown)
    return replace(result, status=status, note=note, unknown=False) if worse else result
