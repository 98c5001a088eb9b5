"""Compiled look-ups in a distance map, and the sums of E2."""

from __future__ import annotations

import numba
import numpy as np

from handtrack.terms.loss_kernels import counted
from handtrack.terms.term_table import (
    GRADIENT,
    HESSIAN,
    POSITION,
    REFERENCE,
    ROTATION,
    TermKernel,
    array1,
    array2,
    array3,
)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def look_up(values, low, spacing, x, y, z):  # pragma: no cover - compiled
    """Return distance and gradient (3) at a point: trilinear; beyond the grid, the border's value plus the way there."""
    u = (x - low[0]) / spacing
    v = (y - low[1]) / spacing
    w = (z - low[2]) / spacing
    a = min(max(u, 0.0), values.shape[0] - 1.0)
    b = min(max(v, 0.0), values.shape[1] - 1.0)
    c = min(max(w, 0.0), values.shape[2] - 1.0)
    i = min(np.int64(a), values.shape[0] - 2)
    j = min(np.int64(b), values.shape[1] - 2)
    k = min(np.int64(c), values.shape[2] - 2)
    p, q, r = a - i, b - j, c - k
    f000, f001 = np.float64(values[i, j, k]), np.float64(values[i, j, k + 1])
    f010, f011 = np.float64(values[i, j + 1, k]), np.float64(values[i, j + 1, k + 1])
    f100, f101 = np.float64(values[i + 1, j, k]), np.float64(values[i + 1, j, k + 1])
    f110, f111 = np.float64(values[i + 1, j + 1, k]), np.float64(values[i + 1, j + 1, k + 1])
    e00, e01 = f000 + r * (f001 - f000), f010 + r * (f011 - f010)
    e10, e11 = f100 + r * (f101 - f100), f110 + r * (f111 - f110)
    d0, d1 = e00 + q * (e01 - e00), e10 + q * (e11 - e10)
    distance = d0 + p * (d1 - d0)
    gx = (d1 - d0) / spacing
    gy = ((1.0 - p) * (e01 - e00) + p * (e11 - e10)) / spacing
    gz = (
        (1.0 - p) * ((1.0 - q) * (f001 - f000) + q * (f011 - f010))
        + p * ((1.0 - q) * (f101 - f100) + q * (f111 - f110))
    ) / spacing
    out = np.sqrt((u - a) ** 2 + (v - b) ** 2 + (w - c) ** 2)
    if out > 0.0:
        distance += spacing * out
        gx = (u - a) / out if u != a else gx
        gy = (v - b) / out if v != b else gy
        gz = (w - c) / out if w != c else gz
    return distance, gx, gy, gz


@numba.njit(cache=True, nogil=True, error_model="numpy")
def interpolate(values, low, spacing, points, distance, gradient):  # pragma: no cover - compiled
    """Fill distance (N,) and gradient (N, 3) at points (N, 3)."""
    for n in range(points.shape[0]):
        distance[n], gradient[n, 0], gradient[n, 1], gradient[n, 2] = look_up(
            values, low, spacing, points[n, 0], points[n, 1], points[n, 2]
        )


@numba.njit(cache=True, nogil=True, error_model="numpy")
def emptiness_system(
    values, low, spacing, rotation, position, reference, bone, local, share, slack, sigma, loss, scale, weight,
    width, gradient, hessian,
):  # fmt: skip  # pragma: no cover - compiled
    """Add E2 to gradient (width · B,) and hessian; width: 6, 7 with growth, 0 for the cost alone. Returns ½ weight Σ share ρ.

    bone, local, share: (V,), (V, 3) and (V,); a share falls with the square of its bone's growth.
    """
    cost, row = 0.0, np.empty(max(width, 6))
    for n in range(bone.shape[0]):
        b = bone[n]
        x, y, z = position[b, 0], position[b, 1], position[b, 2]
        for i in range(3):
            x += rotation[b, 0, i] * local[n, i]
            y += rotation[b, 1, i] * local[n, i]
            z += rotation[b, 2, i] * local[n, i]
        distance, gx, gy, gz = look_up(values, low, spacing, x, y, z)
        residual = (distance - slack) / sigma
        if residual <= 0.0:
            continue
        value, size = counted(loss, scale, residual * residual)
        cost += value * share[n]
        if width == 0:
            continue
        x, y, z = x - reference[0], y - reference[1], z - reference[2]
        row[0], row[1], row[2] = gx / sigma, gy / sigma, gz / sigma
        row[3], row[4], row[5] = (
            y * row[2] - z * row[1],
            z * row[0] - x * row[2],
            x * row[1] - y * row[0],
        )
        if width == 7:
            row[6] = x * row[0] + y * row[1] + z * row[2]
            gradient[width * b + 6] -= weight * share[n] * value
        at = width * b
        for i in range(width):
            part = weight * share[n] * size * row[i]
            gradient[at + i] += part * residual
            for j in range(width):
                hessian[at + i, at + j] += part * row[j]
    return 0.5 * weight * cost


@TermKernel("f4 f8 i8 f8 f8")
def emptiness_kernel(term, place, width):  # pragma: no cover - compiled
    """E2; the table is made by `CloudEmptinessTerm.tables`."""
    bone, chosen = array1(term, 2, np.int64), array1(term, 4, np.float64)
    return emptiness_system(
        array3(term, 0, np.float32), array1(term, 1, np.float64), chosen[0], array3(place, ROTATION, np.float64),
        array2(place, POSITION, np.float64), array1(place, REFERENCE, np.float64), bone, array2(term, 3, np.float64),
        np.ones(bone.shape[0]), chosen[1], chosen[2], np.int64(chosen[3]), chosen[4], chosen[5], width,
        array1(place, GRADIENT, np.float64), array2(place, HESSIAN, np.float64),
    )  # fmt: skip
