"""One large system of many frames: blocks that touch their two neighbours on either side."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from handtrack.arrays import Array, Axes, F, Floats, K, L, N, P
from handtrack.errors import HandtrackError

REACH = 2
"""neighbours on either side that a block touches: an acceleration is of three frames"""


@dataclass(frozen=True, eq=False)
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

    def factor(self) -> BandedFactor:
        """Return the factor by which systems are solved. Raises HandtrackError where the matrix has none."""
        frames, reach, size, _ = self.blocks.shape
        wide = min(reach, frames) * size
        band = np.zeros((wide, frames * size))  # band[k, c] is row c + k of column c
        column = np.arange(frames * size).reshape(frames, size)
        inner = np.arange(size)
        below = inner[:, None] - inner  # row − column within a block
        for k in range(min(reach, frames)):
            down = k * size + below
            kept = (down >= 0) & (down < wide)
            rows, columns = np.nonzero(kept)
            at = column[: frames - k, columns]
            band[down[kept], at] = self.blocks[: frames - k, k, rows, columns]
        from scipy.linalg import cholesky_banded

        try:
            lower = cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            raise HandtrackError(
                "solver: the frames' system has a direction that nothing holds."
            ) from None
        return BandedFactor(lower, frames, size)


@dataclass(frozen=True, eq=False)
class BandedFactor:
    """L with L Lᵀ the matrix."""

    lower: Floats[L, N]
    """in scipy's banded form"""
    frames: int
    size: int

    def solve(self, right: Floats[F, P, *Axes]) -> Floats[F, P, *Axes]:
        """Return x with the matrix times x being `right`."""
        from scipy.linalg import cho_solve_banded

        flat = right.reshape(self.frames * self.size, -1)
        found = cho_solve_banded((self.lower, True), flat, check_finite=False)
        return found.reshape(right.shape)

    @cached_property
    def inverse(self) -> Floats[F, L, P, P]:
        """The inverse's blocks where the matrix has any, (F, REACH + 1, P, P) as in `BlockBanded`.

        From the last block back (Takahashi, Fagan, Chen 1973): with G = L_below L_tt⁻¹, Σ_below,t = −Σ_below G and
        Σ_tt = (L_tt L_ttᵀ)⁻¹ + Gᵀ Σ_below G. As many operations as the factor took.
        """
        frames, size = self.frames, self.size
        found = np.zeros((frames, REACH + 1, size, size))
        inner = np.arange(size)
        below = inner[:, None] - inner
        for t in range(frames - 1, -1, -1):
            after = min(REACH, frames - 1 - t)
            column = t * size + inner
            parts = []
            for k in range(after + 1):
                down = k * size + below
                there = (down >= 0) & (down < len(self.lower))
                part = np.zeros((size, size))
                part[there] = self.lower[down[there], np.broadcast_to(column, (size, size))[there]]
                parts.append(part)
            own = np.linalg.inv(parts[0])
            found[t, 0] = own.T @ own
            if not after:
                continue
            gain = np.concatenate(parts[1:]) @ own
            ahead = np.block(
                [
                    [
                        found[t + 1 + min(a, b), abs(a - b)]
                        if a >= b
                        else found[t + 1 + a, b - a].T
                        for b in range(after)
                    ]
                    for a in range(after)
                ]
            )
            across = -ahead @ gain
            own_block = found[t, 0] - gain.T @ across
            found[t, 0] = 0.5 * (
                own_block + own_block.T
            )  # rounding that is not symmetric would grow
            found[t, 1 : after + 1] = across.reshape(after, size, size)
        return found
