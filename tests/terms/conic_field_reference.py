"""Eqs. 10–29 of the 2007 paper, written as they stand: every pixel, a dense Jacobian by bone twists. Plain NumPy."""

from typing import NamedTuple

import numpy as np

from handtrack.terms.bone_system import JointSystem


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


def twist_generators(reference):
    """Return (6, 4, 4): dT = generator · T for a twist (v, ω) about `reference`."""
    out = np.zeros((6, 4, 4))
    for k in range(3):
        axis = np.eye(3)[k]
        out[k, :3, 3] = axis
        out[3 + k, :3, :3] = np.cross(axis, np.eye(3)).T
        out[3 + k, :3, 3] = -np.cross(axis, reference)
    return out


def ellipsoid_conics(camera_matrix, bones, ellipsoids, e):
    """Return C* (3, 3) of ellipsoid e and its derivatives (6, 3, 3); eqs. 10–12, 15–16, 26–29."""
    pose, local = np.eye(4), np.eye(4)
    bone = ellipsoids.bone[e]
    pose[:3, :3], pose[:3, 3] = bones.rotation[bone], bones.position[bone]
    local[:3, :3], local[:3, 3] = ellipsoids.rotation[e], ellipsoids.centre[e]
    transform = pose @ local  # eq. 11
    back = np.linalg.inv(transform)
    quadric = np.diag(np.append(1 / ellipsoids.radii[e] ** 2, -1.0))  # eq. 10
    moved = back.T @ quadric @ back  # eq. 12
    dual = np.linalg.inv(moved)  # eq. 16
    d_back = -back @ (twist_generators(bones.reference) @ transform) @ back  # eq. 29
    d_moved = np.swapaxes(d_back, 1, 2) @ quadric @ back + back.T @ quadric @ d_back  # eq. 28
    d_dual = -dual @ d_moved @ dual  # eq. 27
    # eqs. 15, 26
    return (camera_matrix @ dual @ camera_matrix.T, camera_matrix @ d_dual @ camera_matrix.T)


def is_seen(conic_dual, camera_matrix, centre):
    """Return whether the whole ellipsoid is before the camera's plane."""
    depth = camera_matrix[2] @ np.append(centre, 1.0)
    return depth > 0 and conic_dual[2, 2] < -1e-6 * depth**2


def dense_field(
    silhouettes, ellipsoids, bones, levels=None, clamp=False, depth_scaled=False, observed=None
):
    """Return the dense field of all valid pixels. levels: (C, E, 2) the ramp's t and s; observed: list of (H, W)."""
    parts = [
        _camera_field(s, ellipsoids, bones, None if levels is None else levels[i], clamp, depth_scaled,
                      -s.mask.astype(float) if observed is None else observed[i])
        for i, s in enumerate(silhouettes)
    ]  # fmt: skip
    return DenseField(*(np.concatenate(p) for p in zip(*parts, strict=True)))


def _camera_field(silhouette, ellipsoids, bones, levels, clamp, depth_scaled, observed):
    width = silhouette.camera.size[0]
    rows, columns = np.nonzero(
        (np.arange(width) >= silhouette.valid[:, :1])
        & (np.arange(width) < silhouette.valid[:, 1:])
        & (observed <= 0)
    )
    lowest = np.zeros(len(rows))  # eq. 18: 0 where no field is negative
    jacobian = np.zeros((len(rows), 6 * len(bones.position)))
    for e in range(len(ellipsoids)):
        bone = ellipsoids.bone[e]
        centre = bones.position[bone] + bones.rotation[bone] @ ellipsoids.centre[e]
        plain = silhouette.camera.projection
        at = plain @ np.append(centre, 1.0)
        # pixels are counted from the ellipsoid's own place: the inverses below stay well conditioned
        origin = at[:2] / at[2] if at[2] > 0 else np.zeros(2)
        shift = np.array([[1.0, 0, -origin[0]], [0, 1, -origin[1]], [0, 0, 1]])
        dual, d_dual = ellipsoid_conics(shift @ plain, bones, ellipsoids, e)
        if not is_seen(dual, plain, centre):
            continue
        conic = np.linalg.inv(dual)  # eq. 17
        d_conic = -conic @ d_dual @ conic  # eq. 25
        if not depth_scaled:
            d_conic = -d_dual[:, 2, 2][:, None, None] * conic - dual[2, 2] * d_conic
            conic = -dual[2, 2] * conic
        if levels is not None:
            conic = levels[e, 1] * (conic - levels[e, 0] * np.diag([0, 0, 1.0]))
            d_conic = levels[e, 1] * d_conic
        m = np.stack([columns - origin[0], rows - origin[1], np.ones(len(rows))], axis=1)
        value = np.einsum("pi,ij,pj->p", m, conic, m)
        wins = value < lowest  # eqs. 19, 23
        lowest[wins] = value[wins]
        jacobian[wins] = 0.0
        # eq. 24
        jacobian[wins, 6 * bone : 6 * bone + 6] = np.einsum(
            "pi,kij,pj->pk", m[wins], d_conic, m[wins]
        )
    if clamp:
        jacobian[lowest <= -1.0] = 0.0
        lowest = np.maximum(lowest, -1.0)
    return lowest, observed[rows, columns], jacobian
