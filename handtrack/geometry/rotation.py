"""Rotation vectors, matrices and quaternions, with derivatives that hold at zero.

A rotation vector here carries the *full* angle: ‖r‖ is the angle turned. The 2007 paper's quaternion
(cos‖x‖, sin‖x‖ x/‖x‖) turns by 2‖x‖, so its state is half of ours; see docs/derivations/rotations.md.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from handtrack.arrays import D3, D4, Axes, Floats

_SERIES_BELOW = 1e-4  # [rad]; the dropped terms are below 1e-17 there


def skew(vector: Floats[*Axes, D3]) -> Floats[*Axes, D3, D3]:
    """Return the matrix [v] with [v] a = v × a."""
    vector = np.asarray(vector, dtype=float)
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape(*vector.shape[:-1], 3, 3)


def rotation_matrix(rotvec: Floats[*Axes, D3]) -> Floats[*Axes, D3, D3]:
    """Return the matrices of rotation vectors [rad]."""
    rotvec = np.asarray(rotvec, dtype=float)
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = angle < _SERIES_BELOW
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1 - angle**2 / 6, np.sin(safe) / safe)
    b = np.where(small, 0.5 - angle**2 / 24, (1 - np.cos(safe)) / safe**2)
    cross = skew(rotvec)
    return np.eye(3) + a * cross + b * (cross @ cross)


def rotation_vector(matrix: Floats[*Axes, D3, D3]) -> Floats[*Axes, D3]:
    """Return the rotation vectors, angle in [0, π], of rotation matrices."""
    matrix = np.asarray(matrix, dtype=float)
    flat = Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_rotvec()
    return flat.reshape(*matrix.shape[:-2], 3)


def left_jacobian(rotvec: Floats[D3]) -> Floats[D3, D3]:
    """Return J with: rotvec + δ turns like exp(J δ) · exp(rotvec), to first order in δ.

    rotvec: [rad]. Replaces eqs. 33–39 of the 2007 paper, also at rest, where those are 0/0.
    """
    angle = float(np.linalg.norm(rotvec))
    cross = skew(rotvec)
    if angle < _SERIES_BELOW:
        return np.eye(3) + 0.5 * cross + (cross @ cross) / 6
    a = (1 - np.cos(angle)) / angle**2
    b = (angle - np.sin(angle)) / angle**3
    return np.eye(3) + a * cross + b * (cross @ cross)


def quaternion_wxyz(matrix: Floats[*Axes, D3, D3]) -> Floats[*Axes, D4]:
    """Return unit quaternions (w, x, y, z) of rotation matrices."""
    matrix = np.asarray(matrix, dtype=float)
    xyzw = Rotation.from_matrix(matrix.reshape(-1, 3, 3)).as_quat()
    return np.roll(xyzw, 1, axis=-1).reshape(*matrix.shape[:-2], 4)


def matrix_from_quaternion(wxyz: Floats[*Axes, D4]) -> Floats[*Axes, D3, D3]:
    """Return the rotation matrices of quaternions (w, x, y, z)."""
    wxyz = np.asarray(wxyz, dtype=float)
    flat = Rotation.from_quat(np.roll(wxyz.reshape(-1, 4), -1, axis=-1)).as_matrix()
    return flat.reshape(*wxyz.shape[:-1], 3, 3)


def wrapped(rotvec: Floats[D3]) -> Floats[D3]:
    """Return the same rotation with an angle of at most π. rotvec: [rad]."""
    angle = float(np.linalg.norm(rotvec))
    if angle <= np.pi:
        return np.array(rotvec, dtype=float)
    turns = np.round(angle / (2 * np.pi))
    return np.asarray(rotvec) * (1 - 2 * np.pi * turns / angle)


def closest_equivalent(rotvec: Floats[D3], to: Floats[D3]) -> Floats[D3]:
    """Return the rotation vector of the same rotation that lies closest to `to`. Both [rad]."""
    angle = float(np.linalg.norm(rotvec))
    if angle < 1e-9:
        return np.array(rotvec, dtype=float)
    axis = np.asarray(rotvec) / angle
    turns = np.round((axis @ np.asarray(to) - angle) / (2 * np.pi))
    return axis * (angle + 2 * np.pi * turns)
