"""Orientations spread evenly over all rotations: where a search for a hand begins that knows nothing."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Axes, Floats, N
from handtrack.geometry.rotation import matrix_from_quaternion

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041


def spread_rotations(count: int) -> Floats[N, D3, D3]:
    """Return rotation matrices (count, 3, 3), the same each time, about as far from each other as they can be.

    Super-Fibonacci spirals: Alexa (2022), "Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3)", CVPR;
    ψ⁴ = ψ + 4, φ² = 2.
    """
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2 * np.pi * s / _PHI, 2 * np.pi * s / _PSI
    quaternion = np.stack(
        [inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta)],
        axis=-1,
    )
    return matrix_from_quaternion(quaternion)


def turned_by(a: Floats[*Axes, D3, D3], b: Floats[*Axes, D3, D3]) -> Floats[*Axes]:
    """Return the angles [rad] between rotations, broadcast."""
    trace = np.einsum("...ij,...ij->...", a, b)
    return np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
