"""Compiled sums of the outline's edges."""

from __future__ import annotations

import numba
import numpy as np

from handtrack.terms.images.image_rows_kernels import NEAREST, add_row, fill_row, place, see


@numba.njit(cache=True, nogil=True, error_model="numpy")
def edges_system(
    bone, local, pixel, normal, weight, edge, strength, sigma, clutter, from_none, matrix, turn, shift,
    rotation, position, reference, width, gradient, hessian,
):  # fmt: skip  # pragma: no cover - compiled
    """Add one camera's edges to gradient (width · B,) and hessian; returns their cost. edge, strength: (N, K)."""
    cost, point, seen, row = 0.0, np.empty(3), np.empty(3), np.empty(max(width, 6))
    for n in range(bone.shape[0]):
        b = bone[n]
        place(b, local[n], rotation, position, point)
        see(point, turn, shift, seen)
        if seen[2] < NEAREST:
            continue
        du = matrix[0, 2] + matrix[0, 0] * seen[0] / seen[2] - pixel[n, 0]
        dv = matrix[1, 2] + matrix[1, 1] * seen[1] / seen[2] - pixel[n, 1]
        x = normal[n, 0] * du + normal[n, 1] * dv
        here, best, pull, held = clutter, clutter, 0.0, 0.0
        for k in range(edge.shape[1]):
            if strength[n, k] == 0.0:
                continue
            off = (x - edge[n, k]) / sigma
            likely = strength[n, k] * np.exp(-0.5 * off * off)
            here += likely
            best += strength[n, k]
            pull += likely * off / sigma
            held += likely / (sigma * sigma)
        cost -= weight[n] * np.log(here / (clutter if from_none else best))
        if width > 0 and held > 0.0:
            fill_row(normal[n, 0], normal[n, 1], seen, matrix, turn, point, reference, row)
            add_row(b, row, weight[n] * pull / here, weight[n] * held / here, gradient, hessian)
    return cost
