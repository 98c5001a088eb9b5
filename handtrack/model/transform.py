"""Couplings and linkages: solver parameters → joint parameters, as one matrix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from handtrack.arrays import Array, Axes, Floats, Ints, K, P, S
from handtrack.errors import HandtrackError, check_name


@dataclass(frozen=True)
class ParameterTransform:
    """joint parameters (S,) = matrix (S, P) · solver parameters (P,)."""

    names: tuple[str, ...]
    """(P,) solver parameters."""
    matrix: Floats[S, P]

    def joint_params(self, params: Floats[*Axes]) -> Floats[*Axes]:
        """Return the joint parameters (…, S) of solver parameters (…, P)."""
        return params @ self.matrix.T

    def solver_params(self, joint_params: Floats[S], given: Array[S] | None = None) -> Floats[P]:
        """Return the solver parameters closest, in least squares, to joint parameters.

        Parameters
        ----------
        given
            Which of them count; solver parameters that none of those tells of are 0.
        """
        joint, leader, ratio = self.links
        weight = ratio if given is None else ratio * given[joint]
        weights = np.bincount(leader, weight * ratio, len(self.names))
        pull = np.bincount(leader, weight * joint_params[joint], len(self.names))
        return pull / np.where(weights > 0.0, weights, 1.0)

    def reduce_bounds(self, bounds: Floats[*Axes]) -> Floats[*Axes]:
        """Return bounds (…, P, 2) that keep all joint parameters within `bounds` (…, S, 2).

        A solver parameter that leads several joints gets the intersection of their intervals, each
        divided by its ratio. An empty intersection (possible only for odd limits) collapses to its middle.
        """
        joint, leader, ratio = self.links
        ends, shape = bounds[..., joint, :] / ratio[:, None], (*bounds.shape[:-2], len(self.names))
        low, high = np.full(shape, -np.inf), np.full(shape, np.inf)
        np.maximum.at(low.T, leader, ends.min(axis=-1).T)
        np.minimum.at(high.T, leader, ends.max(axis=-1).T)
        empty = low > high
        middle = 0.5 * (low[empty] + high[empty])
        low[empty], high[empty] = middle, middle
        return np.stack([low, high], axis=-1)

    @cached_property
    def links(self) -> tuple[Ints[K], Ints[K], Floats[K]]:
        """The matrix as a list: which joint parameters follow which solver parameters, one each at most, and the ratio."""
        joint, leader = np.nonzero(self.matrix)
        assert len(set(joint)) == len(joint), (
            "a joint parameter may follow one solver parameter only"
        )
        return joint.copy(), leader.copy(), self.matrix[joint, leader]


def build_transform(
    joint_names: tuple[str, ...], couplings: Mapping[str, tuple[str, float]] = {}
) -> ParameterTransform:
    """Return the transform in which followers follow and every other joint parameter is free.

    A leader that is no joint parameter becomes a new solver parameter, at the place of its first
    follower (`spread`, which leads the four abductions).

    Parameters
    ----------
    couplings
        Leader and ratio of each follower, which loses its own column.
    """
    for name, (leader, _) in couplings.items():
        check_name("parameter", name, joint_names, "a coupling")
        if leader in couplings:
            raise HandtrackError(
                f"coupling of '{name}': its leader '{leader}' itself follows "
                f"'{couplings[leader][0]}'; couplings may not be chained."
            )
    names: list[str] = []
    for name in joint_names:
        leader, _ = couplings.get(name, (name, 1.0))
        if leader not in names and (name not in couplings or leader not in joint_names):
            names.append(leader)
    matrix = np.zeros((len(joint_names), len(names)))
    for s, name in enumerate(joint_names):
        leader, ratio = couplings.get(name, (name, 1.0))
        matrix[s, names.index(leader)] = ratio
    return ParameterTransform(tuple(names), matrix)
