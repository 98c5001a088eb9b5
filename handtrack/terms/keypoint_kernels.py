"""Compiled sums of KeypointTerm. The plain form of the residuals: `KeypointTerm.residuals`."""

from __future__ import annotations

import numpy as np

from handtrack.compiled import compiled, compiled_as_numpy
from handtrack.terms.bone_kernels import add_row, fill_arm, to_world
from handtrack.terms.loss import robust


@compiled_as_numpy
def keypoint_sums(frames, targets, loss, weight, sums):  # pragma: no cover - compiled
    """Add the distances to targets to sums; return ½ weight Σ ρ, not a number where a point is
    behind the camera.

    Parameters
    ----------
    targets
        Bones (K,), points in their frames (K, 3) [m], where they were observed (K, 2) [px] or (K,
        3) [m], σ of each, in its unit, and the camera's projection, (0, 4) for points in space.
    """
    bone, local, target, deviation, camera = targets
    rows, width, o = target.shape[1], sums.width, frames.reference
    world, residual, slope, row = np.empty(3), np.empty(3), np.zeros((3, 3)), np.empty(12)
    image, cost = np.empty(3), 0.0
    for k in range(bone.shape[0]):
        b, sigma = bone[k], deviation[k]
        to_world(frames, b, local[k], world)
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
        value, size = robust(loss, square)
        cost += value
        if width == 0:
            continue
        at = k if width == 3 else b  # by velocities, each point moves by itself
        for i in range(rows):
            row[0], row[1], row[2] = slope[i, 0], slope[i, 1], slope[i, 2]
            fill_arm(row, 0, width, world[0] - o[0], world[1] - o[1], world[2] - o[2])
            add_row(sums, at, row, residual[i], weight * size)
    return 0.5 * weight * cost


@compiled
def point_velocities(
    frames, bone, point, fields, joint, scale, landmarks
):  # pragma: no cover - compiled
    """Return the velocity (K, 3, N) of points by N unknowns, as `BoneFields` says, about the
    frames' reference.

    Parameters
    ----------
    point
        (K, 3) in their bones' frames, grown [m].
    joint
        (K,) which of the landmarks they are, by which they move besides, `scale` (B, 3) being what
        their bones have grown by; empty for points that are none.
    """
    velocity = np.zeros((bone.shape[0], 3, fields.shape[2]))
    world = np.empty(3)
    for k in range(bone.shape[0]):
        b, moved = bone[k], velocity[k]
        to_world(frames, b, point[k], world)
        for i in range(3):
            for n in range(fields.shape[2]):
                moved[i, n] = fields[b, i, n]
            for j in range(3):
                arm = world[j] - frames.reference[j]
                for n in range(fields.shape[2]):
                    moved[i, n] += fields[b, 3 + 3 * i + j, n] * arm
                if joint.shape[0] > 0:
                    turned = frames.rotation[b, i, j] * scale[b, j]
                    for n in range(fields.shape[2]):
                        moved[i, n] += turned * landmarks[joint[k], j, n]
    return velocity
