"""Plain NumPy kinematics, and the 2007 paper's own form of it: the references that the compiled one is held to."""

import numpy as np
from scipy.spatial.transform import Rotation

from handtrack.model.kinematics import BonePoses, Skeleton


def bone_poses(skeleton: Skeleton, params: np.ndarray) -> BonePoses:
    rotation, position = [], []
    for b in range(skeleton.bone_count):
        p = skeleton.parent[b]
        if p < 0:
            turn, place = Rotation.from_rotvec(params[3:6]).as_matrix(), params[:3]
        else:
            turn = rotation[p] @ skeleton.rest_rotation[b]
            place = position[p] + rotation[p] @ skeleton.offset[b]
        for h in np.flatnonzero(skeleton.hinge_bone == b):
            turn = turn @ Rotation.from_rotvec(skeleton.hinge_axis[h] * params[6 + h]).as_matrix()
        rotation.append(turn)
        position.append(place)
    return BonePoses(np.asarray(params[:3]), np.stack(rotation), np.stack(position))
