"""Where cameras look: the point nearest to all their optical axes."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats


def nearest_to_axes(centres: Floats, axes: Floats) -> Floats:
    """Return the point (3,) nearest to lines through (N, 3) along unit (N, 3) [m]; for one, half a metre on it."""
    system, right = 1e-3 * np.eye(3), np.zeros(3)
    for centre, axis in zip(centres, axes, strict=True):
        across = np.eye(3) - np.outer(axis, axis)
        system += across
        right += across @ centre + 1e-3 * (centre + 0.5 * axis) / len(centres)
    return np.asarray(np.linalg.solve(system, right), dtype=float)
