"""Changes of poses: of solver parameters by what leads from one to another, the root's turn in world axes."""

from __future__ import annotations

import math

import numpy as np

from handtrack.arrays import D3, Axes, F, Floats, N, P
from handtrack.geometry.rotation import rotation_matrix, rotation_vector

PLACE, TURN, ANGLES = slice(0, 3), slice(3, 6), slice(6, None)
"""of solver parameters: the root's place; its turn, whose changes are small turns in world axes whatever vector it is
written as; the joints' angles"""

_SERIES_BELOW = 1e-3  # [rad], of half the angle; the dropped term is below 1e-13


def changes(poses: Floats[F, P]) -> Floats[N, P]:
    """Return what leads from each pose to the next (F − 1, P), the root's turn as a turn in world axes [rad]."""
    steps = np.diff(poses, axis=0)
    turns = rotation_matrix(poses[:, TURN])
    steps[:, TURN] = rotation_vector(turns[1:] @ np.swapaxes(turns[:-1], 1, 2))
    return steps


def change(pose: Floats[P], other: Floats[P]) -> Floats[P]:
    """Return what leads from a pose to another, as `changes` does."""
    return changes(np.array([pose, other]))[0]


def moved(poses: Floats[*Axes, P], step: Floats[*Axes, P]) -> Floats[*Axes, P]:
    """Return poses changed by a step: the root's turn by a turn in world axes, all else by adding."""
    found = poses + step
    turned = rotation_matrix(step[..., TURN]) @ rotation_matrix(poses[..., TURN])
    found[..., TURN] = rotation_vector(turned)
    return found


def by_turn(pose: Floats[P]) -> Floats[D3, D3]:
    """Return how the root's rotation vector changes with a small turn in world axes, as a step of `moved` is: the inverse of
    `left_jacobian`, 1 − [r]/2 + (1 − ½θ cot ½θ) [r]²/θ².
    """
    x, y, z = pose[TURN].tolist()
    square = x * x + y * y + z * z
    half = 0.5 * math.sqrt(square)
    c = (1.0 - half / math.tan(half)) / square if half > _SERIES_BELOW else 1.0 / 12.0
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) - 0.5 * cross + c * (cross @ cross)
