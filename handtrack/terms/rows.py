"""Rows: residuals with their derivatives by the bones' motion, of terms that are written with NumPy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Floats, Ints, K, L, N
from handtrack.terms.bone_system import Sums


def motion_row(
    points: Floats[N, D3], normals: Floats[N, D3], reference: Floats[D3], width: int = 6
) -> Floats[N, L]:
    """Return what the motion of X's bone adds to a measurement along n at X: [n ; (X − o) × n] by
    its twist, [n ; n (X − o)ᵀ] by its field, of twelve numbers; n alone by X's own velocity.

    Parameters
    ----------
    points, normals
        World.
    """
    if width == 3:
        return normals
    arm = points - reference
    if width < 12:
        return np.concatenate([normals, np.cross(arm, normals)], axis=-1)
    outer = normals[..., None] * arm[..., None, :]
    return np.concatenate([normals, outer.reshape(*normals.shape[:-1], 9)], axis=-1)


@dataclass(frozen=True)
class Rows:
    """Residuals (N,), and one entry for each bone that a residual depends on."""

    residual: Floats[N]
    row: Ints[K]
    """which residual an entry belongs to"""
    bone: Ints[K]
    motion: Floats[K, L]
    """derivative of the residual by that bone's motion, see `motion_row`"""
    cost: float
    """½ Σ ρ(r²)"""
    weight: Floats[N]
    """dρ/d(r²)"""

    def add_to(self, sums: Sums) -> float:
        """Add gradient Jᵀ W r and Hessian Jᵀ W J; return the cost."""
        if sums.width and len(self.residual):
            dense = np.zeros((len(self.residual), len(sums.gradient) // sums.width, sums.width))
            np.add.at(dense, (self.row, self.bone), self.motion)
            flat = dense.reshape(len(self.residual), -1)
            weighted = flat * self.weight[:, None]
            np.add(sums.gradient, weighted.T @ self.residual, out=sums.gradient)
            np.add(sums.hessian, weighted.T @ flat, out=sums.hessian)
        return self.cost
