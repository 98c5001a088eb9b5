"""Residuals with their derivatives by the bones' motion, of terms that are written with NumPy."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import D3, Axes, Floats, Ints, K, L, N
from handtrack.terms.bone_system import Sums


def motion_row(
    points: Floats[*Axes, D3], normals: Floats[*Axes, D3], reference: Floats[D3], width: int = 6
) -> Floats[*Axes, L]:
    """Return what the motion of X's bone adds to a measurement along n at X: [n ; (X − o) × n] by
    its twist, [n ; n (X − o)ᵀ] by its field, of twelve numbers; n alone by X's own velocity.

    Parameters
    ----------
    points, normals
        World, broadcast.
    """
    if width == 3:
        return normals
    arm = points - reference
    if width < 12:
        return np.concatenate([normals, np.cross(arm, normals)], axis=-1)
    outer = normals[..., None] * arm[..., None, :]
    return np.concatenate([normals, outer.reshape(*normals.shape[:-1], 9)], axis=-1)


def add_rows(
    sums: Sums, residual: Floats[N], bone: Ints[*Axes], motion: Floats[N, K, L], weight: Floats[N]
) -> None:
    """Add gradient Jᵀ W r and Hessian Jᵀ W J of residuals, each of which depends on K bones; nothing where derivatives are not wanted.

    Parameters
    ----------
    bone
        (K,) where they are the same for all residuals, else (N, K).
    motion
        Derivative of each residual by each of its bones' motion, see `motion_row`.
    weight
        dρ/d(r²).
    """
    if not sums.width:
        return
    count = len(residual)
    rows = np.zeros((count, len(sums.gradient) // sums.width, sums.width))
    np.add.at(rows, (np.arange(count)[:, None], bone), motion)
    rows = rows.reshape(count, -1)
    weighted = rows * weight[:, None]
    np.add(sums.gradient, weighted.T @ residual, out=sums.gradient)
    np.add(sums.hessian, weighted.T @ rows, out=sums.hessian)
