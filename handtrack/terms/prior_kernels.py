"""Compiled sums of the priors."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy
from handtrack.terms.loss import robust


@compiled_as_numpy
def independent_sums(x, mean, sigma, sums):  # pragma: no cover - compiled
    """Add a GaussianPrior; return its cost."""
    cost = 0.0
    for s in range(x.shape[0]):
        r = (x[s] - mean[s]) / sigma[s]
        cost += r * r
        if sums.width > 0:
            sums.gradient[s] += r / sigma[s]
            sums.hessian[s, s] += 1.0 / (sigma[s] * sigma[s])
    return 0.5 * cost


@compiled_as_numpy
def linear_sums(x, rows, ratios, loss, weight, sums):  # pragma: no cover - compiled
    """Add a LinearPrior; return its cost."""
    cost, slope = 0.0, np.empty(x.shape[0])
    for n in range(rows.shape[0]):
        r, bent = 0.0, 0.0
        for s in range(x.shape[0]):
            r += rows[n, s] * x[s]
            bent += ratios[n, s] * x[s]
        narrow = 1.0 / np.sqrt(1.0 + bent * bent)
        r *= narrow
        value, size = robust(loss, r * r)
        cost += value
        if sums.width > 0:
            for s in range(x.shape[0]):
                slope[s] = narrow * (rows[n, s] - r * bent * narrow * ratios[n, s])
            for s in range(x.shape[0]):
                pull = weight * size * slope[s]
                if pull != 0.0:
                    sums.gradient[s] += pull * r
                    for t in range(x.shape[0]):
                        sums.hessian[s, t] += pull * slope[t]
    return 0.5 * weight * cost


@compiled_as_numpy
def correlated_sums(x, mean, information, sums):  # pragma: no cover - compiled
    """Add a CorrelatedPrior; return its cost."""
    cost = 0.0
    for s in range(x.shape[0]):
        slope = 0.0
        for t in range(x.shape[0]):
            slope += information[s, t] * (x[t] - mean[t])
            if sums.width > 0:
                sums.hessian[s, t] += information[s, t]
        cost += slope * (x[s] - mean[s])
        if sums.width > 0:
            sums.gradient[s] += slope
    return 0.5 * cost
