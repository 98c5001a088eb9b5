"""The priors of terms/priors/priors.py, compiled."""

from __future__ import annotations

import numpy as np

from handtrack.terms.loss_kernels import counted
from handtrack.terms.term_table import GRADIENT, HESSIAN, JOINTS, TermKernel, array1, array2


@TermKernel("f8 f8")
def independent_kernel(term, place, width):  # pragma: no cover - compiled
    """GaussianPrior. Table: mean and sigma (S,)."""
    x, mean, sigma = (
        array1(place, JOINTS, np.float64),
        array1(term, 0, np.float64),
        array1(term, 1, np.float64),
    )
    gradient, hessian = array1(place, GRADIENT, np.float64), array2(place, HESSIAN, np.float64)
    cost = 0.0
    for s in range(x.shape[0]):
        r = (x[s] - mean[s]) / sigma[s]
        cost += r * r
        if width > 0:
            gradient[s] += r / sigma[s]
            hessian[s, s] += 1.0 / (sigma[s] * sigma[s])
    return 0.5 * cost


@TermKernel("f8 f8 f8")
def linear_kernel(term, place, width):  # pragma: no cover - compiled
    """LinearPrior. Table: rows (R, S), the loss, its scale and the weight, and ratios (R, S)."""
    x, rows, chosen, ratios = (
        array1(place, JOINTS, np.float64),
        array2(term, 0, np.float64),
        array1(term, 1, np.float64),
        array2(term, 2, np.float64),
    )
    gradient, hessian = array1(place, GRADIENT, np.float64), array2(place, HESSIAN, np.float64)
    cost, slope = 0.0, np.empty(x.shape[0])
    for n in range(rows.shape[0]):
        r, bent = 0.0, 0.0
        for s in range(x.shape[0]):
            r += rows[n, s] * x[s]
            bent += ratios[n, s] * x[s]
        narrow = 1.0 / np.sqrt(1.0 + bent * bent)
        r *= narrow
        value, size = counted(np.int64(chosen[0]), chosen[1], r * r)
        cost += value
        if width > 0:
            for s in range(x.shape[0]):
                slope[s] = narrow * (rows[n, s] - r * bent * narrow * ratios[n, s])
            for s in range(x.shape[0]):
                pull = chosen[2] * size * slope[s]
                if pull != 0.0:
                    gradient[s] += pull * r
                    for t in range(x.shape[0]):
                        hessian[s, t] += pull * slope[t]
    return 0.5 * chosen[2] * cost


@TermKernel("f8 f8")
def correlated_kernel(term, place, width):  # pragma: no cover - compiled
    """CorrelatedPrior. Table: mean (S,) and information (S, S)."""
    x, mean, information = (
        array1(place, JOINTS, np.float64),
        array1(term, 0, np.float64),
        array2(term, 1, np.float64),
    )
    gradient, hessian = array1(place, GRADIENT, np.float64), array2(place, HESSIAN, np.float64)
    cost = 0.0
    for s in range(x.shape[0]):
        slope = 0.0
        for t in range(x.shape[0]):
            slope += information[s, t] * (x[t] - mean[t])
            if width > 0:
                hessian[s, t] += information[s, t]
        cost += slope * (x[s] - mean[s])
        if width > 0:
            gradient[s] += slope
    return 0.5 * cost
