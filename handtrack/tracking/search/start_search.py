"""Poses let go of in what was seen of one frame, with arms that get shorter, and what they cost beside each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats
from handtrack.observation.observation import Observation
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.priors import GaussianPrior
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.posture import posture_prior
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.evidence.cloud_start import cloud_start
from handtrack.tracking.search.evidence.silhouette_start import silhouette_start
from handtrack.tracking.search.evidence.start_shapes import palm_middle
from handtrack.tracking.search.finger_assignments import finger_assignments
from handtrack.tracking.search.laid_shapes import PLACE_M, Laid, StartSource

WIDE_M, NARROW_M = 0.012, 0.004
_SAME_M = 0.012  # mean distance between joints of poses that count as one
_PROMISING = 3.0  # times the least cost, beyond which another place is not worth a look
_REST_SIGMA = np.deg2rad(50.0)


def start_sources(seen: Observation, settings: TrackerSettings) -> list[StartSource]:
    """Return what a frame's cloud and silhouettes say about where a hand may be."""
    sources: list[StartSource] = []
    if seen.cloud is not None and settings.cloud.weight > 0:
        cloud = cloud_start(seen.cloud.points, seen.cloud_views)
        if cloud is not None:
            sources.append(cloud)
    if seen.silhouettes and settings.silhouettes.weight > 0:
        outlines = silhouette_start(seen.silhouettes)
        if outlines is not None:
            sources.append(outlines)
    return sources


def descended_in_rounds(
    sources: Sequence[StartSource],
    found: Sequence[Laid],
    rounds: Sequence[tuple[int, int]],
    should_stop: Callable[[], bool],
) -> list[Laid]:
    """Return the poses after rounds of descent, each with how many of the best enter it, and its iterations."""
    for most, iterations in rounds:
        found = [
            descended(sources, h, iterations) for h in distinct(found, most) if not should_stop()
        ]
    return list(found)


def descended(sources: Sequence[StartSource], laid: Laid, iterations: int) -> Laid:
    """Return a pose let go of, with wide arms, and its cost there."""
    summary = solve(
        problem_around(sources, laid, WIDE_M), laid.params, SolverSettings(iterations=iterations)
    )
    there = replace(laid, params=summary.params)
    return replace(there, cost=problem_around(sources, there, WIDE_M).cost(there.params))


def narrowed(sources: Sequence[StartSource], laid: Laid, iterations: int) -> Laid:
    """Return a pose let go of once more, with short arms, and its cost there: long ones hardly tell what is on its finger
    from what is beside it.
    """
    problem = narrow_problem(sources, laid)
    summary = solve(problem, laid.params, SolverSettings(iterations=iterations))
    return narrowly_measured(sources, replace(laid, params=summary.params))


def reassigned(sources: Sequence[StartSource], found: Sequence[Laid], most: int) -> list[Laid]:
    """Return the most promising of the poses with fingers stretched or bent otherwise, of each pose two ways."""
    ways = []
    for laid in found:
        problem = problem_around(sources, laid, WIDE_M)
        others = finger_assignments(laid.shape.model, laid.params)
        tried = [replace(laid, params=params, cost=problem.cost(params)) for params in others]
        ways += sorted(tried, key=lambda laid: laid.cost)[:2]
    return distinct(ways, most)


def narrowly_measured(sources: Sequence[StartSource], laid: Laid) -> Laid:
    """Return a pose with the cost by which finished ones are told apart: short arms, the same for all."""
    return replace(laid, cost=narrow_problem(sources, laid).cost(laid.params))


def narrow_problem(sources: Sequence[StartSource], laid: Laid) -> Problem:
    """Return the problem around a pose by which finished ones are told apart."""
    return problem_around(sources, laid, NARROW_M)


def problem_around(sources: Sequence[StartSource], laid: Laid, band_m: float) -> Problem:
    """Return the problem around a pose in which what was seen pulls from about band_m [m]."""
    model = laid.shape.model
    terms = [t for source in sources for t in source.terms(laid.shape, laid.params, band_m)]
    sigma = np.full(len(model.parameter_names), _REST_SIGMA)
    sigma[:6] = np.inf
    priors: list[ParameterTerm] = [GaussianPrior(model.rest, sigma, "rest")]
    together = posture_prior(model, 1.0)
    if together is not None:
        priors.append(together)
    return Problem(model, terms, priors)


def distinct(found: Sequence[Laid], most: int) -> list[Laid]:
    """Return the best, at most `most`, each pose once.

    No place takes more than half of them while another is promising: the end of an arm fits a fist in many variants,
    each a little better than the hand, whose fingers are not in place yet.
    """
    chosen: list[tuple[Laid, Floats]] = []
    spare: list[tuple[Laid, Floats]] = []
    palms: list[Floats] = []  # of those chosen
    ordered = sorted(found, key=lambda laid: laid.cost)
    for laid in ordered:
        joints = laid.joints
        if any(np.linalg.norm(joints - j, axis=1).mean() <= _SAME_M for _, j in [*chosen, *spare]):
            continue
        palm = palm_middle(laid.shape.model, laid.params)
        here = sum(np.linalg.norm(palm - other) < PLACE_M for other in palms)
        if 2 * here < most and laid.cost <= _PROMISING * ordered[0].cost:
            chosen.append((laid, joints))
            palms.append(palm)
        else:
            spare.append((laid, joints))
        if len(chosen) == most:
            break
    kept = [laid for laid, _ in [*chosen, *spare]][:most]
    return sorted(kept, key=lambda laid: laid.cost)
