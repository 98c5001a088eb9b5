"""The ellipse that an ellipsoid shows in a camera, by its dual conic. 2007 paper, eqs. 10–17.

A conic is negative inside, so that its dual is positive across and negative along the viewing ray.
"""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D2, D3, D4, Array, Axes, E, Floats


def shape_matrix(
    rotation: Floats[*Axes, D3, D3], radii: Floats[*Axes, D3]
) -> Floats[*Axes, D3, D3]:
    """Return D = R diag(r²) Rᵀ of axes and semi-axes [m]."""
    return (rotation * radii[..., None, :] ** 2) @ np.swapaxes(rotation, -1, -2)


def dual_conic(
    projection: Floats[D3, D4], centre: Floats[E, D3], shape: Floats[E, D3, D3]
) -> Floats[E, D3, D3]:
    """Return C* = G D Gᵀ − p pᵀ with p = G c + h; eq. 15.

    Parameters
    ----------
    projection
        [G|h]; centre, shape D: world [m].
    """
    g, h = projection[:, :3], projection[:, 3]
    p = centre @ g.T + h
    return g @ shape @ g.T - p[:, :, None] * p[:, None, :]


def is_ellipse(
    projection: Floats[D3, D4], centre: Floats[E, D3], shape: Floats[E, D3, D3]
) -> Array[E]:
    """Return True where the ellipsoid lies wholly before the camera's plane, so that it shows as an ellipse."""
    depth = centre @ projection[2, :3] + projection[2, 3]
    reach = np.einsum("i,eij,j->e", projection[2, :3], shape, projection[2, :3])
    return (depth > 0) & (depth**2 - reach > 1e-6 * depth**2)


def ellipse(dual: Floats[E, D3, D3]) -> tuple[Floats[E, D2], Floats[E, D2, D2]]:
    """Return centres m and shapes S of dual conics: (x − m)ᵀ S⁻¹ (x − m) = 1 on the outline."""
    scaled = dual / dual[:, 2:, 2:]
    centre = scaled[:, :2, 2]
    return centre, centre[:, :, None] * centre[:, None, :] - scaled[:, :2, :2]
