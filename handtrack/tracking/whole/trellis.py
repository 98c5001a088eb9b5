"""Several poses a frame, and the paths through them: how probable each is, and which is the most probable."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np

from handtrack.arrays import F, Floats, Ints, K, L, P, array_dataclass
from handtrack.model.pose_changes import changes
from handtrack.terms.bone_system import JointSystem


@array_dataclass
class Minimum:
    """A pose in which a frame's cost is about lowest nearby."""

    pose: Floats[P]
    """solver parameters"""
    costs: Callable[[Floats[P]], JointSystem]
    """what the frame costs at a pose, to second order, by changes of the pose as `pose_changes.moved` makes them"""
    origin: str
    """how it was found"""

    @cached_property
    def system(self) -> JointSystem:
        """What the frame costs there; asked for only where a frame has other minima, or one beside it."""
        return self.costs(self.pose)


@array_dataclass
class Trellis:
    """Minima of frames that follow one another, at least one each, joined by what a frame may change.

    A minimum's mass is its bell's, exp(−cost) · √det C (Laplace), C = (H + S⁻¹)⁻¹: what the frame leaves open is known as
    well as the frames beside it say, within a frame's change S. Two that follow each other are joined by N(change; 0, S + C + C').
    """

    minima: Sequence[Sequence[Minimum]]
    change: Floats[P, P]
    """S [m², rad²]: covariance of what a pose changes from a frame to the next"""

    @cached_property
    def best(self) -> Ints[F]:
        """Which minimum of each frame lies on the most probable path (Viterbi)."""
        least, back = -self._masses[0], []
        for mass, joined in zip(self._masses[1:], self._joined, strict=True):
            costs = least[:, None] - joined
            back.append(costs.argmin(axis=0))
            least = costs.min(axis=0) - mass
        path = [int(least.argmin())]
        for before in reversed(back):
            path.append(int(before[path[-1]]))
        return np.array(path[::-1])

    def path(self, chosen: Ints[F]) -> Floats[F, P]:
        """Return the poses of one minimum each frame."""
        return np.array([row[k].pose for row, k in zip(self.minima, chosen.tolist(), strict=True)])

    @property
    def probabilities(self) -> list[Floats[K]]:
        """How probable each frame's minima are, by all frames: over all paths through them (forward–backward)."""
        ahead: list[Floats[K]] = [self._masses[0]]
        behind: list[Floats[K]] = [np.zeros(len(self.minima[-1]))]
        for mass, joined in zip(self._masses[1:], self._joined, strict=True):
            ahead.append(mass + _log_sum(ahead[-1][:, None] + joined, axis=0))
        pairs = zip(self._masses[:0:-1], reversed(self._joined), strict=True)
        for mass, joined in pairs:
            behind.append(_log_sum(joined + mass + behind[-1], axis=1))
        both = [a + b for a, b in zip(ahead, reversed(behind), strict=True)]
        return [np.exp(row - _log_sum(row[:, None], axis=0)) for row in both]

    @property
    def _masses(self) -> list[Floats[K]]:
        return self._weights[0]

    @property
    def _joined(self) -> list[Floats[K, L]]:
        return self._weights[1]

    @cached_property
    def _weights(self) -> tuple[list[Floats[K]], list[Floats[K, L]]]:
        """Logarithms of each frame's masses, and of each frame's minima joined with each of the next's.

        What is the same of all paths is left out: the mass of a frame's only minimum, and the join of two such.
        """
        known = np.linalg.inv(self.change)
        masses: list[Floats[K]] = []
        joined: list[Floats[K, L]] = []
        before: Floats[K, P, P] | None = None
        for n, row in enumerate(self.minima):
            spread, mass = None, np.zeros(1)
            if any(len(beside) > 1 for beside in self.minima[max(n - 1, 0) : n + 2]):
                spread = np.linalg.inv(np.array([one.system.hessian for one in row]) + known)
                mass = np.array([-one.system.cost for one in row])
                mass += 0.5 * np.linalg.slogdet(spread)[1]
            if before is not None and spread is not None:
                joined.append(self._join(self.minima[n - 1], row, before, spread))
            elif n > 0:
                joined.append(np.zeros((1, 1)))
            masses.append(mass)
            before = spread
        return masses, joined

    def _join(
        self,
        here: Sequence[Minimum],
        there: Sequence[Minimum],
        spread: Floats[K, P, P],
        other: Floats[L, P, P],
    ) -> Floats[K, L]:
        pairs = np.array([[one.pose, two.pose] for one in here for two in there])
        # each pair's change is the one within it; those from pair to pair are left out
        steps = changes(pairs.reshape(-1, pairs.shape[2]))[::2]
        open_ = (self.change + spread[:, None] + other).reshape(len(steps), *self.change.shape)
        off = np.einsum("np,np->n", steps, np.linalg.solve(open_, steps[:, :, None])[:, :, 0])
        found = -0.5 * off - 0.5 * np.linalg.slogdet(open_)[1]
        return found.reshape(len(here), len(there))


def _log_sum(values: Floats[K, L], axis: int) -> Floats[K]:
    most = values.max(axis=axis, keepdims=True)
    return np.log(np.exp(values - most).sum(axis=axis)) + most.squeeze(axis)
