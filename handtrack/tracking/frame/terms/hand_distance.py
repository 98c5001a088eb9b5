"""How far points are from a hand: what crops a cloud before it is thinned."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from handtrack.arrays import D3, Floats, N
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.surfaces.metaballs import MetaballSurface

_FAR_M = 0.25


def hand_distance(
    model: ArticulatedModel, bones: BonePoses
) -> Callable[[Floats[N, D3]], Floats[N]]:
    """Return a function: points world [m] → distance [m] to the hand posed by `bones`, negative inside.

    Of points more than 0.25 m from a box around the hand, the distance to that box: most of a room is there, and
    it need not be known well.
    """
    surface = MetaballSurface.of(model)
    ellipsoids = surface.ellipsoids.posed(bones)
    reach = ellipsoids.radii.max(axis=1, keepdims=True)
    low, high = (ellipsoids.centre - reach).min(axis=0), (ellipsoids.centre + reach).max(axis=0)

    def distance(points: Floats) -> Floats:
        beside = zip(points.T, low, high, strict=True)  # three times as quick as by rows
        outside = np.sqrt(sum(np.maximum(np.maximum(a - x, x - b), 0.0) ** 2 for x, a, b in beside))
        near = outside <= _FAR_M
        outside[near] = surface.distance(bones, points[near])
        return outside

    return distance
