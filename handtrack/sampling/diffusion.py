"""Random samples around a minimum: covariance-scaled, heavy-tailed, and spherical with the same core volume."""

from __future__ import annotations

from typing import Literal

import numpy as np

from handtrack.arrays import Floats, N, P
from handtrack.model.articulated import ArticulatedModel

Tails = Literal["gaussian", "cauchy"]


def covariance_scaled(
    mean: Floats[P],
    covariance: Floats[P, P],
    scale: float,
    count: int,
    rng: np.random.Generator,
    tails: Tails = "gaussian",
) -> Floats[N, P]:
    """Return samples = mean + scale · U √Λ z, with U Λ Uᵀ = covariance [m, rad].

    z is normal, or Cauchy along each principal axis on its own: a few axes then go far, the others stay. 2003 paper, §5.1
    (covariance scaled sampling); limits are not looked at, see `projected`.
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    return mean + scale * _unit(len(mean), count, rng, tails) @ spread.T


def spherical(
    mean: Floats[P],
    covariance: Floats[P, P],
    scale: float,
    count: int,
    rng: np.random.Generator,
    tails: Tails = "gaussian",
) -> Floats[N, P]:
    """Return samples = mean + scale · r z: what knows nothing of the cost but how large its core is.

    r = `core_radius`: sphere and covariance ellipsoid have the same volume, as in the 2003 paper, §5.1.
    """
    return mean + scale * core_radius(covariance) * _unit(len(mean), count, rng, tails)


def core_radius(covariance: Floats[P, P]) -> float:
    """Return the radius of the ball with the volume of the ellipsoid of one standard deviation: (λ₁ … λ_P)^(1/2P)."""
    return float(np.exp(0.5 * np.linalg.slogdet(covariance)[1] / len(covariance)))


def long_tailed(
    mean: Floats[P], covariance: Floats[P, P], samples: Floats[N, P]
) -> tuple[Floats[N], Floats[N]]:
    """Return the log-density (N,) of a bell with Cauchy's tails along each principal axis, and squared distances (N,).

    The density is what `covariance_scaled` draws from with `tails = "cauchy"` and scale 1, but for what is the same for all
    bells; the distance is Mahalanobis'. What has no uncertainty at all is given a millionth of what is most uncertain.
    """
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    values = np.maximum(values, 1e-12 * max(float(values.max()), 1e-300))
    off = ((samples - mean) @ vectors) ** 2 / values
    return -np.log1p(off).sum(axis=1) - 0.5 * np.log(values).sum(), off.sum(axis=1)


def projected(model: ArticulatedModel, samples: Floats[N, P]) -> Floats[N, P]:
    """Return samples moved into their limits, also into those that narrow with another parameter."""
    # twice: a parameter that narrows another one may itself have been moved
    return np.array([model.clipped(model.clipped(row)) for row in samples]).reshape(samples.shape)


def _unit(size: int, count: int, rng: np.random.Generator, tails: Tails) -> Floats:
    if tails == "cauchy":
        return rng.standard_cauchy(size=(count, size))
    return rng.normal(size=(count, size))
