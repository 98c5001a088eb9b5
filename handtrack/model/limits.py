"""Limits of joint parameters, and of solver parameters as the solver follows them: an interval each, fixed or moving with another parameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from handtrack.arrays import D2, Array, Axes, Floats, Ints, K, N, P, S
from handtrack.model.transform import ParameterTransform


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
