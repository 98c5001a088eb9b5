"""A person's hand size from what was seen: scale and poses of several frames fitted together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from handtrack.arrays import Floats
from handtrack.model.articulated import FINGERS, ArticulatedModel, HandScale
from handtrack.observation.observation import Observation
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
from handtrack.tracker.frame_terms import frame_terms
from handtrack.tracker.settings import TrackerSettings

_OVERALL_SIGMA = 0.10  # adult hands differ by about this share in length (ANSUR II: 5–95 % is ±10 %)
_FINGER_SIGMA = 0.04  # and a finger's share of the hand by this (Alexander & Viktor 2010)
_BANDS_MM = (4.0, 1.5)  # narrow enough for the antisymmetric ramp on a finger: no bias towards large hands
_STEP = 2e-3  # of the difference quotient, in log scale
_POSE_ITERATIONS = 8


def scale_logs(scale: HandScale) -> Floats:
    """Return (6,) logarithms: overall, then each finger's factor on top of it."""
    return np.log([scale.overall] + [scale.fingers.get(finger, 1.0) for finger in FINGERS])


def scale_from_logs(logs: Floats) -> HandScale:
    """Return the hand of (6,) logarithms; the inverse of `scale_logs`."""
    fingers = dict(zip(FINGERS, np.exp(logs[1:]).tolist(), strict=True))
    return HandScale(float(np.exp(logs[0])), fingers)


def scale_prior(logs: Floats) -> Floats:
    """Return (6,) residuals: how unusual a hand is among adults, in standard deviations."""
    return logs / np.array([_OVERALL_SIGMA] + [_FINGER_SIGMA] * len(FINGERS))


def refine_scale(
    build: Callable[[HandScale], ArticulatedModel],
    settings: TrackerSettings,
    scale: HandScale,
    observations: Sequence[Observation],
    poses: Sequence[Floats],
    should_stop: Callable[[], bool] | None = None,
) -> HandScale:
    """Return the hand that explains the frames best, from `scale` on, with the poses moving along.

    poses: solver parameters (P,) of each observation, already tracked. For each size the poses are solved
    again; there, the cost's derivative by size is that at fixed poses, taken as a difference quotient.
    """
    if not observations:
        return scale
    logs = scale_logs(scale)
    # An unbiased ramp and no pull to what was tracked with another hand.
    unbiased = settings.with_values({"tracker.smoothing": 0.0})
    current = [np.array(pose) for pose in poses]
    for band in _BANDS_MM:
        stage = replace(unbiased, silhouettes=replace(unbiased.silhouettes, bands_mm=(band,)))
        first = build(scale_from_logs(logs))
        terms = [
            frame_terms(first, stage, seen, first.bones(pose), None)
            for seen, pose in zip(observations, current, strict=True)
        ]
        starts = [first.bones(pose) for pose in current]

        def problems(model: ArticulatedModel, terms=terms, starts=starts) -> list[Problem]:  # noqa: ANN001
            return [
                Problem(model, t.of(model).stage(0, start), t.priors)
                for t, start in zip(terms, starts, strict=True)
            ]

        def cost(x: Floats, problems=problems) -> tuple[float, Floats]:  # noqa: ANN001
            solver = replace(settings.solver, iterations=_POSE_ITERATIONS)
            for i, problem in enumerate(problems(build(scale_from_logs(x)))):
                current[i] = solve(problem, current[i], solver, should_stop).params

            def at_fixed_poses(y: Floats) -> float:
                pairs = zip(problems(build(scale_from_logs(y))), current, strict=True)
                return sum(problem.cost(pose) for problem, pose in pairs) + 0.5 * float(
                    (scale_prior(y) ** 2).sum()
                )

            slope = np.empty(len(x))
            for i, step in enumerate(np.eye(len(x)) * _STEP):
                slope[i] = (at_fixed_poses(x + step) - at_fixed_poses(x - step)) / (2 * _STEP)
            return at_fixed_poses(x), slope

        limits = [(-0.4, 0.4)] * len(logs)
        options = {"maxiter": 15, "ftol": 1e-4}
        logs = minimize(cost, logs, jac=True, method="L-BFGS-B", bounds=limits, options=options).x
    return scale_from_logs(logs)
