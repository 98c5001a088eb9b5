"""Choose which chain to jump, by its share in the least certain directions of a minimum."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import C, Floats, P
from handtrack.model.articulated import ArticulatedModel
from handtrack.sampling.chains import Chain

_LEADING = 0.95  # share of the total variance that the leading directions make up


def chain_votes(
    model: ArticulatedModel, params: Floats[P], covariance: Floats[P, P], chains: Sequence[Chain]
) -> Floats[C]:
    """Return the probability of each chain to be jumped at a minimum with a covariance.

    A chain's vote is Σ_k λ_k Σ_p u_k[p]², over the leading eigenpairs of the covariance in units of the limits' ranges
    and over the chain's own parameters p. Without any uncertainty all chains are alike. 2003 paper, §4. A model without
    chains has no votes.
    """
    if not chains:
        return np.zeros(0)
    low, high = model.bounds(params).T
    known = np.isfinite(low) & np.isfinite(high) & (high > low)
    width = np.where(known, np.where(known, high, 0.0) - np.where(known, low, 0.0), np.inf)
    scaled = covariance / (width[:, None] * width)
    values, vectors = np.linalg.eigh(0.5 * (scaled + scaled.T))
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    total = values.sum()
    if not total > 0.0:
        return np.full(len(chains), 1.0 / len(chains))
    count = int(np.searchsorted(np.cumsum(values), _LEADING * total)) + 1
    share = (vectors[:, :count] ** 2) @ values[:count]
    names = model.transform.names
    votes = np.array([sum(share[names.index(p)] for p in c.parameters) for c in chains])
    if not votes.sum() > 0.0:
        return np.full(len(chains), 1.0 / len(chains))
    return votes / votes.sum()
