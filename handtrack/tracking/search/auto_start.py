"""The first frame without a first pose: hands laid everywhere, the best let go of, the rest told apart by energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.terms.keypoints import KeypointTerm
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.evidence.start_shapes import start_shapes
from handtrack.tracking.search.finger_assignments import finger_swaps
from handtrack.tracking.search.laid_shapes import Laid, StartSource, laid_everywhere
from handtrack.tracking.search.sized_start import Resize, sized
from handtrack.tracking.search.start_confidence import (
    SIZE_SIGMA,
    fit_quality,
    independent_errors,
    nearness,
    shares,
)
from handtrack.tracking.search.start_search import (
    descended,
    descended_in_rounds,
    distinct,
    narrow_problem,
    narrowed,
    narrowly_measured,
    reassigned,
    start_sources,
)
from handtrack.tracking.tracker import Tracker

_LAID, _AGAIN = 48, 12
"""how many laid hands are let go of; how many go on, and as many again with other fingers stretched"""
_ITERATIONS, _MORE, _NARROW = 10, 12, 8
"""of the descents: with long arms, of those that go on, and with short arms, by which finalists are chosen"""
FINALISTS = 5
"""poses that descend as the tracker does"""

Progress = Callable[[float, str], None]
"""called with the share that is done and what is being done"""


@dataclass(frozen=True, eq=False)
class StartCandidate:
    """A first pose that was found."""

    model: ArticulatedModel
    """with or without a forearm, as what is seen asks for"""
    result: FrameResult
    cost: float
    """of this pose beside the others': they are all measured by the same points and pixels"""
    confidence: float
    """0 to 1, that its joints are within 12 mm of the true ones on average; docs/automatic_start.md"""
    nearness: float
    """0 to 1, that they are if this is the right one of the poses that were found"""

    @property
    def params(self) -> Floats:
        """Solver parameters (P,) of its model."""
        return self.model.transform.solver_params(self.result.parameters)


def auto_start(
    models: Sequence[ArticulatedModel],
    settings: TrackerSettings,
    seen: Observation,
    should_stop: Callable[[], bool] | None = None,
    on_progress: Progress | None = None,
    size_sigma: float = SIZE_SIGMA,
    resize: Resize | None = None,
) -> list[StartCandidate]:
    """Return first poses for what was seen of one frame, the surest first; empty where no hand can be seen.

    models: those that may explain it, say without and with a forearm. size_sigma: the share to which their size is
    known. resize: makes them in other sizes, where it is not; the best poses then find theirs. Looks everywhere: nothing is assumed of place, turn and posture but that the hand is rather open than closed.
    """
    tell = on_progress or (lambda share, text: None)
    stop = should_stop or (lambda: False)
    tell(0.0, "looking for the hand")
    sources = start_sources(seen, settings)
    if not sources:
        return []
    shapes = [shape for model in models for shape in start_shapes(model)]
    found = laid_everywhere(sources, shapes, _LAID, stop)
    tell(0.4, f"{len(found)} poses are tried")
    found = descended_in_rounds(sources, found, ((_LAID, _ITERATIONS),), stop)
    found = [*distinct(found, _AGAIN), *reassigned(sources, distinct(found, _LAID), _AGAIN)]
    found = [descended(sources, laid, _MORE) for laid in found if not stop()]
    found = [narrowed(sources, h, _NARROW) for h in distinct(found, 2 * _AGAIN) if not stop()]
    tell(0.8, "the best are fitted")
    if resize is not None:
        sizes = [sized(sources, h, resize) for h in distinct(found, FINALISTS) if not stop()]
        found = [*found, *sizes]
    return finished(sources, distinct(found, FINALISTS), settings, seen, stop, size_sigma)


def finished(
    sources: Sequence[StartSource],
    found: Sequence[Laid],
    settings: TrackerSettings,
    seen: Observation,
    stop: Callable[[], bool],
    size_sigma: float = SIZE_SIGMA,
) -> list[StartCandidate]:
    """Return the poses fitted as the tracker fits, the best also with its fingers looked for, and how sure each is."""
    plain = settings.with_values({"tracker.escape": False, "tracker.hypotheses": 1})
    done = [_fitted(sources, laid, plain, seen, stop) for laid in found if not stop()]
    if not done:
        return []
    best, _ = min(done, key=lambda pair: pair[0].cost)
    if settings.tracker.escape and not stop():
        done.append(_fitted(sources, best, settings, seen, stop))
    best, _ = min(done, key=lambda pair: pair[0].cost)
    swaps = [replace(best, params=x) for x in finger_swaps(best.shape.model, best.params)]
    ends = [descended(sources, laid, _MORE) for laid in swaps if not stop()]
    done += [_fitted(sources, end, plain, seen, stop) for end in ends if not stop()]
    results = {id(laid): result for laid, result in done}
    kept = distinct([laid for laid, _ in done], FINALISTS)
    quality = fit_quality(kept[0].shape.model, settings, seen, kept[0].params)
    count = independent_errors(sources, kept[0])
    share = shares(np.array([laid.cost for laid in kept]), count)
    candidates = []
    for laid, part in zip(kept, share, strict=True):
        model, problem = laid.shape.model, narrow_problem(sources, laid)
        given = [KeypointTerm(model, joints) for joints in seen.keypoints]
        problem = replace(problem, observation_terms=[*problem.observation_terms, *given])
        near = nearness(problem, laid.params, count, size_sigma)
        sure = float(quality * part * near)
        candidates.append(StartCandidate(model, results[id(laid)], laid.cost, sure, near))
    return candidates


def _fitted(
    sources: Sequence[StartSource],
    laid: Laid,
    settings: TrackerSettings,
    seen: Observation,
    stop: Callable[[], bool],
) -> tuple[Laid, FrameResult]:
    model = laid.shape.model
    result = Tracker(model, settings).step(seen, (), laid.params, stop)
    there = replace(laid, params=model.transform.solver_params(result.parameters))
    return narrowly_measured(sources, there), result
