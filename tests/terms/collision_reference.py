"""Signed distance of overlapping ellipsoids in plain form: the best of many directions, refined."""

import numpy as np
from scipy.optimize import minimize

from handtrack.arrays import Floats


def free_space(directions: Floats, delta: Floats, one: Floats, other: Floats) -> Floats:
    """Return f(n) = n·δ − √(nᵀD₁n) − √(nᵀD₂n) for directions (N, 3) of any length."""
    n = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    reach = sum(np.sqrt(np.einsum("...i,ij,...j->...", n, d, n)) for d in (one, other))
    return n @ delta - reach


def signed_distance(delta: Floats, one: Floats, other: Floats) -> float:
    """Return max f over the sphere. delta: (3,) from one centre to the other; one, other: (3, 3) R diag(r²) Rᵀ."""
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(4000, 3))
    best = directions[free_space(directions, delta, one, other).argmax()]
    found = minimize(lambda n: -float(free_space(n, delta, one, other)), best, tol=1e-14)
    return -float(found.fun)
