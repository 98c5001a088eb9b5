"""Fingers that look the same from a camera but bend the other way: the 2003 paper's jumps, on a hand's chains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import Floats, P
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.sampling.chains import chains_of
from handtrack.sampling.interpretation_tree import TreeSettings, interpretation_tree

_MOST_CAMERAS = 2
_DIFFERENT_RAD = 0.2


def depth_flips(
    model: ArticulatedModel, cameras: Sequence[Camera], params: Floats[P]
) -> list[Floats[P]]:
    """Return solver parameters with one finger's links flipped along the lines of sight of one of the first cameras.

    Only flips that limits allow, and that move the finger at all.
    """
    flipped: list[Floats] = []
    settings = TreeSettings(failing="nearest")
    for camera in cameras[:_MOST_CAMERAS]:
        for chain in chains_of(model):
            leaves = interpretation_tree(model, params, [chain], camera, settings=settings).params
            moved = np.abs(leaves - params).max(axis=1) > _DIFFERENT_RAD
            flipped += [model.clipped(leaf) for leaf in leaves[moved]]
    return flipped
