"""How the model of a result is built: hierarchy, rest pose, hinges, limits. For readers who have the file alone."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Array, Axes
from handtrack.model.articulated import ArticulatedModel

AXES = (
    "world: right-handed, as the camera calibration has it; bone: origin at its proximal end, +y along it, +z dorsal; "
    "T_a_b maps b to a"
)


def anatomy_arrays(model: ArticulatedModel) -> dict[str, Array[*Axes]]:
    """Return what poses.npz says of a model, by key.

    `parents` (B,), −1 for the root; `rest_T_bone` (B, 4, 4) bone → root in the zero pose [m]; `bone_length` (B,) [m];
    `hinge_bone` (S − 6,) the bone that each parameter after the root's six turns, `hinge_axis` (S − 6, 3) about which axis of
    its rest frame, in this order; `parameter_limits` (S, 2) [m, rad]; `joint_bone` (J,) and `joint_point` (J, 3) [m], where
    each named joint is in its bone's frame; `axes`, `unit`.
    """
    skeleton = model.skeleton
    rest = model.bones(model.params_from({})).T_world_bone
    return {
        "parents": np.asarray(skeleton.parent, np.int64),
        "rest_T_bone": rest,
        "bone_length": skeleton.length,
        "hinge_bone": np.asarray(skeleton.hinge_bone, np.int64),
        "hinge_axis": skeleton.hinge_axis,
        "parameter_limits": model.limits.interval,
        "joint_bone": np.asarray(model.joint_bone, np.int64),
        "joint_point": model.joint_point,
        "axes": np.array(AXES),
        "unit": np.array("m"),
    }
