"""Compiled: where bones carry ellipsoids."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled


@compiled
def posed_shapes(frames, ellipsoids, centre_world, shape_world):  # pragma: no cover - compiled
    """Fill centres (E, 3) and D = R diag(r²) Rᵀ (E, 3, 3), world, of ellipsoids carried by bones."""
    rotation, position, axes = frames.rotation, frames.position, np.empty((3, 3))
    bone, centre, turn, radii = ellipsoids
    for e in range(bone.shape[0]):
        b = bone[e]
        for i in range(3):
            r0, r1, r2 = rotation[b, i, 0], rotation[b, i, 1], rotation[b, i, 2]
            centre_world[e, i] = (
                position[b, i] + r0 * centre[e, 0] + r1 * centre[e, 1] + r2 * centre[e, 2]
            )
            for j in range(3):
                axes[i, j] = (r0 * turn[e, 0, j] + r1 * turn[e, 1, j] + r2 * turn[e, 2, j]) * radii[
                    e, j
                ]
        for i in range(3):
            for j in range(3):
                shape_world[e, i, j] = (
                    axes[i, 0] * axes[j, 0] + axes[i, 1] * axes[j, 1] + axes[i, 2] * axes[j, 2]
                )
