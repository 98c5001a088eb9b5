"""Compiled sums of the carried texture."""

from __future__ import annotations

import numba
import numpy as np

from handtrack.terms.images.image_rows_kernels import NEAREST, add_row, fill_row, place, see
from handtrack.terms.images.smooth_image_kernels import cell, look_up
from handtrack.terms.loss_kernels import counted


@numba.njit(cache=True, nogil=True, error_model="numpy")
def texture_system(
    image, bone, local, color, sigma, loss, scale, worst, weight, matrix, turn, shift,
    rotation, position, reference, width, gradient, hessian,
):  # fmt: skip  # pragma: no cover - compiled
    """Add one camera's texture to gradient (width · B,) and hessian; returns ½ weight Σ (ρ − worst). color: (N, C)."""
    rows, columns, channels = image.shape
    cost, point, seen, row = 0.0, np.empty(3), np.empty(3), np.empty(max(width, 6))
    residual, across, down = np.empty(channels), np.empty(channels), np.empty(channels)
    for n in range(bone.shape[0]):
        b = bone[n]
        place(b, local[n], rotation, position, point)
        see(point, turn, shift, seen)
        if seen[2] < NEAREST:
            continue
        j, q, in_u = cell(matrix[0, 2] + matrix[0, 0] * seen[0] / seen[2], columns)
        i, p, in_v = cell(matrix[1, 2] + matrix[1, 1] * seen[1] / seen[2], rows)
        squared = 0.0
        for c in range(channels):
            value, du, dv = look_up(image, i, j, p, q, c)
            residual[c] = (value - color[n, c]) / sigma
            across[c], down[c] = in_u * du / sigma, in_v * dv / sigma
            squared += residual[c] * residual[c]
        value, size = counted(loss, scale, squared)
        cost += value - worst
        if width == 0:
            continue
        for c in range(channels):
            fill_row(across[c], down[c], seen, matrix, turn, point, reference, row)
            add_row(b, row, weight * size * residual[c], weight * size, gradient, hessian)
    return 0.5 * weight * cost
