"""From solved parameters to a frame's result: uncertainty, status and reason, the skeleton posed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P, S, array_dataclass
from handtrack.geometry.rotation import wrapped
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.solver.covariance import uncertainty
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.frame.confidence import FrameConfidence, frame_confidence
from handtrack.tracking.frame.descent import Descended
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.frame.prediction import inheriting_uncertainty
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import FrameResult, Status


@array_dataclass
class Solved:
    """A frame's result, and what only the next frame's prediction needs of it."""

    result: FrameResult
    covariance: Floats[P, P] | None = None
    """of the solver parameters; None where nothing is said of them"""
    search_due: bool = False
    """a search would have been made, had it been allowed (`Control.searches`)"""


def solved_result(
    observation: Observation,
    terms: FrameTerms,
    found: Descended,
    previous: Sequence[FrameResult] = (),
    belief: Floats[P, P] | None = None,
    exact: tuple[Problem, JointSystem] | None = None,
) -> Solved:
    """Return a frame's result where descent ended, with its uncertainty and status.

    Parameters
    ----------
    found
        By the last stage's problem, whose cost is the energy.
    previous
        Results that tell what is usual.
    belief
        Covariance of the last frame's pose.
    exact
        The problem and its system there with the cloud taken as exactly as it lies, where that is sharper.
    """
    params, model = found.params.copy(), terms.model
    problem, known = exact or (found.problem, found.system)
    priors = Problem(model, (), problem.parameter_terms).linearize(params)
    sure = inheriting_uncertainty(problem, params, known.hessian, belief)
    covariance, std, joints = uncertainty(model, params, sure, known.hessian - priors.hessian)
    energies, cost = found.problem.costs(params), found.system.cost
    judgement = frame_confidence(terms, params, cost, energies, joints, previous)
    result = replace(
        posed_result(model, observation, params, judgement, std),
        energy=cost,
        energies=energies,
        iterations=found.iterations,
        views=terms.views,
    )
    return Solved(result, covariance)


def unseen_result(terms: FrameTerms, observation: Observation, params: Floats[P]) -> FrameResult:
    """Return a frame in which nothing was seen: lost, at the pose that is handed in."""
    cloud = terms.settings.cloud
    elsewhere = observation.cloud is not None and cloud.weight > 0
    reason = Reason("cloud elsewhere", number=cloud.crop_mm) if elsewhere else Reason("unseen")
    return posed_result(terms.model, observation, params, FrameConfidence(Status.LOST, reason))


def manual_result(terms: FrameTerms, observation: Observation, params: Floats[P]) -> FrameResult:
    """Return a first frame that is only to be compared with those after it, at the given pose."""
    judgement = FrameConfidence(Status.DOUBTFUL, Reason("given"))
    return posed_result(terms.model, observation, params, judgement)


def posed_result(
    model: ArticulatedModel,
    observation: Observation,
    params: Floats[P],
    found: FrameConfidence,
    std: Floats[S] | None = None,
) -> FrameResult:
    """Return a result at solver parameters as it was judged, as long as no solver tells its cost.

    std: of joint parameters. Without it, and of a lost hand, they may be anything; without a covariance joints are known to a metre.
    """
    joint = model.joint_params(params)
    joint[3:6] = wrapped(joint[3:6])
    if std is None or found.status == Status.LOST:
        std = np.full(len(joint), np.inf)
    covariance = found.joint_covariance
    if covariance is None:
        covariance = np.tile(np.eye(3), (len(model.joint_names), 1, 1))
    bones = model.bones(params)
    return FrameResult(
        frame=observation.frame,
        time_s=observation.time_s,
        parameters=joint,
        status=found.status,
        energy=float("nan"),
        iterations=0,
        parameter_std=std,
        joint_covariance=covariance,
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
        reason=found.reason,
        p_off_25mm=found.p_off_25mm,
        p_off_10mm=found.p_off_10mm,
    )
