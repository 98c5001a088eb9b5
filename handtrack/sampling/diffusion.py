"""Random samples around a minimum, scaled by its covariance, and the density of a long-tailed distribution."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from handtrack.arrays import Floats, N, P
from handtrack.model.articulated import ArticulatedModel


def covariance_scaled(
    mean: Floats[P],
    covariance: Floats[P, P],
    scale: float,
    count: int,
    draw: Callable[[tuple[int, int]], Floats[N, P]],
) -> Floats[N, P]:
    """Return samples = mean + scale · U √Λ z, with U Λ Uᵀ = covariance [m, rad].

    Parameters
    ----------
    draw
        z, of a shape, such as a generator's `standard_normal`. 2003 paper, §5.1 (covariance scaled
        sampling); limits are not looked at, see `projected`.
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    return mean + scale * draw((count, len(mean))) @ spread.T


def long_tailed(
    mean: Floats[P], covariance: Floats[P, P], samples: Floats[N, P]
) -> tuple[Floats[N], Floats[N]]:
    """Return the log-density (N,) of a distribution with Cauchy's tails along each principal axis, and squared distances (N,).

    The density leaves out what is the same wherever it is centred; the distance is Mahalanobis'. What has no uncertainty at all is given
    a millionth of what is most uncertain.
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    values = np.maximum(values, 1e-12 * max(float(values.max()), 1e-300))
    off = ((samples - mean) @ vectors) ** 2 / values
    return -np.log1p(off).sum(axis=1) - 0.5 * np.log(values).sum(), off.sum(axis=1)


def projected(model: ArticulatedModel, samples: Floats[N, P]) -> Floats[N, P]:
    """Return samples moved into their limits, also into those that narrow with another parameter."""
    # twice: a parameter that narrows another one may itself have been moved
    return model.clipped(model.clipped(samples))
