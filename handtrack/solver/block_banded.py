"""One large system of many frames: blocks that touch their two neighbours on either side, and a border of what all frames share."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np

from handtrack.arrays import Array, Axes, F, Floats, K, L, N, P, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.solver import block_banded_kernels as kernels

REACH = 2
"""neighbours on either side that a block touches: an acceleration is of three frames"""
_AT_ONCE = 256
"""frames of an inverse that are made at once: all of them would be as large as the factor"""


@array_dataclass
class BlockBanded:
    """A symmetric matrix of F blocks (P, P), each beside its REACH next ones: the lower half of it."""

    blocks: Floats[F, L, P, P]
    """(F, REACH + 1, P, P): [t, k] is the block of row t + k and column t; those beyond the end count for nothing"""

    @classmethod
    def zero(cls, frames: int, size: int) -> BlockBanded:
        return cls(np.zeros((frames, REACH + 1, size, size)))

    def add(self, frames: Array[N], matrix: Floats[K, K]) -> None:
        """Add a symmetric matrix over the unknowns of frames that follow one another, at most REACH + 1 of them, in place."""
        size = self.blocks.shape[-1]
        parts = matrix.reshape(len(frames), size, len(frames), size)
        for column, t in enumerate(frames):
            for row in range(column, len(frames)):
                self.blocks[t, row - column] += parts[row, :, column]

    def factor(self, overwrite: bool = False) -> BandedFactor:
        """Return the factor by which systems are solved; overwrite: in the matrix's place. Raises HandtrackError where it has none."""
        lower = self.blocks if overwrite else self.blocks.copy()
        try:
            kernels.factor(lower)
        except np.linalg.LinAlgError:
            raise HandtrackError(
                "solver: the frames' system has a direction that nothing holds."
            ) from None
        return BandedFactor(lower)


@array_dataclass
class BandedFactor:
    """L with L Lᵀ the matrix."""

    lower: Floats[F, L, P, P]
    """its blocks, as `BlockBanded` has the matrix's, those of the diagonal inverted"""

    def solve(self, right: Floats[F, P, *Axes]) -> Floats[F, P, *Axes]:
        """Return x with the matrix times x being `right`."""
        found = np.array(right, float).reshape(*right.shape[:2], -1)
        kernels.solve(self.lower, found)
        return found.reshape(right.shape)

    def inverse_parts(self) -> Iterator[tuple[int, Floats[F, L, P, P]]]:
        """Yield the inverse's blocks where the matrix has any, as in `BlockBanded`: some frames at once and which is the first of them,
        from the last frames back.

        From the last block back (Takahashi, Fagan, Chen 1973): with G = L_below L_tt⁻¹, Σ_below,t = −Σ_below G and
        Σ_tt = (L_tt L_ttᵀ)⁻¹ + Gᵀ Σ_below G. As many operations as the factor took.
        """
        frames, reach = self.lower.shape[:2]
        after = np.empty((0, *self.lower.shape[1:]))
        for stop in range(frames, 0, -_AT_ONCE):
            first = max(stop - _AT_ONCE, 0)
            found = np.empty((stop - first + len(after), *self.lower.shape[1:]))
            found[stop - first :] = after
            kernels.inverse(self.lower[first : stop + len(after)], found, len(after))
            yield first, found[: stop - first]
            after = found[: reach - 1]


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
