"""Rows: residuals with their derivatives in bone twists, summed into a BoneSystem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, D6, D12, Floats, Ints, K, L, N
from handtrack.terms.bone_system import BoneSystem


def point_row(
    points: Floats[N, D3], normals: Floats[N, D3], reference: Floats[D3]
) -> Floats[N, D6]:
    """Return [n ; (X − o) × n], what a twist of X's bone adds to a measurement along n at X.

    points, normals: world.
    """
    return np.concatenate([normals, np.cross(points - reference, normals)], axis=-1)


def field_row(
    points: Floats[N, D3], normals: Floats[N, D3], reference: Floats[D3]
) -> Floats[N, D12]:
    """Return [n ; n (X − o)ᵀ], what the field (v, G) of X's bone adds."""
    outer = normals[..., None] * (points - reference)[..., None, :]
    return np.concatenate([normals, outer.reshape(*normals.shape[:-1], 9)], axis=-1)


@dataclass(frozen=True)
class Rows:
    """Residuals (N,), and one entry (6,) or (12,) for each bone that a residual depends on."""

    residual: Floats[N]
    row: Ints[K]
    """which residual an entry belongs to"""
    bone: Ints[K]
    twist: Floats[K, L]
    """(K, 6) derivative of the residual by that bone's twist, or (K, 12) by its field"""
    cost: float
    """½ Σ ρ(r²)"""
    weight: Floats[N]
    """dρ/d(r²)"""

    def bone_system(self, bone_count: int) -> BoneSystem:
        """Return the sum over rows: gradient Jᵀ W r and Hessian Jᵀ W J in bone twists."""
        width = self.twist.shape[1]
        dense = np.zeros((len(self.residual), bone_count, width))
        np.add.at(dense, (self.row, self.bone), self.twist)
        flat = dense.reshape(len(self.residual), width * bone_count)
        weighted = flat * self.weight[:, None]
        return BoneSystem(self.cost, weighted.T @ self.residual, weighted.T @ flat)
