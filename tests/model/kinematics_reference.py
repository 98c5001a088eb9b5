"""Plain NumPy kinematics, and the 2007 paper's own form of it: the references that the compiled one is held to."""

import numpy as np
from scipy.spatial.transform import Rotation

from handtrack.model.kinematics import BonePoses
from handtrack.model.skeleton import Skeleton


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


def paper_quaternion(x: np.ndarray) -> np.ndarray:
    """Eq. 5: (cos|x|, sin|x| x/|x|); |x| is half the angle turned."""
    size = np.linalg.norm(x)
    return np.concatenate([[np.cos(size)], np.sin(size) * x / size])


def paper_rotation(q: np.ndarray) -> np.ndarray:
    """Eq. 6, with the signs that the text extraction lost."""
    q0, qx, qy, qz = q
    return np.array(
        [
            [q0**2 + qx**2 - qy**2 - qz**2, 2 * (qx * qy - q0 * qz), 2 * (qx * qz + q0 * qy)],
            [2 * (qx * qy + q0 * qz), q0**2 - qx**2 + qy**2 - qz**2, 2 * (qy * qz - q0 * qx)],
            [2 * (qx * qz - q0 * qy), 2 * (qy * qz + q0 * qx), q0**2 - qx**2 - qy**2 + qz**2],
        ]
    )


def paper_quaternion_derivative(x: np.ndarray) -> np.ndarray:
    """Eqs. 37–39 → (4, 3). 0/0 at rest."""
    size = np.linalg.norm(x)
    d_size = x / size
    d0 = -np.sin(size) * d_size
    dv = np.outer(x, (np.cos(size) / size - np.sin(size) / size**2) * d_size)
    return np.vstack([d0, dv + np.sin(size) / size * np.eye(3)])


def paper_rotation_derivative(x: np.ndarray) -> np.ndarray:
    """Eqs. 36–39 → (3, 3, 3), last axis the state's component."""
    q0, qx, qy, qz = paper_quaternion(x)
    by_quaternion = 2 * np.array(
        [
            [[q0, -qz, qy], [qz, q0, -qx], [-qy, qx, q0]],
            [[qx, qy, qz], [qy, -qx, -q0], [qz, q0, -qx]],
            [[-qy, qx, q0], [qx, qy, qz], [-q0, qz, -qy]],
            [[-qz, -q0, qx], [q0, -qz, qy], [qx, qy, qz]],
        ]
    )
    return np.einsum("qij,qs->ijs", by_quaternion, paper_quaternion_derivative(x))
