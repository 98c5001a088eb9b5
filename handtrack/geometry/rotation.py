"""Rotation vectors, matrices and quaternions, with derivatives that hold at zero.

A rotation vector here carries the *full* angle: ‖r‖ is the angle turned. The 2007 paper's quaternion
(cos‖x‖, sin‖x‖ x/‖x‖) turns by 2‖x‖, so its state is half of ours; see docs/explanation/model.md.
"""

from __future__ import annotations

import math
import warnings

import numpy as np

from handtrack.arrays import D3, D4, Axes, Floats, N

_SERIES_BELOW = 1e-4  # [rad]; the dropped terms are below 1e-17 there
_HALF_SERIES_BELOW = 1e-3  # [rad]
_NO_ROTATION = 1e-12 + 1e-5 * np.eye(
    3
)  # further from R Rᵀ = 1 a matrix gives way to the nearest rotation


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
    quaternion = quaternion_wxyz(matrix)
    flat = quaternion.reshape(-1, 4)
    flat = np.where(flat[:, :1] < 0, -flat, flat)
    scales = [_twice_angle_by_sine(*row) for row in flat.tolist()]
    return (np.reshape(scales, (-1, 1)) * flat[:, 1:]).reshape(*quaternion.shape[:-1], 3)


def _twice_angle_by_sine(w: float, x: float, y: float, z: float) -> float:
    """Return by what a unit quaternion's vector part is multiplied to give the rotation vector. w: not negative."""
    angle = 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), w)
    if angle <= _HALF_SERIES_BELOW:
        return 2.0 + angle * angle / 12.0 + 7.0 * angle * angle * angle * angle / 2880.0
    return angle / math.sin(angle / 2.0)


def euler_angles(matrix: Floats[*Axes, D3, D3], order: str) -> Floats[*Axes, D3]:
    """Return the angles [rad] of R = Rz Rx Ry for order "ZXY", of R = Rz Ry Rx for "xyz": SciPy's words. NaN where R is."""
    from scipy.spatial.transform import Rotation

    flat = np.reshape(matrix, (-1, 3, 3))
    known = np.isfinite(flat).all(axis=(1, 2))
    angles = np.full((len(flat), 3), np.nan)
    with warnings.catch_warnings():
        warnings.filterwarnings(
            "ignore", "Gimbal lock"
        )  # the third angle is 0 there, which is as right as any
        if known.any():
            angles[known] = Rotation.from_matrix(flat[known]).as_euler(order)
    return angles.reshape(np.shape(matrix)[:-1])


def left_jacobian(rotvec: Floats[*Axes, D3]) -> Floats[*Axes, D3, D3]:
    """Return J with: rotvec + δ turns like exp(J δ) · exp(rotvec), to first order in δ.

    Replaces eqs. 33–39 of the 2007 paper, also at rest, where those are 0/0.

    Parameters
    ----------
    rotvec
        [rad].
    """
    rotvec = np.asarray(rotvec, dtype=float)
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    small = angle < _SERIES_BELOW
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    b = np.where(small, 1.0 / 6.0, (safe - np.sin(safe)) / safe**3)
    cross = skew(rotvec)
    return np.eye(3) + a * cross + b * (cross @ cross)


def quaternion_wxyz(matrix: Floats[*Axes, D3, D3]) -> Floats[*Axes, D4]:
    """Return unit quaternions (w, x, y, z) of rotation matrices."""
    matrix = np.asarray(matrix, dtype=float)
    flat = _orthogonal(matrix.reshape(-1, 3, 3))
    diagonal = flat[:, range(3), range(3)]
    trace = diagonal[:, 0] + diagonal[:, 1] + diagonal[:, 2]
    largest = np.argmax(np.column_stack([diagonal, trace]), axis=1)
    quaternion = np.empty((len(flat), 4))
    for i in set(
        largest.tolist()
    ):  # by the largest of the four, so that nothing small is divided by
        rows, j, k = largest == i, (i + 1) % 3, (i + 2) % 3
        m = flat[rows]
        if i == 3:
            quaternion[rows, 0] = 1.0 + trace[rows]
            quaternion[rows, 1] = m[:, 2, 1] - m[:, 1, 2]
            quaternion[rows, 2] = m[:, 0, 2] - m[:, 2, 0]
            quaternion[rows, 3] = m[:, 1, 0] - m[:, 0, 1]
            continue
        quaternion[rows, 0] = m[:, k, j] - m[:, j, k]
        quaternion[rows, 1 + i] = 1.0 - trace[rows] + 2.0 * m[:, i, i]
        quaternion[rows, 1 + j] = m[:, j, i] + m[:, i, j]
        quaternion[rows, 1 + k] = m[:, k, i] + m[:, i, k]
    return _unit(quaternion).reshape(*matrix.shape[:-2], 4)


def _orthogonal(matrix: Floats[N, D3, D3]) -> Floats[N, D3, D3]:
    """Return the matrices with those that are no rotations replaced by the nearest ones."""
    gram = np.einsum("nij,nkj->nik", matrix, matrix)
    off = (np.abs(gram - np.eye(3)) > _NO_ROTATION).any(axis=(1, 2))
    if not off.any():
        return matrix
    u, _, vt = np.linalg.svd(matrix[off])
    nearest = matrix.copy()
    nearest[off] = u @ vt
    return nearest


def _unit(quaternion: Floats[N, D4]) -> Floats[N, D4]:
    w, x, y, z = quaternion.T
    return quaternion / np.sqrt(x * x + y * y + z * z + w * w)[:, None]


def matrix_from_quaternion(wxyz: Floats[*Axes, D4]) -> Floats[*Axes, D3, D3]:
    """Return the rotation matrices of quaternions (w, x, y, z)."""
    wxyz = np.asarray(wxyz, dtype=float)
    w, x, y, z = _unit(wxyz.reshape(-1, 4)).T
    rows = [
        x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w),
        2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w),
        2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w,
    ]  # fmt: skip
    return np.stack(rows, axis=-1).reshape(*wxyz.shape[:-1], 3, 3)


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


def turn_between(points: Floats[N, D3], targets: Floats[N, D3]) -> Floats[D3, D3]:
    """Return the rotation that brings points about the origin nearest to others (Kabsch 1976)."""
    u, _, vt = np.linalg.svd(targets.T @ points)
    return u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt)) or 1.0]) @ vt


def axes_along(along: Floats[D3], up: Floats[D3]) -> Floats[D3, D3]:
    """Return a bone's axes, as columns: y along a direction, z as near to `up` as can be."""
    y = along / np.linalg.norm(along)
    z = up - y * (up @ y)
    z /= np.linalg.norm(z)
    return np.stack([np.cross(y, z), y, z], axis=1)


def looking_along(axis: Floats[D3], down: Floats[D3]) -> Floats[D3, D3]:
    """Return R_camera_world of a camera that looks along a unit vector, its columns as near to `down` as can be."""
    right = np.cross(down, axis)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(axis, right), axis])


_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041


def spread_rotations(count: int) -> Floats[N, D3, D3]:
    """Return rotation matrices (count, 3, 3), the same each time, about as far from each other as they can be.

    Super-Fibonacci spirals: Alexa (2022), "Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3)", CVPR;
    ψ⁴ = ψ + 4, φ² = 2.
    """
    s = np.arange(count) + 0.5
    inner, outer = np.sqrt(s / count), np.sqrt(1.0 - s / count)
    alpha, beta = 2 * np.pi * s / _PHI, 2 * np.pi * s / _PSI
    quaternion = np.stack(
        [inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta)],
        axis=-1,
    )
    return matrix_from_quaternion(quaternion)


def turned_by(a: Floats[*Axes, D3, D3], b: Floats[*Axes, D3, D3]) -> Floats[*Axes]:
    """Return the angles [rad] between rotations, broadcast."""
    trace = np.einsum("...ij,...ij->...", a, b)
    return np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
