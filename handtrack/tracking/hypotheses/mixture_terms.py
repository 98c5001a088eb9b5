"""The terms of a frame as the mixture sees them: pulled to a belief, static priors shared out, joints seen coarsely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from handtrack.arrays import Floats, Ints, K, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.terms.priors.priors import CorrelatedPrior, GaussianPrior, LinearPrior
from handtrack.terms.term import ParameterTerm
from handtrack.tracking.frame.frame_terms import FrameTerms
from handtrack.tracking.hypotheses.motion_belief import MotionBelief

_COARSE = 10.0  # times sigma
_MEMORY_FRAMES = 10.0  # over about so many frames a belief remembers, so each counts this share of the static priors


def pulled(
    model: ArticulatedModel, terms: FrameTerms, belief: MotionBelief, free: Sequence[int] | Ints[K]
) -> FrameTerms:
    """Return the terms with the pull to where a belief expects the pose, but for the columns that are free."""
    others = np.setdiff1d(np.arange(len(belief.mean)), np.asarray(free, dtype=int))
    information = np.zeros((len(belief.mean), len(belief.mean)))
    inner = belief.place_covariance[np.ix_(others, others)]
    information[np.ix_(others, others)] = np.linalg.inv(inner)
    back = np.linalg.pinv(model.transform.matrix)
    information = back.T @ (0.5 * (information + information.T)) @ back
    prior = CorrelatedPrior(model.joint_params(belief.mean), information)
    known = without_memory(terms)
    return replace(known, priors=(*known.priors, prior))


def coarse(terms: FrameTerms) -> FrameTerms:
    """Return the terms as if joints were seen ten times as coarsely in the image: a wide basin."""
    return terms.coarser(_COARSE)


def without_memory(terms: FrameTerms) -> FrameTerms:
    """Return the terms as one frame of many counts them: static priors, and joints in images whose errors last."""
    share = terms.settings.traits.new_share
    seen = terms if share == 1.0 else terms.coarser(share**-0.5)
    return replace(seen, priors=tuple(map(_shared_out, terms.priors)))


def _shared_out(prior: ParameterTerm) -> ParameterTerm:
    """Return what is known of poses as one frame of many counts it: the belief already holds it from those before."""
    if isinstance(prior, GaussianPrior):
        return replace(prior, sigma=prior.sigma * np.sqrt(_MEMORY_FRAMES))
    if isinstance(prior, LinearPrior):
        return replace(prior, weight=prior.weight / _MEMORY_FRAMES)
    return prior


def log_normal(spread: Floats[P, P]) -> float:
    """Return the log of a bell's height at its middle, −½ log det(2π C)."""
    return -0.5 * float(np.linalg.slogdet(spread)[1] + len(spread) * np.log(2.0 * np.pi))
