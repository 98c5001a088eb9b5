"""What is assumed of a pose before anything is seen: one builder for tracking, searches and first poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, S
from handtrack.model.articulated import ArticulatedModel
from handtrack.terms.loss import Loss
from handtrack.terms.priors.priors import GaussianPrior
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.settings import PriorSettings
from handtrack.tracking.frame.terms.posture import posture_prior

SEARCH_REST_RAD = np.deg2rad(50.0)
"""width of the pull to the relaxed hand while a search compares poses: half a finger's range; `bench auto_start`"""
POINTS_REST_RAD, _BODY_REST_RAD = np.deg2rad(40.0), np.deg2rad(80.0)
"""the same where a pose is fitted to 21 points, which leave only a finger's turn about itself open; of a body, whose joints go further, as
weak as in `body_priors`"""


def points_rest(model: ArticulatedModel) -> float:
    """Return the width [rad] of the pull to rest where a pose is fitted to all joints."""
    return _BODY_REST_RAD if model.kind == "body" else POINTS_REST_RAD


def pose_priors(
    model: ArticulatedModel,
    rest_rad: float,
    posture: float = 1.0,
    posture_loss: Loss | None = None,
) -> list[ParameterTerm]:
    """Return the priors of a pose by itself: relaxed, stabilised, joints that go together.

    rest_rad: standard deviation of joint angles from the relaxed hand's; 0 leaves that prior out. posture: strength of
    what is known of joints that go together; posture_loss: how it counts where it does not hold.
    """
    terms: list[ParameterTerm] = []
    if rest_rad > 0:
        sigma = np.full(len(model.parameter_names), rest_rad)
        sigma[:6] = np.inf
        terms.append(GaussianPrior(model.rest, sigma, "rest"))
    if model.stabilise is not None:
        terms.append(GaussianPrior(model.rest, model.stabilise, "stabilise"))
    together = posture_prior(model, posture) if posture > 0 else None
    if together is not None:
        terms.append(together if posture_loss is None else replace(together, loss=posture_loss))
    return terms


def motion_prior(
    expected: Floats[S], prior: PriorSettings, smoothing: float, frames_ahead: int
) -> GaussianPrior:
    """Return the pull to the pose that is expected, so many frames after the last one."""
    sigma = np.full(len(expected), np.deg2rad(prior.motion_sigma_deg))
    sigma[:3] = prior.motion_sigma_mm * 1e-3
    sigma *= np.sqrt(max(frames_ahead, 1)) / np.sqrt(smoothing)
    return GaussianPrior(expected, sigma, "motion")
