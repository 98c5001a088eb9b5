"""A pose with its four fingers stretched or bent in all sixteen ways, or with two neighbours exchanged."""

from __future__ import annotations

from itertools import pairwise, product

from handtrack.arrays import Floats, P
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.pose_library import named_pose

_STRETCHED, _BENT = "open", "fist"
_FREEDOMS = ("mcp_flex", "mcp_abd", "pip_flex", "dip_flex")


def finger_bends(model: ArticulatedModel, params: Floats[P]) -> list[Floats[P]]:
    """Return solver parameters of a pose with each finger but the thumb stretched or bent: 16 poses."""
    ends = [named_pose(model, name) for name in (_STRETCHED, _BENT)]
    bends = [
        [model.skeleton.parameter(f"{finger}_{joint}_flex") for joint in ("mcp", "pip", "dip")]
        for finger in FINGERS[1:]
    ]
    poses = []
    for way in product(ends, repeat=len(bends)):
        joint = model.joint_params(params)
        for at, end in zip(bends, way, strict=True):
            joint[at] = end[at]
        poses.append(model.clipped(model.transform.solver_params(joint)))
    return poses


def finger_swaps(model: ArticulatedModel, params: Floats[P]) -> list[Floats[P]]:
    """Return solver parameters of a pose with two neighbouring fingers exchanged, each pair but the thumb's."""
    poses = []
    for pair in pairwise(FINGERS[1:]):
        joint = model.joint_params(params)
        one, other = (
            [model.skeleton.parameter(f"{finger}_{name}") for name in _FREEDOMS] for finger in pair
        )
        joint[one], joint[other] = joint[other], joint[one]
        poses.append(model.clipped(model.transform.solver_params(joint)))
    return poses
