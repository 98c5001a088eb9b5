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


def projected(model: ArticulatedModel, samples: Floats[N, P]) -> Floats[N, P]:
    """Return samples moved into their limits, also into those that narrow with another parameter."""
    # twice: a parameter that narrows another one may itself have been moved
    return np.array([model.clipped(model.clipped(row)) for row in samples]).reshape(samples.shape)


def _unit(size: int, count: int, rng: np.random.Generator, tails: Tails) -> Floats:
    if tails == "cauchy":
        return rng.standard_cauchy(size=(count, size))
    return rng.normal(size=(count, size))
