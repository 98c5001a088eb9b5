"""The first frame without a first pose: hands laid everywhere, the best let go of, the rest told apart by energy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.priors import GaussianPrior
from handtrack.terms.term import ObservationTerm, ParameterTerm
from handtrack.tracker.cloud_start import cloud_start
from handtrack.tracker.orientation_grid import spread_rotations, turned_by
from handtrack.tracker.posture import posture_prior
from handtrack.tracker.result import FrameResult
from handtrack.tracker.settings import TrackerSettings
from handtrack.tracker.start_shapes import StartShape, start_shapes
from handtrack.tracker.tracker import Tracker

_FEW_ROTATIONS, _ROTATIONS = 200, 1000
_MOST_LAID = 160_000
_KEPT_PLACES = 10
_APART_RAD, _APART_M = np.deg2rad(24.0), 0.03
_ROUNDS = ((48, 10), (16, 12), (5, 0))
"""how many hypotheses enter each round of descent, and the iterations in it; the last descend as the tracker does"""
_SAME_M = 0.012  # mean distance between joints of poses that count as one
_REST_SIGMA = np.deg2rad(50.0)


class StartSource(Protocol):
    """What one kind of observation says about where a hand may be."""

    @property
    def places(self) -> Floats: ...

    def scores(self, shape: StartShape, rotations: Floats, places: Floats) -> Floats: ...

    def terms(self, shape: StartShape, params: Floats) -> list[ObservationTerm]: ...


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A pose that may be the hand's."""

    shape: StartShape
    """where it started from"""
    params: Floats
    """(P,) solver parameters of the shape's model"""
    cost: float

    @property
    def joints(self) -> Floats:
        model = self.shape.model
        return model.joint_positions(model.bones(self.params))


@dataclass(frozen=True, eq=False)
class StartCandidate:
    """A first pose that was found."""

    model: ArticulatedModel
    """with or without a forearm, as what is seen asks for"""
    result: FrameResult
    cost: float


def auto_start(
    models: Sequence[ArticulatedModel],
    settings: TrackerSettings,
    seen: Observation,
    should_stop: Callable[[], bool] | None = None,
) -> list[StartCandidate]:
    """Return first poses for what was seen of one frame, the best first; empty where no hand can be seen."""
    sources = _sources(seen, settings)
    if not sources:
        return []
    found = _laid(sources, [shape for model in models for shape in start_shapes(model)])
    for kept, iterations in _ROUNDS[:-1]:
        found = _distinct(found, kept)
        found = [_descended(sources, h, iterations) for h in found]
    found = _distinct(found, _ROUNDS[-1][0])
    candidates = []
    for h in found:
        tracker = Tracker(h.shape.model, settings)
        result = tracker.step(seen, (), h.params, should_stop)
        params = h.shape.model.transform.solver_params(result.parameters)
        cost = _problem(sources, replace(h, params=params)).cost(params)
        candidates.append(StartCandidate(h.shape.model, result, cost))
    return sorted(candidates, key=lambda c: c.cost)


def _sources(seen: Observation, settings: TrackerSettings) -> list[StartSource]:
    sources: list[StartSource] = []
    if seen.cloud is not None and settings.cloud.weight > 0:
        cloud = cloud_start(seen.cloud.points, seen.cloud_views)
        if cloud is not None:
            sources.append(cloud)
    return sources


def _laid(sources: Sequence[StartSource], shapes: Sequence[StartShape]) -> list[Hypothesis]:
    """Return the shapes laid everywhere, the best first, none like a better one."""
    places = sources[0].places
    if len(places) > _KEPT_PLACES:
        few = spread_rotations(_FEW_ROTATIONS)
        least = np.min([_scores(sources, s, few, places).min(axis=0) for s in shapes], axis=0)
        places = places[np.argsort(least)[:_KEPT_PLACES]]
    many = max(_FEW_ROTATIONS, min(_ROTATIONS, _MOST_LAID // (len(places) * len(shapes))))
    rotations = spread_rotations(many)
    scores = np.stack([_scores(sources, s, rotations, places) for s in shapes])
    order = np.argsort(scores, axis=None)[: 40 * _ROUNDS[0][0]]
    chosen: list[tuple[int, int, int]] = []
    for s, r, p in zip(*np.unravel_index(order, scores.shape), strict=True):
        alike = [
            turned_by(rotations[r], rotations[q]) < _APART_RAD
            and np.linalg.norm(places[p] - places[o]) < _APART_M
            and shapes[s].posture == shapes[t].posture
            for t, q, o in chosen
        ]
        if not any(alike):
            chosen.append((int(s), int(r), int(p)))
        if len(chosen) == _ROUNDS[0][0]:
            break
    return [
        Hypothesis(shapes[s], shapes[s].params_at(rotations[r], places[p]), float(scores[s, r, p]))
        for s, r, p in chosen
    ]


def _scores(
    sources: Sequence[StartSource], shape: StartShape, rotations: Floats, places: Floats
) -> Floats:
    return np.sum([source.scores(shape, rotations, places) for source in sources], axis=0)


def _problem(sources: Sequence[StartSource], h: Hypothesis) -> Problem:
    model = h.shape.model
    terms = [term for source in sources for term in source.terms(h.shape, h.params)]
    sigma = np.full(len(model.parameter_names), _REST_SIGMA)
    sigma[:6] = np.inf
    priors: list[ParameterTerm] = [GaussianPrior(model.rest, sigma, "rest")]
    together = posture_prior(model, 1.0)
    if together is not None:
        priors.append(together)
    return Problem(model, terms, priors)


def _descended(sources: Sequence[StartSource], h: Hypothesis, iterations: int) -> Hypothesis:
    summary = solve(_problem(sources, h), h.params, SolverSettings(iterations=iterations))
    there = replace(h, params=summary.params)
    return replace(there, cost=_problem(sources, there).cost(there.params))


def _distinct(found: Sequence[Hypothesis], most: int) -> list[Hypothesis]:
    """Return the best, each pose once."""
    kept: list[tuple[Hypothesis, Floats]] = []
    for h in sorted(found, key=lambda h: h.cost):
        joints = h.joints
        if all(np.linalg.norm(joints - other, axis=1).mean() > _SAME_M for _, other in kept):
            kept.append((h, joints))
        if len(kept) == most:
            break
    return [h for h, _ in kept]
