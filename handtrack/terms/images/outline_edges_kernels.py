"""Compiled sums of the outline's edges."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled_as_numpy
from handtrack.terms.bone_kernels import add_row, to_world
from handtrack.terms.images.image_rows_kernels import NEAREST, fill_row, see


@compiled_as_numpy
def edges_sums(frames, camera, pieces, edges, spread, sums):  # pragma: no cover - compiled
    """Add one camera's edges to sums; return their cost.

    pieces: of outline, (N,) each: bone, point in its frame, pixel and normal at the start, weight. edges: place and strength (N, K).
    spread: σ [px], clutter, and whether costs count from those of a piece without an edge.
    """
    bone, local, pixel, normal, weight = pieces
    edge, strength = edges
    sigma, clutter, from_none = spread
    matrix = camera.matrix
    cost, point, seen, row = 0.0, np.empty(3), np.empty(3), np.empty(12)
    for n in range(bone.shape[0]):
        b = bone[n]
        to_world(frames, b, local[n], point)
        see(point, camera, seen)
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
        if sums.width > 0 and held > 0.0:
            fill_row(
                normal[n, 0], normal[n, 1], seen, camera, point, frames.reference, sums.width, row
            )
            add_row(sums, b, row, pull / held, weight[n] * held / here)
    return cost
