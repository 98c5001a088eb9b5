"""KeypointTerm, compiled. The plain form: `KeypointTerm.rows`."""

from __future__ import annotations

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


@TermKernel("i8 f8 f8 f8 f8 f8")
def keypoint_kernel(term, place, width):  # pragma: no cover - compiled
    """Table: bone (K,), point (K, 3), target (K, 2) px or (K, 3) m, projection (3, 4) or (0, 4), σ (K,), and [loss, scale, weight]."""
    rotation, position = array3(place, ROTATION, np.float64), array2(place, POSITION, np.float64)
    reference, gradient = array1(place, REFERENCE, np.float64), array1(place, GRADIENT, np.float64)
    hessian = array2(place, HESSIAN, np.float64)
    bone, point, target = (
        array1(term, 0, np.int64),
        array2(term, 1, np.float64),
        array2(term, 2, np.float64),
    )
    camera, deviation = array2(term, 3, np.float64), array1(term, 4, np.float64)
    chosen, rows = array1(term, 5, np.float64), target.shape[1]
    weight = chosen[2]
    world, residual, slope, row = np.empty(3), np.empty(3), np.zeros((3, 3)), np.empty(6)
    image, cost = np.empty(3), 0.0
    for k in range(bone.shape[0]):
        b, sigma = bone[k], deviation[k]
        for i in range(3):
            world[i] = position[b, i]
            for j in range(3):
                world[i] += rotation[b, i, j] * point[k, j]
        if camera.shape[0] == 0:
            for i in range(3):
                residual[i] = (world[i] - target[k, i]) / sigma
                slope[i, i] = 1.0 / sigma
        else:
            for i in range(3):
                image[i] = camera[i, 3]
                for j in range(3):
                    image[i] += camera[i, j] * world[j]
            if image[2] <= 0.0:
                return np.nan
            for i in range(2):
                pixel = image[i] / image[2]
                residual[i] = (pixel - target[k, i]) / sigma
                for j in range(3):
                    slope[i, j] = (camera[i, j] - pixel * camera[2, j]) / (image[2] * sigma)
        square = 0.0
        for i in range(rows):
            square += residual[i] * residual[i]
        value, size = counted(np.int64(chosen[0]), chosen[1], square)
        cost += value
        if width == 0:
            continue
        x, y, z = world[0] - reference[0], world[1] - reference[1], world[2] - reference[2]
        for i in range(rows):
            row[0], row[1], row[2] = slope[i, 0], slope[i, 1], slope[i, 2]
            row[3] = y * row[2] - z * row[1]
            row[4] = z * row[0] - x * row[2]
            row[5] = x * row[1] - y * row[0]
            for s in range(6):
                part = weight * size * row[s]
                gradient[6 * b + s] += part * residual[i]
                for t in range(6):
                    hessian[6 * b + s, 6 * b + t] += part * row[t]
    return 0.5 * weight * cost
