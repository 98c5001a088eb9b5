"""A person's body from joint positions: lengths, proportions and the poses of several frames fitted together."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import BODY_PARTS, ArticulatedModel, HandScale
from handtrack.observation.observation import Keypoints
from handtrack.solver.levenberg_marquardt import SolverSettings, solve
from handtrack.solver.problem import Problem
from handtrack.terms.body_priors import body_priors
from handtrack.terms.keypoints import KeypointTerm
from handtrack.terms.priors import GaussianPrior

_OVERALL_SIGMA = 0.10  # statures of men and women together: ±6 %; children and other markers beyond
_PART_SIGMA = 0.06  # a segment's share of stature: about ±4 % (de Leva 1996), and markers differ
_FARTHEST = 4.0  # standard deviations from the mean adult
_STEP = 1e-3  # of the difference quotient, in standard deviations
_ROUNDS = 8
_LEAST_GAIN = 1e-4  # share of the cost below which another round is not worth it
_POSE = SolverSettings(iterations=15, damping=1e-3)


class BodySize:
    """A body's size as numbers (N,) in standard deviations: overall, each part, each proportion."""

    def __init__(self, model: ArticulatedModel) -> None:
        self.proportions = model.proportion_names
        self.sigmas = np.array([_OVERALL_SIGMA] + [_PART_SIGMA] * len(BODY_PARTS))
        self.count = len(self.sigmas) + len(self.proportions)

    def scale(self, deviations: Floats) -> HandScale:
        """Return the body that is (N,) standard deviations from the mean adult's."""
        split = len(self.sigmas)
        factors = np.exp(deviations[:split] * self.sigmas).tolist()
        moved = dict(zip(self.proportions, deviations[split:].tolist(), strict=True))
        return HandScale(factors[0], dict(zip(BODY_PARTS, factors[1:], strict=True)), moved)

    def deviations(self, scale: HandScale) -> Floats:
        """Return (N,) how unusual a body is; the inverse of `scale`."""
        factors = [scale.overall] + [scale.parts.get(part, 1.0) for part in BODY_PARTS]
        moved = [scale.proportions.get(name, 0.0) for name in self.proportions]
        return np.concatenate([np.log(factors) / self.sigmas, moved])

    def prior(self) -> GaussianPrior:
        """Return the prior on deviations (N,): lengths and proportions are those of adults."""
        return GaussianPrior(np.zeros(self.count), np.ones(self.count), "proportions")


def fit_body(
    build: Callable[[HandScale], ArticulatedModel],
    seen: Sequence[Keypoints],
    poses: Sequence[Floats],
    scale: HandScale | None = None,
) -> tuple[HandScale, list[Floats]]:
    """Return the body that explains the joints of all frames best, and solver parameters (P,) of each frame.

    poses: starts, such as `fit_keypoints` gives. Gauss-Newton on size and poses together; the poses are eliminated from
    each step (Schur complement) and solved again after it. Adults' spread is the prior.
    """
    scale = scale or HandScale()
    size = BodySize(build(scale))
    at = size.deviations(scale)
    fitted = _poses(build(scale), seen, poses)
    prior = size.prior()
    cost = _cost(build(scale), seen, fitted) + prior.cost(at)
    for _ in range(_ROUNDS):
        step = _size_step(build, size, seen, fitted, at)
        before = cost
        for shorter in (1.0, 0.5, 0.25):
            trial = np.clip(at + shorter * step, -_FARTHEST, _FARTHEST)
            model = build(size.scale(trial))
            moved = _poses(model, seen, fitted)
            trial_cost = _cost(model, seen, moved) + prior.cost(trial)
            if trial_cost < cost:
                at, fitted, cost = trial, moved, trial_cost
                break
        if cost > before * (1.0 - _LEAST_GAIN):
            break
    return size.scale(at), fitted


def body_problem(model: ArticulatedModel, seen: Keypoints) -> Problem:
    """Return joints to be met, with a weak pull to rest that settles what they leave open; nothing keeps parts apart."""
    return Problem(model, [KeypointTerm(model, seen)], body_priors(model, collision=False).joints)


def _poses(
    model: ArticulatedModel, seen: Sequence[Keypoints], starts: Sequence[Floats]
) -> list[Floats]:
    pairs = zip(seen, starts, strict=True)
    return [solve(body_problem(model, points), start, _POSE).params for points, start in pairs]


def _cost(model: ArticulatedModel, seen: Sequence[Keypoints], poses: Sequence[Floats]) -> float:
    pairs = zip(seen, poses, strict=True)
    return sum(body_problem(model, points).cost(pose) for points, pose in pairs)


def _size_step(
    build: Callable[[HandScale], ArticulatedModel],
    size: BodySize,
    seen: Sequence[Keypoints],
    poses: Sequence[Floats],
    at: Floats,
) -> Floats:
    """Return the Gauss-Newton step (N,) of the size, the poses moving along."""
    model = build(size.scale(at))
    steps = _STEP * np.eye(size.count)
    ahead = [build(size.scale(at + step)) for step in steps]
    behind = [build(size.scale(at - step)) for step in steps]
    usual = size.prior().linearize(at)
    hessian, gradient = usual.hessian.copy(), usual.gradient.copy()
    for points, pose in zip(seen, poses, strict=True):
        bones, twists, _ = model.linearize(pose)
        rows = KeypointTerm(model, points).rows(bones)
        by_pose = np.einsum("ka,kas->ks", rows.twist, twists[rows.bone]) @ model.transform.matrix
        by_size = np.stack(
            [
                (_residual(a, points, pose) - _residual(b, points, pose)) / (2.0 * _STEP)
                for a, b in zip(ahead, behind, strict=True)
            ],
            axis=1,
        )
        system = body_problem(model, points).linearize(pose)
        bounds = model.bounds(pose)
        free = (pose > bounds[:, 0] + 1e-9) & (pose < bounds[:, 1] - 1e-9)
        inner = system.hessian[np.ix_(free, free)] + 1e-9 * np.eye(int(free.sum()))
        cross = by_pose[:, free].T @ by_size
        eliminated = np.linalg.solve(inner, np.column_stack([cross, system.gradient[free]]))
        hessian += by_size.T @ by_size - cross.T @ eliminated[:, :-1]
        gradient += by_size.T @ rows.residual - cross.T @ eliminated[:, -1]
    return -np.linalg.solve(hessian, gradient)


def _residual(model: ArticulatedModel, points: Keypoints, pose: Floats) -> Floats:
    return KeypointTerm(model, points).rows(model.bones(pose)).residual
