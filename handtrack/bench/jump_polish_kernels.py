"""Compiled residuals and dense Jacobian of image joints, row by row: the reference that a general solver gets."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled
from handtrack.sampling.keypoint_kernels import place, pose


@compiled
def image_rows(problem, params, want_jacobian, residual, jacobian):  # pragma: no cover
    """Fill residual (2 O,) and jacobian (2 O, P) at params (P,); joint parameters are solver parameters here."""
    rotation, at, axes, root = pose(problem, params)
    row, (first, chain) = np.empty((2, 3)), problem.chains
    turns, shifts, focals, middles = problem.cameras
    begin, camera, target, information = problem.views
    for k in range(problem.points[0].shape[0]):
        b = problem.points[0][k]
        x, y, z = place(problem.points, rotation, at, k)
        for o in range(begin[k], begin[k + 1]):
            c, scale = camera[o], np.sqrt(information[o])
            turn, shift, focal, middle = turns[c], shifts[c], focals[c], middles[c]
            depth = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + shift[2]
            for i in range(2):
                across = turn[i, 0] * x + turn[i, 1] * y + turn[i, 2] * z + shift[i]
                seen = focal[i] * across / depth + middle[i]
                residual[2 * o + i] = scale * (seen - target[o, i])
                for j in range(3):
                    row[i, j] = (
                        scale * focal[i] / depth * (turn[i, j] - across / depth * turn[2, j])
                    )
            if not want_jacobian:
                continue
            for i in range(2):
                n0, n1, n2 = row[i, 0], row[i, 1], row[i, 2]
                out = jacobian[2 * o + i]
                out[:] = 0.0
                out[0], out[1], out[2] = n0, n1, n2
                d0, d1, d2 = x - at[0, 0], y - at[0, 1], z - at[0, 2]
                t0, t1, t2 = d1 * n2 - d2 * n1, d2 * n0 - d0 * n2, d0 * n1 - d1 * n0
                for s in range(3):
                    lever = root[1][:, s]
                    out[3 + s] = lever[0] * t0 + lever[1] * t1 + lever[2] * t2
                for n in range(first[b], first[b + 1]):
                    h = chain[n]
                    base = problem.tree[3][h]
                    d0, d1, d2 = x - at[base, 0], y - at[base, 1], z - at[base, 2]
                    t0, t1, t2 = d1 * n2 - d2 * n1, d2 * n0 - d0 * n2, d0 * n1 - d1 * n0
                    out[6 + h] = axes[h, 0] * t0 + axes[h, 1] * t1 + axes[h, 2] * t2
