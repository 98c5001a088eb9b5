"""A person's hand size from what was seen: scale and poses of several frames fitted together."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from handtrack.arrays import Floats
from handtrack.model.articulated import FINGERS, HAND_PARTS, ArticulatedModel, HandScale
from handtrack.observation.observation import Observation
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
from handtrack.tracker.frame_terms import frame_terms
from handtrack.tracker.settings import TrackerSettings

_OVERALL_SIGMA = (
    0.10  # adult hands differ by about this share in length (ANSUR II: 5–95 % is ±10 %)
)
_FINGER_SIGMA = 0.04  # and a finger's share of the hand by this (Alexander & Viktor 2010)
_BANDS_MM = (
    4.0,
    1.5,
)  # narrow: the antisymmetric ramp makes radii r too small by w²/6r, 0.04 mm for a finger at the last
_FOREARM_SIGMA = 0.12  # forearms differ more in girth than hands in length (ANSUR II: wrist to forearm circumference)
_SIGMAS = np.array([_OVERALL_SIGMA] + [_FINGER_SIGMA] * len(FINGERS) + [_FOREARM_SIGMA])
SIZES = len(_SIGMAS)
"""how many numbers make a person's hand: overall, five fingers, forearm"""
_FARTHEST = 4.0  # standard deviations from the mean adult
_STEP = 0.02  # of the difference quotient, in standard deviations: 0.2 % of a hand's size at most
_POSE_ITERATIONS = 8


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
) -> HandScale:
    """Return the hand that explains the frames best, from `scale` on, with the poses moving along.

    poses: solver parameters (P,) of each observation, already tracked. Adults' spread is the prior.
    """
    deviations = scale_deviations(scale)
    current = [np.array(pose) for pose in poses]
    for band in _BANDS_MM:
        fit = _SizeFit(build, settings, band, observations, deviations, current, should_stop)
        deviations, current = fit.minimum()
    return scale_from_deviations(deviations)


class _StoppedError(Exception):
    """Leaves the minimiser from within."""


class _SizeFit:
    """Cost of a hand size with the poses solved for it (variable projection), and its derivative.

    Where the poses are optimal, the cost's derivative by size is that at fixed poses: a difference quotient
    of plain costs. Poses start from those of the best size so far, so that a trial too far harms nothing.
    """

    def __init__(
        self,
        build: Callable[[HandScale], ArticulatedModel],
        settings: TrackerSettings,
        band_mm: float,
        observations: Sequence[Observation],
        deviations: Floats,
        poses: list[Floats],
        should_stop: Callable[[], bool] | None,
    ) -> None:
        self.build, self.should_stop = build, should_stop
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
        options = {"maxiter": 20, "ftol": 1e-4}
        start, limits = self.best[1], [(-_FARTHEST, _FARTHEST)] * SIZES
        with suppress(_StoppedError):  # asked to: the best so far is what there is
            minimize(self._cost, start, jac=True, method="L-BFGS-B", bounds=limits, options=options)
        return self.best[1], self.best[2]

    def _look_out(self) -> None:
        if self.should_stop is not None and self.should_stop():
            raise _StoppedError

    def _problems(self, deviations: Floats) -> list[Problem]:
        model = self.build(scale_from_deviations(deviations))
        pairs = zip(self.terms, self.starts, strict=True)
        return [Problem(model, t.of(model).stage(0, start), t.priors) for t, start in pairs]

    def _cost(self, deviations: Floats) -> tuple[float, Floats]:
        pairs = zip(self._problems(deviations), self.best[2], strict=True)
        poses = [solve(p, pose, self.solver, self.should_stop).params for p, pose in pairs]
        cost = self._at(deviations, poses)
        if cost < self.best[0]:
            self.best = (cost, deviations.copy(), poses)
        ahead = [self._at(deviations + step, poses) for step in _STEP * np.eye(SIZES)]
        return cost, (np.array(ahead) - cost) / _STEP

    def _at(self, deviations: Floats, poses: list[Floats]) -> float:
        self._look_out()
        pairs = zip(self._problems(deviations), poses, strict=True)
        return sum(p.cost(pose) for p, pose in pairs) + 0.5 * float(deviations @ deviations)
