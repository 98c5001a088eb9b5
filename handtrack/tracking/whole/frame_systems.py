"""What all frames of a recording say at their poses, kept small: symmetric matrices as their lower halves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from handtrack.arrays import F, Floats, Ints, K, L, M, N, P
from handtrack.tracking.whole.evidence import FrameSystem

_AT_ONCE = 256
"""frames that are unpacked at once"""


@dataclass(frozen=True, eq=False)
class FrameSystems:
    """Each frame's cost to second order, by L = P + K numbers: changes of its own pose, and of what all frames share.

    10,000 frames of a hand before three cameras take 150 MB, whole matrices 350; there are two while a step is tried.
    """

    size: int
    """P"""
    costs: Floats[F]
    gradient: Floats[F, L]
    share: Floats[F]
    """of what was seen, how much counts"""
    _halves: Floats[F, M]
    """rows of the lower halves, one after the other: those of the poses come first"""
    _seen: Floats[F, N]
    """of the poses' part what is of what was seen"""

    @classmethod
    def empty(cls, frames: int, size: int, shared: int) -> FrameSystems:
        """Return room for as many frames as `put` is called for."""
        whole = size + shared
        return cls(
            size, np.empty(frames), np.empty((frames, whole)), np.ones(frames),
            np.empty((frames, whole * (whole + 1) // 2)), np.empty((frames, size * (size + 1) // 2)),
        )  # fmt: skip

    def put(self, frame: int, system: FrameSystem) -> None:
        """Keep a frame's system, in place."""
        self.costs[frame], self.gradient[frame] = system.whole.cost, system.whole.gradient
        self.share[frame] = system.share
        self._halves[frame] = system.whole.hessian[_half(self.gradient.shape[1])]
        self._seen[frame] = system.seen[_half(self.size)]

    def own(self) -> Iterator[tuple[slice, Floats[N, P, P]]]:
        """Yield the poses' part, some frames at once."""
        for at in self._parts():
            yield at, self._halves[at][:, _places(self.size)]

    def seen(self) -> Iterator[tuple[slice, Floats[N, P, P]]]:
        """Yield what each frame alone would say of its pose by what was seen, some frames at once."""
        for at in self._parts():
            yield at, self._seen[at][:, _places(self.size)]

    @property
    def border(self) -> Floats[F, P, K]:
        """By pose and what is shared."""
        return self._halves[:, _places(self.gradient.shape[1])[: self.size, self.size :]]

    @property
    def corner(self) -> Floats[K, K]:
        """By what is shared, all frames together."""
        places = _places(self.gradient.shape[1])
        return self._halves.sum(axis=0)[places[self.size :, self.size :]]

    def foretold(self, step: Floats[F, P], shared: Floats[K]) -> Floats[F]:
        """Return what each frame should cost after a step, to second order."""
        rows, columns = _half(self.gradient.shape[1])
        twice = np.where(rows == columns, 0.5, 1.0)
        found = self.costs.copy()
        for at in self._parts():
            whole = np.column_stack([step[at], np.tile(shared, (len(step[at]), 1))])
            bent = self._halves[at] * whole[:, rows]
            found[at] += np.einsum("fm,fm,m->f", bent, whole[:, columns], twice)
            found[at] += (self.gradient[at] * whole).sum(axis=1)
        return found

    def _parts(self) -> Iterator[slice]:
        for first in range(0, len(self.costs), _AT_ONCE):
            yield slice(first, first + _AT_ONCE)


@lru_cache(maxsize=8)
def _half(size: int) -> tuple[Ints[M], Ints[M]]:
    """Return rows and columns of a matrix's lower half, row after row."""
    rows, columns = np.tril_indices(size)
    return rows, columns


@lru_cache(maxsize=8)
def _places(size: int) -> Ints[N, N]:
    """Return where each entry of a symmetric matrix is in its lower half."""
    found = np.empty((size, size), int)
    rows, columns = _half(size)
    found[rows, columns] = found[columns, rows] = np.arange(len(rows))
    return found
