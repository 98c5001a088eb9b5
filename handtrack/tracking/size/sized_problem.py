"""A person's size and the poses of several frames in one system: the poses are eliminated, the size is what is left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from handtrack.arrays import Array, Floats, K, N, P
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.kinematics import BoneFields
from handtrack.model.moving_limits import MovingLimits
from handtrack.model.size import SizeParameters
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.size.person import FARTHEST, PersonChange

_POSES = SolverSettings(iterations=15, damping=1e-3)
_SIZES = SolverSettings(
    iterations=8,
    damping=1e-3,
    cost_tolerance=1e-4,
    step_tolerance=1e-3,
    step_limit_m=1.0,  # all of them count in standard deviations
    step_limit_rad=1.0,
)
_RIDGE = 1e-6  # for joints that nothing holds


def fit_size(
    problems: Sequence[Problem],
    poses: Sequence[Floats[P]],
    free: Array[N] | None = None,
    solver: SolverSettings = _POSES,
    should_stop: Callable[[], bool] | None = None,
    least_gain: float = 0.0,
    tell: Callable[[int], None] | None = None,
    seen: tuple[str, ...] = (),
    repeated: float = 1.0,
) -> tuple[HandScale, list[Floats[P]]]:
    """Return the person who explains all frames best, and the poses of each frame.

    problems: of each frame, all of one model; its size and `poses` are where the search starts. free: which of the
    model's `SizeParameters` may change; all unless given. Adults' spread is the prior. solver: of the poses.
    least_gain: [log-likelihood] a step that brings less is the last. tell: is called after each frame that was fitted to
    a size, with their number so far. seen: joints whose offsets, where a detector sees them, are found too.
    repeated: how often a detector's error comes again, on average, in these frames; the doubt that is stated counts it once.
    """
    size = SizeParameters(problems[0].model, seen)
    start = size.deviations(size.model.scale)
    every = np.ones(len(start), bool) if free is None else free
    problem = SizedProblem(problems, poses, size, every, solver, should_stop, tell)
    share = least_gain / max(problem.cost(start[every]), 1e-12)
    sizes = replace(_SIZES, cost_tolerance=max(share, _SIZES.cost_tolerance))
    solve(problem, start[every], sizes, should_stop)
    best = problem.best
    person = PersonChange(size, every, best.deviations)
    return person.scale(problem.covariance(repeated)), best.poses


class _Solved(NamedTuple):
    """What the frames cost for a size, each at its best pose."""

    deviations: Floats
    """(N,)"""
    cost: float
    poses: list[Floats]


class _Expansion(NamedTuple):
    """How the best poses (P,) move with a size around `deviations` (N,)."""

    deviations: Floats
    poses: list[Floats]
    follow: Sequence[Floats]
    """(P, K) of each pose, by the free deviations"""


class SizedProblem:
    """cost(size), linearize(size) and limits of those deviations (K,) that are free: a BoundedProblem.

    Variable projection: a size costs what the frames cost at their best poses, so that those move along with each step.
    Moved in turn, size and poses creep along a valley: a longer finger that bends a little more looks nearly the same.
    """

    def __init__(
        self,
        problems: Sequence[Problem],
        poses: Sequence[Floats[P]],
        size: SizeParameters,
        free: Array[N],
        solver: SolverSettings = _POSES,
        should_stop: Callable[[], bool] | None = None,
        tell: Callable[[int], None] | None = None,
    ) -> None:
        self.problems, self.size, self.free = problems, size, free
        self.solver, self.should_stop = solver, should_stop
        self._tell, self._fitted = tell, 0
        start = size.deviations(size.model.scale)
        still = [np.zeros((len(pose), int(free.sum()))) for pose in poses]
        self._expansion = _Expansion(start, list(poses), still)
        self.best = self._last = _Solved(start, np.inf, list(poses))

    @property
    def limits(self) -> MovingLimits:
        """Adults', and children's."""
        return MovingLimits.fixed(np.tile([-FARTHEST, FARTHEST], (int(self.free.sum()), 1)))

    def cost(self, params: Floats[K]) -> float:
        """Return the least cost of all frames for a size, with the prior's."""
        return self._solved(params).cost

    def linearize(self, params: Floats[K]) -> JointSystem:
        """Return cost, gradient and Gauss-Newton Hessian (K, K) where the poses follow (Schur complement)."""
        solved = self._solved(params)
        model = self.size.grown(solved.deviations)
        gradient, hessian = solved.deviations[self.free], np.eye(len(params))
        follow = []
        for problem, pose in zip(self.problems, solved.poses, strict=True):
            system = linearize_sized(problem, model, self.size, self.free, pose)
            split = len(pose)
            mixed, own = system.hessian[:split, split:], system.hessian[split:, split:]
            stiff = system.hessian[:split, :split]
            stiff = stiff + _RIDGE * np.diag(np.diag(stiff) + 1.0)
            moves = _off_limits(model, pose, system.gradient[:split])
            moved = np.zeros((split, len(params) + 1))
            right = np.column_stack([mixed, system.gradient[:split]])
            moved[moves] = -np.linalg.solve(stiff[np.ix_(moves, moves)], right[moves])
            follow.append(moved[:, :-1])
            hessian = hessian + own + mixed.T @ follow[-1]
            gradient = gradient + system.gradient[split:] + mixed.T @ moved[:, -1]
        self._expansion = _Expansion(solved.deviations, solved.poses, follow)
        return JointSystem(solved.cost, gradient, 0.5 * (hessian + hessian.T))

    def covariance(self, repeated: float = 1.0) -> Floats[K, K]:
        """Return that of the free deviations where they fit best: what the estimator makes of errors as they come.

        repeated: a detector's errors have so many times the weight of errors that are new in each frame.
        """
        best = self._last = self.best
        inverse = np.linalg.inv(self.linearize(best.deviations[self.free]).hessian)
        model, more = self.size.grown(best.deviations), np.zeros_like(inverse)
        follows = zip(self.problems, best.poses, self._expansion.follow, strict=True)
        for problem, pose, follow in follows if repeated > 1.0 else ():
            seen = [
                term
                for term in problem.observation_terms
                if isinstance(term, KeypointTerm) and term.is_detected
            ]
            points = Problem(problem.model, seen)
            told = linearize_sized(points, model, self.size, self.free, pose).hessian
            along = np.vstack([follow, np.eye(len(inverse))])
            more += along.T @ told @ along
        return inverse + (repeated - 1.0) * inverse @ more @ inverse

    def _solved(self, params: Floats) -> _Solved:
        deviations = self.size.deviations(self.size.model.scale)
        deviations[self.free] = params
        if np.isfinite(self._last.cost) and np.array_equal(deviations, self._last.deviations):
            return self._last
        model, around = self.size.grown(deviations), self._expansion
        change = (deviations - around.deviations)[self.free]
        cost, poses = 0.5 * float(deviations @ deviations), []
        for problem, pose, follow in zip(self.problems, around.poses, around.follow, strict=True):
            sized = Problem(model, terms_of(problem, model), problem.parameter_terms)
            found = solve(sized, pose + follow @ change, self.solver, self.should_stop)
            cost += found.cost
            poses.append(found.params)
            self._fitted += 1
            if self._tell is not None:
                self._tell(self._fitted)
        self._last = _Solved(deviations, cost, poses)
        if cost < self.best.cost:
            self.best = self._last
        return self._last


def linearize_sized(
    problem: Problem,
    model: ArticulatedModel,
    size: SizeParameters,
    free: Array[N],
    pose: Floats[P],
) -> JointSystem:
    """Return a frame's system in its pose and the free ones of the deviations (K,), P + K numbers, without a size's prior.

    model: `size.grown`, of the size around which the system holds.
    """
    bones, twists, joint = model.linearize(pose)
    fields = BoneFields.of_twists(twists, len(model.joint_names))
    fields = fields.beside(size.fields(bones).chosen(free))
    count, both = twists.shape[2], fields.joints.shape[2]
    system = JointSystem.zero(both)
    for term in terms_of(problem, model):
        system += term.linearize_sized(bones, fields)
    gradient, hessian, cost = system.gradient, system.hessian, system.cost
    for prior in problem.parameter_terms:
        known = prior.linearize(joint)
        cost += known.cost
        gradient[:count] += known.gradient
        hessian[:count, :count] += known.hessian
    matrix = np.zeros((both, len(pose) + both - count))
    matrix[:count, : len(pose)] = model.transform.matrix
    matrix[count:, len(pose) :] = np.eye(both - count)
    return JointSystem(cost, gradient, hessian).pull_back(matrix)


def terms_of(problem: Problem, model: ArticulatedModel) -> list[ObservationTerm]:
    """Return a problem's terms of what was seen, where the joints that a detector means are this model's."""
    return [
        replace(term, model=model) if isinstance(term, KeypointTerm) else term
        for term in problem.observation_terms
    ]


def _off_limits(model: ArticulatedModel, pose: Floats, gradient: Floats) -> Array:
    """Return (P,) which parameters can follow the size: no limit stops them."""
    low, high = model.bounds(pose).T
    stopped = ((pose <= low + 1e-9) & (gradient > 0)) | ((pose >= high - 1e-9) & (gradient < 0))
    return ~stopped
