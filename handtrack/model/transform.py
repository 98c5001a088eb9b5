"""Solver parameters → joint parameters, as one matrix of couplings and linkages; the limits of both."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from handtrack.arrays import D2, Array, Axes, Floats, Ints, K, N, P, S
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


# ---- Limits of joint parameters, and of solver parameters as the solver follows them: an interval each, fixed or moving with another parameter


@dataclass(frozen=True)
class Limits:
    """Intervals (S, 2) [m, rad]; infinite where a parameter is free.

    `narrowed` lists pairs (parameter, by): the interval of the first shrinks towards its middle as the
    second goes from 0 to `narrow_at`, down to the share `narrow_to`, and stays there. Fingers spread
    when straight and cannot when bent.
    """

    interval: Floats[S, D2]
    narrowed: Ints[N, D2]
    """indices of parameters."""
    narrow_at: float
    """[rad]"""
    narrow_to: float
    """share of the interval's width that is left."""

    def bounds(self, joint_params: Floats[*Axes]) -> Floats[*Axes]:
        """Return the intervals (…, S, 2) that hold at joint parameters (…, S)."""
        bounds = np.tile(self.interval, (*joint_params.shape[:-1], 1, 1))
        which, by = self.narrowed.T
        bend = np.clip(joint_params[..., by] / self.narrow_at, 0.0, 1.0)
        share = 1.0 - (1.0 - self.narrow_to) * bend
        middle = np.clip(0.0, *self.interval[which].T)[:, None]
        wide = bounds[..., which, :] - middle
        bounds[..., which, :] = middle + share[..., None] * wide
        return bounds


class MovingLimits(NamedTuple):
    """K intervals of solver parameters (P,) [m, rad]; one that has several must lie in all of them.

    An interval moves in a straight line from `first` to `last` while parameter `by` goes from 0 to `end`.
    """

    param: Ints[K]
    """whose interval it is"""
    first: Floats[K, D2]
    by: Ints[K]
    """what it moves with; −1 where it stays `first`"""
    end: Floats[K]
    last: Floats[K, D2]

    @classmethod
    def fixed(cls, bounds: Floats[P, D2]) -> MovingLimits:
        """Return limits that do not move."""
        count, bounds = len(bounds), np.array(bounds, dtype=float, order="C")
        return cls(np.arange(count), bounds, np.full(count, -1), np.zeros(count), bounds)

    @classmethod
    def none(cls) -> MovingLimits:
        """Return no limits at all."""
        return cls.fixed(np.empty((0, 2)))

    def frozen(self, where: Array[P], params: Floats[P]) -> MovingLimits:
        """Return these limits, but no room at all for some parameters: where `where` is True, at params."""
        kept, stay = ~where[self.param], np.flatnonzero(where)
        here = MovingLimits.fixed(np.stack([params[stay], params[stay]], axis=1))
        pairs: Any = zip(self, here._replace(param=stay), strict=True)
        return MovingLimits(*(np.concatenate([own[kept], still]) for own, still in pairs))


def moving_limits(limits: Limits, transform: ParameterTransform) -> MovingLimits:
    """Return the limits of joint parameters as limits of the solver parameters that lead them.

    A joint parameter that nothing leads keeps its angle: what narrows with it stays as narrow as it is.
    """
    joint, leader, ratio = transform.links
    lead = np.full(len(transform.matrix), -1)
    lead[joint] = leader
    which, other = limits.narrowed.T
    fixed, moves = which[lead[other] < 0], lead[other] >= 0
    first = limits.interval.copy()
    first[fixed] = limits.bounds(np.zeros(len(lead)))[fixed]
    which, other = which[moves], other[moves]
    last, middle = first.copy(), np.clip(0.0, *first[which].T)[:, None]
    last[which] = middle + limits.narrow_to * (first[which] - middle)
    by, end = np.full(len(lead), -1), np.zeros(len(lead))
    by[which] = lead[other]
    end[which] = limits.narrow_at / transform.matrix[other, lead[other]]
    first, last = (np.sort(ends[joint] / ratio[:, None], axis=1) for ends in (first, last))
    return MovingLimits(leader, first, by[joint], end[joint], last)
