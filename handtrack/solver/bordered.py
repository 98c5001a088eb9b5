"""A large system of many frames with a border: what all frames share."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from handtrack.arrays import F, Floats, K, P, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.solver.block_banded import BandedFactor


@array_dataclass
class Bordered:
    """[[B, C], [Cᵀ, D]]: B of frames, C and D of K unknowns that all frames share, eliminated last (Schur complement).

    K may be 0: the system is B's then.
    """

    frames: BandedFactor
    """of B"""
    border: Floats[F, P, K]
    """C"""
    corner: Floats[K, K]
    """D"""

    def solve(self, own: Floats[F, P], shared: Floats[K]) -> tuple[Floats[F, P], Floats[K]]:
        """Return the unknowns of the frames and the shared ones for a right side of both."""
        alone = self.frames.solve(own)
        found = self.covariance @ (shared - np.einsum("fpk,fp->k", self.border, alone))
        return alone - self._follow @ found, found

    @cached_property
    def covariance(self) -> Floats[K, K]:
        """The inverse's part of what is shared. Raises HandtrackError where a direction is held by nothing."""
        left = self.corner - np.einsum("fpk,fpl->kl", self.border, self._follow)
        left = 0.5 * (left + left.T)
        # unknowns differ in units: scaled alike before it is told whether one is held
        scale = np.sqrt(np.maximum(np.diag(self.corner), 1e-300))
        try:
            root = np.linalg.inv(np.linalg.cholesky(left / np.outer(scale, scale))) / scale
        except np.linalg.LinAlgError:
            raise HandtrackError(
                "solver: what all frames share has a direction that nothing holds."
            ) from None
        return root.T @ root

    def spread(self, frame: int, ahead: int = 0) -> Floats[P, P]:
        """Return what the shared unknowns' doubt adds to the inverse's block of row `frame` + `ahead` and column `frame`."""
        return self._follow[frame + ahead] @ self.covariance @ self._follow[frame].T

    @cached_property
    def _follow(self) -> Floats[F, P, K]:
        """B⁻¹ C: by how much frames give way to what is shared, with a minus."""
        return self.frames.solve(self.border) if self.border.size else self.border
