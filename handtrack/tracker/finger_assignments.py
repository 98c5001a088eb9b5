"""Which fingers are stretched and which are bent: a pose with its four fingers in all sixteen ways."""

from __future__ import annotations

from itertools import product

from handtrack.arrays import Floats
from handtrack.model.articulated import FINGERS, ArticulatedModel
from handtrack.model.pose_library import named_pose

_STRETCHED, _BENT = "open", "fist"


def finger_assignments(model: ArticulatedModel, params: Floats) -> list[Floats]:
    """Return solver parameters (P,) of a pose with each finger but the thumb stretched or bent: 16 poses."""
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
