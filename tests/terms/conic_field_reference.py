"""The field of the 2007 paper, every pixel of it, with a dense Jacobian by bone twists. Plain NumPy: slopes are by complex steps."""

from typing import NamedTuple

import numpy as np

from handtrack.terms.term import JointSystem

STEP = 1e-20
"""so small that a function of x + i·STEP is its value plus i·STEP times its slope, to the last digit"""


class DenseField(NamedTuple):
    """P (N,) and Z (N,) of all cameras' valid pixels, and dP/dξ (N, 6B)."""

    predicted: np.ndarray
    observed: np.ndarray
    jacobian: np.ndarray

    def system(self, weight=1.0):
        residual = self.predicted - self.observed
        return JointSystem(
            0.5 * weight * float(residual @ residual),
            weight * self.jacobian.T @ residual,
            weight * self.jacobian.T @ self.jacobian,
        )


def placed(rotation, position):
    """Return (4, 4) where a rotation and a position put what they carry."""
    return np.block([[rotation, position[:, None]], [np.zeros(3), 1.0]])


def twisted(reference):
    """Return (6, 4, 4) a step along each twist (v, ω) about `reference`."""
    out = np.tile(np.eye(4, dtype=complex), (6, 1, 1))
    for k, axis in enumerate(np.eye(3)):
        out[k, :3, 3] += 1j * STEP * axis
        out[3 + k, :3, :3] += 1j * STEP * np.cross(axis, np.eye(3)).T
        out[3 + k, :3, 3] -= 1j * STEP * np.cross(axis, reference)
    return out


def dense_field(silhouettes, ellipsoids, bones, levels=None, clamp=False, depth_scaled=False):
    """Return the dense field of all valid pixels. levels: (C, E, 2) the ramp's t and s."""
    parts = [
        _camera_field(s, ellipsoids, bones, None if levels is None else levels[i], clamp, depth_scaled)
        for i, s in enumerate(silhouettes)
    ]  # fmt: skip
    return DenseField(*(np.concatenate(p) for p in zip(*parts, strict=True)))


def _camera_field(silhouette, ellipsoids, bones, levels, clamp, depth_scaled):
    plain, observed = silhouette.camera.projection, -silhouette.mask.astype(float)
    columns = np.arange(silhouette.camera.size[0])
    valid = (columns >= silhouette.valid[:, :1]) & (columns < silhouette.valid[:, 1:])
    rows, columns = np.nonzero(valid & (observed <= 0))
    lowest = np.zeros(len(rows))  # eq. 18: 0 where no field is negative
    jacobian = np.zeros((len(rows), 6 * len(bones.position)))
    for e, bone in enumerate(ellipsoids.bone):
        pose = placed(bones.rotation[bone], bones.position[bone])
        at = pose @ placed(ellipsoids.rotation[e], ellipsoids.centre[e])  # eq. 11
        u, v, depth = plain @ at[:, 3]
        # pixels are counted from the ellipsoid's own place: the inverses below stay well conditioned
        u, v = (u / depth, v / depth) if depth > 0 else (0.0, 0.0)
        seen = (
            np.array([[1.0, 0, -u], [0, 1, -v], [0, 0, 1]]) @ plain @ twisted(bones.reference) @ at
        )
        quadric = np.diag([*ellipsoids.radii[e] ** 2, -1.0])
        dual = seen @ quadric @ seen.swapaxes(1, 2)  # eqs. 15, 16
        if depth <= 0 or dual[0, 2, 2].real >= -1e-6 * depth**2:
            continue  # not all of it is before the camera's plane
        conic = np.linalg.inv(dual)  # eq. 17
        if not depth_scaled:
            conic *= -dual[:, 2, 2, None, None]
        if levels is not None:
            conic = levels[e, 1] * (conic - levels[e, 0] * np.diag([0, 0, 1.0]))
        m = np.stack([columns - u, rows - v, np.ones(len(rows))], axis=1)
        value = np.einsum("pi,kij,pj->pk", m, conic, m)
        wins = value[:, 0].real < lowest  # eqs. 19, 23
        lowest[wins] = value[wins, 0].real
        jacobian[wins] = 0.0
        jacobian[wins, 6 * bone : 6 * bone + 6] = value[wins].imag / STEP
    if clamp:
        jacobian[lowest <= -1.0] = 0.0
        lowest = np.maximum(lowest, -1.0)
    return lowest, observed[rows, columns], jacobian
