"""Soft priors of body34: parts do not collide, freedoms that hardly show stay near rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.model.articulated import ArticulatedModel
from handtrack.terms.collision import CollisionTerm
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.terms.term import ObservationTerm, ParameterTerm


@dataclass(frozen=True)
class BodyPriors:
    """Soft priors (2003 paper, section 2), split by what they speak of."""

    bones: tuple[ObservationTerm, ...]
    joints: tuple[ParameterTerm, ...]


def body_priors(
    model: ArticulatedModel,
    rest_sigma_deg: float = 80.0,
    collision: bool = True,
    flesh: str = "metaballs",
) -> BodyPriors:
    """Return a model's soft priors, each a negative log-likelihood.

    rest_sigma_deg: width of a weak pull of all joint angles to rest, 0 for none. The prior on proportions belongs to the
    estimation of a person's size: `tracking.size.estimate`.
    """
    joints: list[ParameterTerm] = []
    if rest_sigma_deg > 0:
        sigma = np.full(len(model.parameter_names), np.deg2rad(rest_sigma_deg))
        sigma[:6] = np.inf
        joints.append(GaussianPrior(model.rest, sigma, "rest"))
    held = stabilisation(model)
    if held is not None:
        joints.append(held)
    bones: list[ObservationTerm] = []
    if collision and flesh in model.flesh:
        bones.append(CollisionTerm.of(model, flesh))
    return BodyPriors(tuple(bones), tuple(joints))


def stabilisation(model: ArticulatedModel) -> GaussianPrior | None:
    """Return the prior that holds hard-to-measure freedoms, such as the clavicles', near rest; None if there are none."""
    if model.stabilise is None:
        return None
    return GaussianPrior(model.rest, model.stabilise, "stabilise")
