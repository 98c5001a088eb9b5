"""Benchmark: time to polish 1024 starts of a monocular body, beside scipy's least_squares."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from handtrack.arrays import Floats, P, R
from handtrack.bench.jump_polish_kernels import image_rows
from handtrack.bench.measuring import alone
from handtrack.sampling.diffusion import covariance_scaled, projected
from handtrack.sampling.keypoint_problem import keypoint_problem
from handtrack.simulation.scenes.jump_scene import JumpScene, full_scene
from handtrack.terms.priors.priors import GaussianPrior

STARTS, SUBSET, SCALE = 1024, 48, 4.0
_SAME = 1e-4
"""costs closer than this are the same minimum"""


@alone
def jump_polish_1024() -> dict[str, Any]:
    """Return ratio, ours_ms, reference_ms and what the reference is."""
    scene = full_scene()
    drawn = covariance_scaled(
        scene.start, scene.covariance, SCALE, STARTS, np.random.default_rng(0).standard_normal
    )
    drawn = projected(scene.model, drawn)
    scene.polished(drawn[:1])
    residual, jacobian = _dense(scene)
    for compiled in (residual, jacobian):
        compiled(drawn[0])
    begin = time.process_time()
    ours = scene.polished(drawn)
    own = 1e3 * (time.process_time() - begin)
    bounds = scene.model.bounds(scene.start)
    low, high = bounds[:, 0] - 1e-9, bounds[:, 1] + 1e-9

    def scipy(method: str, **limits: Any) -> tuple[list[Any], float]:
        given: Any = {"jac": jacobian, "method": method, "x_scale": "jac"} | limits
        begin = time.process_time()
        ends = [
            least_squares(
                residual, start, ftol=1e-10, xtol=1e-10, gtol=1e-10, max_nfev=500, **given
            )
            for start in drawn[:SUBSET]
        ]
        return ends, 1e3 * (time.process_time() - begin) * STARTS / SUBSET

    ends, reference = scipy("trf", bounds=(low, high))
    _, without_limits = scipy("lm")
    bounded, reference = reference, min(reference, without_limits)
    costs = np.array([end.cost for end in ends])
    return {
        "ratio": own / reference,
        "ours_ms": own,
        "reference_ms": reference,
        "reference": (
            f"processor time of one thread; scipy least_squares (the quicker of trf, limits as bounds, and lm without limits) with the same analytic Jacobian, compiled and dense, on {SUBSET} of "
            f"the starts, scaled to {STARTS}; covariance-scaled starts (scale {SCALE:g}) of body34, "
            f"{len(scene.observed.names)} image joints, priors, no collisions"
        ),
        "ours_converged": float(ours.is_minimum.mean()),
        "ours_lower_or_same": float((ours.cost[:SUBSET] <= costs + _SAME).mean()),
        "same_minimum": float((np.abs(ours.cost[:SUBSET] - costs) <= _SAME).mean()),
        "scipy_trf_ms": bounded,
        "scipy_lm_without_limits_ms": without_limits,
        "scipy_converged": float(np.mean([end.status > 0 for end in ends])),
        "scipy_calls_median": float(np.median([end.nfev for end in ends])),
    }


def _dense(
    scene: JumpScene,
) -> tuple[Callable[[Floats[P]], Floats[R]], Callable[[Floats[P]], Floats[R, P]]]:
    """Return the scene as a general solver wants it: residuals at solver parameters, image joints [px], then priors [standard
    deviations]; and their derivatives.
    """
    problem, rows, means = keypoint_problem(scene.model, [scene.observed]), [], []
    for prior in scene.priors:
        assert isinstance(prior, GaussianPrior)
        known = np.flatnonzero(np.isfinite(prior.sigma))
        rows.append(np.eye(len(prior.sigma))[known] / prior.sigma[known, None])
        means.append(prior.mean[known] / prior.sigma[known])
    prior_rows, prior_means = np.concatenate(rows), np.concatenate(means)
    count = 2 * len(problem.views[1])

    def image(params: Floats[P], want_jacobian: bool) -> tuple[Floats[R], Floats[R, P]]:
        residual, jacobian = np.empty(count), np.empty((count * want_jacobian, len(params)))
        image_rows(problem, params, want_jacobian, residual, jacobian)
        return residual, jacobian

    return (
        lambda params: np.concatenate([image(params, False)[0], prior_rows @ params - prior_means]),
        lambda params: np.concatenate([image(params, True)[1], prior_rows]),
    )
