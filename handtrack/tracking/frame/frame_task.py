"""One frame to be solved: what was seen, where the hand is expected, and what tracking carries from the frames before; and its result,
from solved parameters.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, P, S, array_dataclass
from handtrack.geometry.rotation import (
    closest_equivalent,
    rotation_matrix,
    rotation_vector,
    wrapped,
)
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.pose_changes import change
from handtrack.observation.observation import Observation
from handtrack.solver.covariance import inherited_information, uncertainty, with_lasting_errors
from handtrack.solver.levenberg_marquardt import SolveSummary
from handtrack.solver.problem import Problem
from handtrack.terms.priors import GaussianPrior
from handtrack.terms.term import JointSystem
from handtrack.tracking.frame.confidence import assessed_as, frame_confidence
from handtrack.tracking.frame.constants import POINTS_LAST
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.descent import stage_problem
from handtrack.tracking.frame.frame_terms import FrameTerms, at_camera_times, frame_terms
from handtrack.tracking.frame.motion_belief import MotionBelief
from handtrack.tracking.frame.reason import Reason
from handtrack.tracking.frame.result import FrameResult, Status, Step
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.frame.terms.appearance_terms import Before
from handtrack.tracking.frame.terms.forearm import aimed_forearm

REMEMBERED = 30
"""results that a step may look back on"""


@array_dataclass
class TrackerState:
    """Immutable: a state may be stepped from again, with other settings or another observation."""

    start: Floats[P] | None = None
    """where the first frame begins"""
    results: tuple[FrameResult, ...] = ()
    """the latest last, in the order of tracking; they predict, and tell what is usual and how long the hand is lost"""
    belief: Floats[P, P] | None = None
    """covariance of the latest pose that was not lost; None where nothing is said of it"""
    beliefs: tuple[MotionBelief, ...] = ()
    """how the last result's alternatives move, where `tracker.hypotheses` is above 1"""
    texture: Before | None = None
    """images of the latest frame that was not lost and the model in it, where images are looked at"""

    @classmethod
    def beginning_at(cls, start: Floats[P]) -> TrackerState:
        """Return the state before a first frame, whose pose is about `start`, solver parameters."""
        return cls(start=start)

    @classmethod
    def resumed(cls, results: Iterable[FrameResult]) -> TrackerState:
        """Return a state after results that were read back, in the order of tracking.

        Poses go on as they would have; only how sure the last one was is not saved, nor hypotheses and texture.
        """
        return cls(results=tuple(results)[-REMEMBERED:])

    @classmethod
    def after_steps(cls, steps: Sequence[Step], texture: Before | None = None) -> TrackerState:
        """Return the state after steps in the order of tracking, at least one; texture: of those it was."""
        results = tuple(step.result for step in steps[-REMEMBERED:])
        return cls(None, results, steps[-1].belief, steps[-1].beliefs, texture)

    @property
    def step(self) -> Step:
        """The latest frame, as `after_steps` takes it. There is one."""
        return Step(self.results[-1], self.belief, self.beliefs)

    @property
    def last(self) -> FrameResult | None:
        return self.results[-1] if self.results else None

    def after(self, solved: Step, texture: Before | None = None) -> TrackerState:
        """Return the state once a frame is solved. A lost frame changes neither belief nor texture."""
        results = (*self.results, solved.result)[-REMEMBERED:]
        is_lost = solved.result.status == Status.LOST
        if is_lost and self.results:
            texture = self.texture
        elif texture is not None and self.texture is not None:
            texture = replace(texture, first=self.texture.first or self.texture)
        belief = self.belief if is_lost else solved.belief
        return TrackerState(None, results, belief, solved.beliefs, texture)


_SPAN = 4  # frames; an older motion says nothing about the next one


def predict(
    model: ArticulatedModel, previous: Sequence[FrameResult], frame: int
) -> Floats[S] | None:
    """Return joint parameters at `frame` if the last two frames' motion goes on, or None.

    The wrist's place and all angles go on linearly, the hand's turn as a constant rotation. Needs two
    frames with a pose, not more than a few frames apart (either direction of time).
    """
    posed = [result for result in previous if result.status != Status.LOST]
    if len(posed) < 2:
        return posed[-1].parameters.copy() if posed else None
    before, last = posed[-2], posed[-1]
    gap, ahead = last.frame - before.frame, frame - last.frame
    if gap == 0 or ahead * gap <= 0 or abs(gap) > _SPAN or abs(ahead) > _SPAN:
        return last.parameters.copy()
    share = ahead / gap
    expected = last.parameters + share * (last.parameters - before.parameters)
    turn_before, turn = rotation_matrix(np.stack([before.parameters[3:6], last.parameters[3:6]]))
    turned = rotation_matrix(share * rotation_vector(turn @ turn_before.T)) @ turn
    expected[3:6] = rotation_vector(turned)
    limits = model.limits.bounds(expected)
    return np.clip(expected, limits[:, 0], limits[:, 1])


@array_dataclass
class FrameTask:
    """One frame to be solved, and all that is known before."""

    model: ArticulatedModel
    settings: TrackerSettings
    observation: Observation
    start: Floats[P]
    """where to begin, within limits"""
    state: TrackerState = TrackerState()
    """what is known of the frames before. Of none: `start` is a first pose"""
    expected: Floats[S] | None = None
    """predicted joint parameters"""
    control: Control = Control()

    @property
    def previous(self) -> tuple[FrameResult, ...]:
        """Results in the order of tracking; they tell what is usual."""
        return self.state.results

    @property
    def ahead(self) -> int:
        """How many frames after the last one."""
        return abs(self.observation.frame - self.previous[-1].frame) if self.previous else 1

    def terms(self, params: Floats[P]) -> FrameTerms:
        """Return what the frame costs, seen from solver parameters."""
        model, expected, bones = self.model, self.expected, self.model.bones(params)
        if expected is not None:
            expected = expected.copy()
            expected[3:6] = closest_equivalent(expected[3:6], model.joint_params(self.start)[3:6])
        terms = frame_terms(
            model,
            self.settings,
            self.observation,
            bones,
            expected,
            self.ahead,
            self.state.texture,
        )
        later = self.observation.later
        if not self.previous or expected is None or not any(later.values()):
            return terms
        last = self.previous[-1]
        ends = (model.solver_params(x) for x in (last.parameters, expected))
        velocity = change(*ends) / (self.observation.frame - last.frame)
        return at_camera_times(terms, later, params, velocity)

    def opened(self) -> tuple[Floats[P], FrameTerms]:
        """Return where to begin and the frame's terms there; the forearm of a first pose is aimed first."""
        params, terms = self.start, self.terms(self.start)
        if terms.has_observations and not self.previous and self.model.has_forearm:
            params = aimed_forearm(stage_problem(terms, params, 0), params)
            terms = self.terms(params)
        return params, terms

    def unseen(self) -> Step:
        """Return a frame in which nothing was seen: what moved on unseen is not known, the last estimate is held. A first frame of images is
        only to be compared with those after it, at the given pose.
        """
        seen, cloud, params = self.observation, self.settings.cloud, self.start
        if self.previous:
            params = self.model.solver_params(self.previous[-1].parameters)
        if seen.images and not self.previous:
            status, reason = Status.DOUBTFUL, Reason("given")
        elif seen.cloud is not None and cloud.weight > 0:
            status, reason = Status.LOST, Reason("cloud elsewhere", number=cloud.crop_mm)
        else:
            status, reason = Status.LOST, Reason("unseen")
        return Step(assessed_as(posed_result(self.model, seen, params), status, reason))

    def solved(
        self,
        terms: FrameTerms,
        found: SolveSummary,
        problem: Problem,
        exact: tuple[Problem, JointSystem] | None = None,
    ) -> Step:
        """Return the frame's result where descent ended, with its uncertainty and status.

        Parameters
        ----------
        problem
            The last stage's, whose cost is the energy.
        exact
            The problem and its system there with the cloud taken as exactly as it lies, where that is sharper.
        """
        params, model = found.params.copy(), self.model
        sharp, known = exact or (problem, found.system)
        priors = Problem(model, (), sharp.parameter_terms).linearize(params)
        sure = inheriting_uncertainty(sharp, params, known.hessian, self.state.belief)
        covariance, std, joints = uncertainty(model, params, sure, known.hessian - priors.hessian)
        energies, cost = problem.costs(params), found.system.cost
        result = replace(
            posed_result(model, self.observation, params, std=std),
            joint_covariance=joints,
            energy=cost,
            energies=energies,
            iterations=found.iterations,
            views=terms.views,
        )
        return Step(frame_confidence(result, terms, params, cost, self.previous), covariance)


def inheriting_uncertainty(
    problem: Problem, params: Floats[P], hessian: Floats[P, P], belief: Floats[P, P] | None
) -> Floats[P, P]:
    """Return a frame's matrix in which the prediction is no surer than the pose that it came from.

    What is stated must not take it so: a finger hidden for a second would be called as well known
    as after one frame. Nor are a detector's errors new in each frame. A mixture's prediction
    inherits by itself. The live pass alone needs it, which knows no frame after: refined ones state
    what all frames say together.

    Parameters
    ----------
    hessian
        The one that poses are found with, which takes that pose for the truth.
    belief
        Its covariance, None where nothing is said of it.
    """
    terms = problem.parameter_terms
    motion = [t for t in terms if t.name == "motion" and isinstance(t, GaussianPrior)]
    told = Problem(problem.model, (), motion).linearize(params).hessian
    memory = inherited_information(told, belief)
    sure = hessian - told + memory
    seen = [t for t in problem.observation_terms if t.is_detected]
    if not seen or not motion:
        return sure
    points = Problem(problem.model, seen).linearize(params).hessian
    return with_lasting_errors(sure, memory, points, POINTS_LAST)


def posed_result(
    model: ArticulatedModel,
    observation: Observation | FrameResult,
    params: Floats[P],
    status: Status = Status.TRACKED,
    std: Floats[S] | None = None,
) -> FrameResult:
    """Return a result at solver parameters, as long as no solver tells its cost.

    Parameters
    ----------
    observation
        The frame's, or an earlier result: number and time are its.
    std
        Of joint parameters. Without it they may be anything; joints are known to a metre.
    """
    joint = model.joint_params(params)
    joint[3:6] = wrapped(joint[3:6])
    bones = model.bones(params)
    return FrameResult(
        frame=observation.frame,
        time_s=observation.time_s,
        parameters=joint,
        status=status,
        energy=float("nan"),
        iterations=0,
        parameter_std=np.full(len(joint), np.inf) if std is None else std,
        joint_covariance=np.tile(np.eye(3), (len(model.joint_names), 1, 1)),
        T_world_bone=bones.T_world_bone,
        joint_positions=model.joint_positions(bones),
        keypoints21=model.keypoints21(bones) if model.has_keypoints21 else None,
    )
