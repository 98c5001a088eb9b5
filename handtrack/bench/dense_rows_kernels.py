"""Compiled residuals and dense Jacobian of E1, point by point: the reference that a general solver gets."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy
from handtrack.model.surfaces.metaballs_kernels import ellipsoid_distance, ellipsoid_gradient


@compiled_as_numpy
def dense_rows(
    points, surface, sigma, reference, twist, want_jacobian
):  # pragma: no cover - compiled
    """Return residual (N,) = d/σ and, if wanted, its derivatives by joint parameters (N, S). twist: (B, 6, S)."""
    table, bone, start, members, sharpness, turning = surface
    residual = np.empty(points.shape[0])
    jacobian = np.empty((points.shape[0] if want_jacobian else 0, twist.shape[2]))
    each, wrench = np.empty(table.shape[0]), np.empty(6)
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        best, least = 0, np.inf
        for e in range(table.shape[0]):
            each[e] = ellipsoid_distance(table, e, turning, x, y, z)
            if each[e] < least:
                best, least = e, each[e]
        total = 0.0
        for n in range(start[best], start[best + 1]):
            total += np.exp(-sharpness * (each[members[n]] - least))
        residual[i] = (least - np.log(total) / sharpness) / sigma
        if not want_jacobian:
            continue
        jacobian[i] = 0.0
        rx, ry, rz = x - reference[0], y - reference[1], z - reference[2]
        for n in range(start[best], start[best + 1]):
            e = members[n]
            share = -np.exp(-sharpness * (each[e] - least)) / (total * sigma)
            if share > -1e-12:
                continue
            _, nx, ny, nz = ellipsoid_gradient(table, e, turning, x, y, z)
            wrench[0], wrench[1], wrench[2] = share * nx, share * ny, share * nz
            wrench[3] = share * (ry * nz - rz * ny)
            wrench[4] = share * (rz * nx - rx * nz)
            wrench[5] = share * (rx * ny - ry * nx)
            for k in range(6):
                for s in range(jacobian.shape[1]):
                    jacobian[i, s] += wrench[k] * twist[bone[e], k, s]
    return residual, jacobian
