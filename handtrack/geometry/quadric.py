"""Ellipsoid ↔ quadric ↔ dual quadric, the conic it shows in a camera, and that conic's twist derivative.

The plain form of what `terms/silhouettes/silhouette_kernels.py` computes. Sign: a quadric or conic is negative inside, so that the
dual is positive across and negative along the viewing ray. 2007 paper, eqs. 10–17 and 25–29.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from handtrack.arrays import Array, Floats
from handtrack.errors import HandtrackError

CONIC_INDEX = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
"""Order of a conic's six numbers; they belong to the monomials (u², 2uv, v², 2u, 2v, 1)."""

_TURNS = np.swapaxes(np.cross(np.eye(3)[:, None], np.eye(3)[None]), 1, 2)  # (3, 3, 3): [e_k]


class ConicTwist(NamedTuple):
    """Conics (E, 3, 3) and their derivatives (E, 6, 3, 3) by the twist (v, ω) of the ellipsoid's bone."""

    value: Floats
    by_twist: Floats


def shape_matrix(rotation: Floats, radii: Floats) -> Floats:
    """Return D = R diag(r²) Rᵀ (..., 3, 3) of axes (..., 3, 3) and semi-axes (..., 3) [m]."""
    return (rotation * radii[..., None, :] ** 2) @ np.swapaxes(rotation, -1, -2)


def ellipsoid_quadric(centre: Floats, rotation: Floats, radii: Floats) -> Floats:
    """Return Q (..., 4, 4): MᵀQM is −1 at the centre, 0 on the surface. centre: (..., 3) world [m]; eqs. 10–12."""
    inner = (rotation / radii[..., None, :] ** 2) @ np.swapaxes(rotation, -1, -2)
    side = -np.einsum("...ij,...j->...i", inner, centre)
    quadric = np.empty((*centre.shape[:-1], 4, 4))
    quadric[..., :3, :3] = inner
    quadric[..., :3, 3] = quadric[..., 3, :3] = side
    quadric[..., 3, 3] = -np.einsum("...i,...i->...", side, centre) - 1.0
    return quadric


def ellipsoid_dual(centre: Floats, rotation: Floats, radii: Floats) -> Floats:
    """Return Q* = Q⁻¹ (..., 4, 4), well defined for flat ellipsoids too; eq. 16."""
    dual = np.empty((*centre.shape[:-1], 4, 4))
    dual[..., :3, :3] = shape_matrix(rotation, radii) - centre[..., :, None] * centre[..., None, :]
    dual[..., :3, 3] = dual[..., 3, :3] = -centre
    dual[..., 3, 3] = -1.0
    return dual


def quadric_ellipsoid(quadric: Floats) -> tuple[Floats, Floats, Floats]:
    """Return centre (3,), rotation (3, 3) and semi-axes (3,) ascending of an ellipsoid's quadric (4, 4), any scale.

    Raises HandtrackError when the quadric is no ellipsoid.
    """
    block, side = quadric[:3, :3], quadric[:3, 3]
    values, axes = np.linalg.eigh(block)
    if np.all(values < 0):
        return quadric_ellipsoid(-quadric)
    if not np.all(values > 1e-14 * np.abs(values).max()):
        raise HandtrackError(
            f"the quadric is no ellipsoid: eigenvalues {values.tolist()} differ in sign or vanish."
        )
    centre: Floats = -np.linalg.solve(block, side)  # type: ignore[assignment]
    level = -(quadric[3, 3] + side @ centre)
    if level <= 0:
        raise HandtrackError("the quadric is no ellipsoid: it has no real point.")
    order = np.argsort(-values)
    rotation = axes[:, order]
    rotation[:, 2] *= np.sign(np.linalg.det(rotation))
    return centre, rotation, np.sqrt(level / values[order])


def dual_conic(
    projection: Floats, centre: Floats, shape: Floats, reference: Floats | None = None
) -> ConicTwist:
    """Return C* = G D Gᵀ − p pᵀ with p = G c + h, and its twist derivative; eqs. 15 and 26.

    projection: (3, 4) = [G|h]; centre: (E, 3), shape D: (E, 3, 3), world [m]; reference: (3,) the point o that twists
    are taken about, by default the world's origin.
    """
    g, h = projection[:, :3], projection[:, 3]
    arm = centre - (np.zeros(3) if reference is None else reference)
    p = centre @ g.T + h
    value = g @ shape @ g.T - p[:, :, None] * p[:, None, :]
    turned = np.einsum("kij,ejl->ekil", _TURNS, shape)
    turn = g @ (turned + np.swapaxes(turned, 2, 3)) @ g.T
    dp = np.concatenate(
        [np.broadcast_to(g.T, (len(p), 3, 3)), np.einsum("kij,ej,li->ekl", _TURNS, arm, g)], axis=1
    )
    outer = dp[..., :, None] * p[:, None, None, :]
    by_twist = -(outer + np.swapaxes(outer, 2, 3))
    by_twist[:, 3:] += turn
    return ConicTwist(value, by_twist)


def is_ellipse(projection: Floats, centre: Floats, shape: Floats) -> Array:
    """Return (E,) True where the ellipsoid lies wholly before the camera's plane, so that it shows as an ellipse."""
    depth = centre @ projection[2, :3] + projection[2, 3]
    reach = np.einsum("i,eij,j->e", projection[2, :3], shape, projection[2, :3])
    return (depth > 0) & (depth**2 - reach > 1e-6 * depth**2)


def conic(dual: ConicTwist) -> ConicTwist:
    """Return C = (C*)⁻¹, negative inside, the paper's depth-ordered scale: 1/C*₃₃ at the centre; eqs. 17 and 25."""
    value: Floats = np.linalg.inv(dual.value)  # type: ignore[assignment]
    by_twist = -value[:, None] @ dual.by_twist @ value[:, None]
    return ConicTwist(value, by_twist)


def normalised_conic(dual: ConicTwist) -> ConicTwist:
    """Return −C*₃₃ C: −1 at the ellipse's centre, 0 on its outline."""
    plain = conic(dual)
    gamma = dual.value[:, 2, 2][:, None, None]
    d_gamma = dual.by_twist[:, :, 2, 2][..., None, None]
    return ConicTwist(
        -gamma * plain.value, -d_gamma * plain.value[:, None] - gamma[:, None] * plain.by_twist
    )


def conic_vector(matrix: Floats) -> Floats:
    """Return the six numbers (..., 6) of symmetric (..., 3, 3), in the order of CONIC_INDEX."""
    return np.stack([matrix[..., i, j] for i, j in CONIC_INDEX], axis=-1)


def monomials(u: Floats, v: Floats) -> Floats:
    """Return (..., 6) with which a conic's six numbers give its value at (u, v)."""
    return np.stack([u * u, 2 * u * v, v * v, 2 * u, 2 * v, np.ones_like(u)], axis=-1)


def ellipse(dual: Floats) -> tuple[Floats, Floats]:
    """Return centres m (E, 2) and shapes S (E, 2, 2) of dual conics (E, 3, 3): (x − m)ᵀ S⁻¹ (x − m) = 1 on the outline."""
    scaled = dual / dual[:, 2:, 2:]
    centre = scaled[:, :2, 2]
    return centre, centre[:, :, None] * centre[:, None, :] - scaled[:, :2, :2]
