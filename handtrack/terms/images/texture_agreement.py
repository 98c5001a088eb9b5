"""Find points of a carried texture that contradict what is known of the surface."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Array, N
from handtrack.terms.images.carried_texture import Texture

_APART_M = 1e3  # between bones, so that a neighbour is always of the same one


def contradicts(texture: Texture, known: Texture, reach_m: float, tolerance: float) -> Array[N]:
    """Return True where the nearest known point of the same bone, within reach_m, has another colour.

    tolerance: [grey levels] between two colours, as a distance over all channels. Where nothing is known nothing is
    contradicted.
    """
    if not len(texture.bone) or not len(known.bone):
        return np.zeros(len(texture.bone), bool)
    from scipy.spatial import KDTree

    tree = KDTree(_with_bone(known))
    found = tree.query(_with_bone(texture), distance_upper_bound=reach_m)
    distance, nearest = np.asarray(found[0]), np.asarray(found[1])
    near = np.isfinite(distance)
    off = np.zeros(len(texture.bone))
    off[near] = np.linalg.norm(texture.color[near] - known.color[nearest[near]], axis=1)
    return off > tolerance


def _with_bone(texture: Texture) -> Array:
    return np.column_stack([texture.local, _APART_M * texture.bone])
