"""A person's hand size from what was seen: scale and poses of several frames fitted together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from handtrack.arrays import Floats, Ints
from handtrack.model.articulated import FINGERS, HAND_PARTS, ArticulatedModel, HandScale
from handtrack.observation.observation import Observation
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
from handtrack.terms.bone_system import JointSystem
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.settings import TrackerSettings

_OVERALL_SIGMA = (
    0.10  # adult hands differ by about this share in length (ANSUR II: 5–95 % is ±10 %)
)
_FINGER_SIGMA = 0.04  # and a finger's share of the hand by this (Alexander & Viktor 2010)
# narrow: the antisymmetric ramp makes radii r too small by w²/6r, 0.04 mm for a finger at the last
_BANDS_MM = (4.0, 1.5)
_FOREARM_SIGMA = 0.12  # forearms differ more in girth than hands in length (ANSUR II: wrist to forearm circumference)
_SIGMAS = np.array([_OVERALL_SIGMA] + [_FINGER_SIGMA] * len(FINGERS) + [_FOREARM_SIGMA])
SIZES = len(_SIGMAS)
"""how many numbers make a person's hand: overall, five fingers, forearm"""
_FARTHEST = 4.0  # standard deviations from the mean adult
_STEP = 0.15  # of the difference quotients, in standard deviations: 1.5 % of a hand's size at most
_POSE_ITERATIONS = 15
_ROUNDS, _TRIALS = 8, 5  # expansions of the cost, and steps tried from each
_LEAST_GAIN = 0.5  # [log-likelihood] what another round must bring
_LONGEST = 1.0  # step, in standard deviations
_DAMPING = 0.01
_RIDGE = 1e-6  # for joints that nothing holds


def scale_from_deviations(deviations: Floats) -> HandScale:
    """Return the hand that is (SIZES,) standard deviations from the mean adult's."""
    logs = deviations * _SIGMAS
    parts: dict[str, float] = dict(zip(HAND_PARTS, np.exp(logs[1:]).tolist(), strict=True))
    return HandScale(float(np.exp(logs[0])), parts)


def scale_deviations(scale: HandScale) -> Floats:
    """Return (SIZES,) how unusual a hand is among adults; the inverse of `scale_from_deviations`."""
    return np.log([scale.overall] + [scale.parts.get(part, 1.0) for part in HAND_PARTS]) / _SIGMAS


def refine_scale(
    build: Callable[[HandScale], ArticulatedModel],
    settings: TrackerSettings,
    scale: HandScale,
    observations: Sequence[Observation],
    poses: Sequence[Floats],
    should_stop: Callable[[], bool] | None = None,
    parts: bool = True,
) -> HandScale:
    """Return the hand that explains the frames best, from `scale` on, with the poses moving along.

    poses: solver parameters (P,) of each observation, already tracked. Adults' spread is the prior. parts: fingers and
    forearm have sizes of their own; otherwise they keep those they have, and all grow together.
    """
    free = np.arange(SIZES) if parts else np.array([0])
    deviations = scale_deviations(scale)
    current = [np.array(pose) for pose in poses]
    for band in _BANDS_MM:
        fit = _SizeFit(build, settings, band, observations, deviations, current, free, should_stop)
        deviations, current = fit.minimum()
    return scale_from_deviations(deviations)


class _StoppedError(Exception):
    """Leaves the minimiser from within."""


@dataclass(frozen=True, eq=False)
class _Expansion:
    """The cost to second order, around a size and its poses: poses (P,) follow the size (N,) at once."""

    gradient: Floats
    """(N,) by what is free of the size, the poses following"""
    hessian: Floats
    """(N, N) what is left of the size's curvature where the poses follow (Schur complement)"""
    follow: list[Floats]
    """(P, N) of each pose, how it moves with the size"""
    rest: list[Floats]
    """(P,) of each pose, how it would still move at this size"""


class _SizeFit:
    """Newton's method on a hand's size and the poses of all frames together.

    Moved one after the other, they creep along a valley: a longer finger that bends a little more looks nearly the
    same. Derivatives by size are difference quotients of the frames' costs and gradients; those by pose the solver's.
    """

    def __init__(
        self,
        build: Callable[[HandScale], ArticulatedModel],
        settings: TrackerSettings,
        band_mm: float,
        observations: Sequence[Observation],
        deviations: Floats,
        poses: list[Floats],
        free: Ints,
        should_stop: Callable[[], bool] | None,
    ) -> None:
        self.build, self.should_stop = build, should_stop
        self.ways = np.eye(SIZES)[free]
        self.solver = replace(settings.solver, iterations=_POSE_ITERATIONS)
        narrow = replace(settings.silhouettes, bands_mm=(band_mm,))
        alone = replace(settings.tracker, smoothing=0.0)
        model = build(scale_from_deviations(deviations))
        self.starts = [model.bones(pose) for pose in poses]
        stage = replace(settings, silhouettes=narrow, tracker=alone)
        self.terms = [
            frame_terms(model, stage, seen, start, None)
            for seen, start in zip(observations, self.starts, strict=True)
        ]
        self.best = (np.inf, deviations, poses)

    def minimum(self) -> tuple[Floats, list[Floats]]:
        """Return the best deviations (SIZES,) found, and its poses."""
        with suppress(_StoppedError):  # asked to: the best so far is what there is
            self._try(self.best[1], self.best[2])
            damping = _DAMPING
            for _ in range(_ROUNDS):
                before = self.best[0]
                damping = self._descend(damping)
                if before - self.best[0] < _LEAST_GAIN:
                    break
        return self.best[1], self.best[2]

    def _descend(self, damping: float) -> float:
        """Take a step that lowers the cost, if there is one; return the damping for the next."""
        _, here, poses = self.best
        around = self._expansion(here, poses)
        curvature, axes = np.linalg.eigh(around.hessian)
        along = (axes.T @ around.gradient) / np.maximum(np.abs(curvature), 1.0)  # 1: the prior's
        for _ in range(_TRIALS):
            step = np.clip(-axes @ along / (1 + damping), -_LONGEST, _LONGEST)
            there = np.clip(here + step @ self.ways, -_FARTHEST, _FARTHEST)
            step = self.ways @ (there - here)
            moves = zip(poses, around.rest, around.follow, strict=True)
            if self._try(there, [pose + rest + follow @ step for pose, rest, follow in moves]):
                return max(damping / 4, _DAMPING / 10)
            damping = max(8 * damping, 0.3)
        return damping

    def _try(self, deviations: Floats, poses: list[Floats]) -> bool:
        """Solve the poses for a size, keep both if they are the best, and return whether they are."""
        problems, solved = self._problems(deviations), []
        for problem, pose in zip(problems, poses, strict=True):
            start = problem.model.clipped(pose)
            solved.append(solve(problem, start, self.solver, self.should_stop).params)
            self._look_out()
        cost = self._cost(problems, solved) + 0.5 * float(deviations @ deviations)
        if cost >= self.best[0]:
            return False
        self.best = (cost, deviations, solved)
        return True

    def _expansion(self, here: Floats, poses: list[Floats]) -> _Expansion:
        steps = _STEP * self.ways
        middle = self._linearized(here, poses)
        ahead, behind = (
            [self._linearized(here + s, poses) for s in sign * steps] for sign in (1, -1)
        )
        cost = np.array([sum(f.cost for f in frames) for frames in (middle, *ahead, *behind)])
        at, up, down = cost[0], cost[1 : 1 + len(steps)], cost[1 + len(steps) :]
        gradient = (up - down) / (2 * _STEP) + self.ways @ here
        hessian = np.diag((up - 2 * at + down) / _STEP**2 + 1.0)
        for i, j in combinations(range(len(steps)), 2):
            both = self._cost(self._problems(here + steps[i] + steps[j]), poses)
            hessian[i, j] = hessian[j, i] = (both - up[i] - up[j] + at) / _STEP**2
        follow, rest = [], []
        for k, frame in enumerate(middle):
            mixed = np.stack(
                [a[k].gradient - b[k].gradient for a, b in zip(ahead, behind, strict=True)]
            )
            mixed /= 2 * _STEP
            stiff = frame.hessian + _RIDGE * np.diag(np.diag(frame.hessian) + 1.0)
            follow.append(-np.linalg.solve(stiff, mixed.T))
            rest.append(-np.linalg.solve(stiff, frame.gradient))
            hessian += mixed @ follow[-1]
            gradient += mixed @ rest[-1]
        return _Expansion(gradient, (hessian + hessian.T) / 2, follow, rest)

    def _problems(self, deviations: Floats) -> list[Problem]:
        model = self.build(scale_from_deviations(deviations))
        pairs = zip(self.terms, self.starts, strict=True)
        return [Problem(model, t.of(model).stage(0, start), t.priors) for t, start in pairs]

    def _linearized(self, deviations: Floats, poses: list[Floats]) -> list[JointSystem]:
        self._look_out()
        pairs = zip(self._problems(deviations), poses, strict=True)
        return [problem.linearize(pose) for problem, pose in pairs]

    def _cost(self, problems: list[Problem], poses: list[Floats]) -> float:
        self._look_out()
        return sum(p.cost(pose) for p, pose in zip(problems, poses, strict=True))

    def _look_out(self) -> None:
        if self.should_stop is not None and self.should_stop():
            raise _StoppedError
