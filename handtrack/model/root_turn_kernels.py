"""Compiled turn of the root by a rotation vector, with first and second derivatives. The plain form: geometry/rotation.py."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled, inlined


@compiled
def turn_root(r, rotation, jacobian, slope):  # pragma: no cover - compiled
    """Fill R(r), its left Jacobian J (3, 3), and slope[i] = ∂J/∂r_i, for a rotation vector r (3,)."""
    t2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    t = np.sqrt(t2)
    if t < 0.05:  # series: the closed forms lose digits
        sine = 1.0 - t2 / 6.0 + t2 * t2 / 120.0 - t2 * t2 * t2 / 5040.0
        a = 0.5 - t2 / 24.0 + t2 * t2 / 720.0 - t2 * t2 * t2 / 40320.0
        b = 1.0 / 6.0 - t2 / 120.0 + t2 * t2 / 5040.0 - t2 * t2 * t2 / 362880.0
        da = -1.0 / 12.0 + t2 / 180.0 - t2 * t2 / 6720.0
        db = -1.0 / 60.0 + t2 / 1260.0 - t2 * t2 / 60480.0
    else:
        s, c = np.sin(t), np.cos(t)
        sine = s / t
        a = (1.0 - c) / t2
        b = (t - s) / (t2 * t)
        da = (t * s - 2.0 * (1.0 - c)) / (t2 * t2)
        db = (t * (1.0 - c) - 3.0 * (t - s)) / (t2 * t2 * t)
    for i in range(3):
        for j in range(3):
            square = r[i] * r[j] - (t2 if i == j else 0.0)
            cross = _skew_entry(r, i, j)
            unit = 1.0 if i == j else 0.0
            rotation[i, j] = unit + sine * cross + a * square
            jacobian[i, j] = unit + a * cross + b * square
            for k in range(3):
                moved = (r[j] if i == k else 0.0) + (r[i] if j == k else 0.0)
                moved -= 2.0 * r[k] if i == j else 0.0
                slope[k, i, j] = (da * cross + db * square) * r[k] + b * moved
    for k in range(3):  # the skew matrix's own derivative: a · [e_k]
        i, j = (k + 1) % 3, (k + 2) % 3
        slope[k, i, j] -= a
        slope[k, j, i] += a


@inlined
def _skew_entry(r, i, j):  # pragma: no cover - compiled
    if i == j:
        return 0.0
    return -r[3 - i - j] if (i + 1) % 3 == j else r[3 - i - j]
