"""Compiled sums of the carried texture."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy
from handtrack.terms.bone_kernels import add_row, to_world
from handtrack.terms.images.image_rows_kernels import NEAREST, fill_row, see
from handtrack.terms.images.smooth_image_kernels import cell, look_up
from handtrack.terms.loss import robust


@compiled_as_numpy
def texture_sums(frames, camera, image, texture, noise, sums):  # pragma: no cover - compiled
    """Add one camera's texture to sums; return ½ weight Σ (ρ − worst).

    texture: bone (N,), point in its frame (N, 3), color (N, C). noise: σ, loss, worst and weight.
    """
    bone, local, color = texture
    sigma, loss, worst, weight = noise
    matrix = camera.matrix
    rows, columns, channels = image.shape
    cost, point, seen, row = 0.0, np.empty(3), np.empty(3), np.empty(12)
    residual, across, down = np.empty(channels), np.empty(channels), np.empty(channels)
    for n in range(bone.shape[0]):
        b = bone[n]
        to_world(frames, b, local[n], point)
        see(point, camera, seen)
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
        value, size = robust(loss, squared)
        cost += value - worst
        if sums.width == 0:
            continue
        for c in range(channels):
            fill_row(across[c], down[c], seen, camera, point, frames.reference, sums.width, row)
            add_row(sums, b, row, residual[c], weight * size)
    return 0.5 * weight * cost
