"""Soft priors of a body (2003 paper, section 2): angles, and freedoms that hardly show, stay near rest."""

from __future__ import annotations

import numpy as np

from handtrack.model.articulated import ArticulatedModel
from handtrack.terms.priors.priors import GaussianPrior

_REST_SIGMA_DEG = 80.0


def body_priors(model: ArticulatedModel) -> list[GaussianPrior]:
    """Return a model's soft priors, each a negative log-likelihood: a weak pull of all joint angles to rest, and `stabilisation`.

    The prior on proportions belongs to the estimation of a person's size: `tracking.size.estimate`.
    """
    sigma = np.full(len(model.parameter_names), np.deg2rad(_REST_SIGMA_DEG))
    sigma[:6] = np.inf
    rest, held = GaussianPrior(model.rest, sigma, "rest"), stabilisation(model)
    return [rest] if held is None else [rest, held]


def stabilisation(model: ArticulatedModel) -> GaussianPrior | None:
    """Return the prior that holds hard-to-measure freedoms, such as the clavicles', near rest; None if there are none."""
    if model.stabilise is None:
        return None
    return GaussianPrior(model.rest, model.stabilise, "stabilise")
