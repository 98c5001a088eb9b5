"""One large system of many frames: blocks that touch their two neighbours on either side, and a border of what all frames share.

A banded matrix, symmetric, stands as its lower half: blocks (F, REACH + 1, P, P), [t, k] of row t + k and column t; those beyond the
end count for nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property

import numpy as np

from handtrack.arrays import Axes, F, Floats, K, L, N, P, array_dataclass
from handtrack.errors import HandtrackError
from handtrack.solver import block_banded_kernels as kernels

REACH = 2
"""neighbours on either side that a block touches: an acceleration is of three frames"""
_AT_ONCE = 256
"""frames of an inverse that are made at once: all of them would be as large as the factor"""
_NUMBERS = 1 << 19
"""of a border that are made at once"""


@array_dataclass
class Bordered:
    """[[B, C], [Cᵀ, D]]: B of frames, banded, C and D of K unknowns that all frames share, eliminated last (Schur complement).

    K may be 0: the system is B's then.
    """

    lower: Floats[F, L, P, P]
    """L with L Lᵀ = B, banded as it is, the blocks of the diagonal inverted"""
    border: Callable[[slice], Floats[N, P, K]]
    """C of some frames, made when it is asked for: it is as large as the factor"""
    corner: Floats[K, K]
    """D"""

    @classmethod
    def of(
        cls,
        blocks: Floats[F, L, P, P],
        border: Callable[[slice], Floats[N, P, K]],
        corner: Floats[K, K],
    ) -> Bordered:
        """Return the system by which right sides are solved; the factor takes the place of B's blocks. Raises HandtrackError where B has none."""
        try:
            kernels.factor(blocks)
        except np.linalg.LinAlgError:
            raise HandtrackError(
                "solver: the frames' system has a direction that nothing holds."
            ) from None
        return cls(blocks, border, corner)

    def solve(self, own: Floats[F, P], shared: Floats[K]) -> tuple[Floats[F, P], Floats[K]]:
        """Return the unknowns of the frames and the shared ones for a right side of both."""
        alone = self.alone(own)
        found = self.covariance @ (shared - self._by_border(alone[:, :, None])[:, 0])
        return alone - self._follow @ found, found

    def alone(self, right: Floats[F, P, *Axes]) -> Floats[F, P, *Axes]:
        """Return x with B x being `right`."""
        found = self._solved(np.array(right, float).reshape(*right.shape[:2], -1))
        return found.reshape(right.shape)

    def inverse_parts(self) -> Iterator[tuple[int, Floats[F, L, P, P]]]:
        """Yield the blocks of B⁻¹ where B has any: some frames at once and which is the first of them, from the last frames back.

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

    @cached_property
    def covariance(self) -> Floats[K, K]:
        """The inverse's part of what is shared. Raises HandtrackError where a direction is held by nothing."""
        left = self.corner - self._by_border(self._follow)
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
        frames, _, size, _ = self.lower.shape
        found = np.empty((frames, size, len(self.corner)))
        for at in self._parts():
            found[at] = self.border(at)
        return self._solved(found)

    def _solved(self, right: Floats[F, P, N]) -> Floats[F, P, N]:
        """Return x with B x being `right`, in its place."""
        if right.size:
            kernels.solve(self.lower, right)
        return right

    def _by_border(self, right: Floats[F, P, N]) -> Floats[K, N]:
        """Return Cᵀ times a right side: the same sum however many frames there are at once."""
        count, columns = len(self.corner), right.shape[2]
        total = np.zeros((count, columns))
        for at in self._parts() if count else ():
            before = np.eye(count) if at.start else np.empty((0, count))
            rows = np.concatenate([before, self.border(at).reshape(-1, count)])
            own = np.concatenate([total[: len(before)], right[at].reshape(-1, columns)])
            total = np.einsum("rk,rl->kl", rows, own)
        return total

    def _parts(self) -> Iterator[slice]:
        frames, _, size, _ = self.lower.shape
        at_once = _NUMBERS // (size * max(len(self.corner), 1))
        for first in range(0, frames, at_once):
            yield slice(first, first + at_once)
