"""A pose that is pulled at: pins hold, and all else follows from the images, or changes least. And one that is fitted again."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Keypoints, Observation
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.collision import contact
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import GaussianPrior
from handtrack.tracking.frame.descent import descend, stage_problem
from handtrack.tracking.frame.frame_terms import frame_terms, pin_terms
from handtrack.tracking.frame.settings import TrackerSettings

_AT_ONCE = SolverSettings(iterations=12, damping=1e-3)
"""of one answer while somebody pulls: the next begins where it ends"""
_STAY_M = 0.02
"""a joint of a hand that moves so far costs as much as an angle that turns by `_STAY_RAD`; that makes a finger bend rather than
the hand go along. Both only say what changes least: pins outweigh them a thousandfold"""
_STAY_RAD = np.deg2rad(60.0)


def pulled(
    model: ArticulatedModel,
    settings: TrackerSettings,
    seen: Observation,
    params: Floats[P],
    by_images: bool = True,
    stood: Floats[P] | None = None,
) -> Floats[P]:
    """Return solver parameters, within limits, at which an observation's pins hold.

    Parameters
    ----------
    params
        Where the model stands.
    by_images
        What else was seen holds the rest, in the narrowest band and from where it stands, so that
        it follows a pull at once; otherwise the joints stay where they are at `stood` (params), as
        far as they can.
    """
    if by_images:
        terms = frame_terms(model, settings, seen, model.bones(params))
        problem = stage_problem(terms, params)
    else:
        problem = _least_change(model, settings, seen, params if stood is None else stood)
    return solve(problem, params, _AT_ONCE).params


def fitted_again(
    model: ArticulatedModel,
    settings: TrackerSettings,
    seen: Observation,
    params: Floats[P],
    should_stop: Callable[[], bool] | None = None,
) -> Floats[P] | None:
    """Return the solver parameters to which a frame's whole schedule, wide bands first, leads from params, pins held; None where
    nothing was seen, or it was stopped. It is what tracking does in a frame, but for its searches for other poses.
    """
    terms = frame_terms(model, settings, seen, model.bones(params))
    if not (terms.has_observations or seen.pins):
        return None
    summary, _ = descend(terms, params, should_stop)
    return None if summary.why == "stopped" else summary.params


def _least_change(
    model: ArticulatedModel, settings: TrackerSettings, seen: Observation, stood: Floats[P]
) -> Problem:
    joints = model.joint_positions(model.bones(stood))
    stay = KeypointTerm(model, Keypoints(tuple(model.joint_names), joints, _STAY_M))
    sigma = np.full(len(model.parameter_names), np.inf)
    sigma[6:] = _STAY_RAD
    as_it_was = GaussianPrior(model.joint_params(stood), sigma, "stay")
    parts = [contact(model)] if settings.prior.collision else []
    return Problem(model, [*pin_terms(model, seen), *parts, stay], [as_it_was])
