"""Limits of joint parameters: an interval each, fixed or narrowing with another parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D2, Axes, Floats, Ints, N, S


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
    narrow_at: Floats[N]
    """[rad]"""
    narrow_to: Floats[N]
    """share of the interval's width that is left."""

    def bounds(self, joint_params: Floats[*Axes]) -> Floats[*Axes]:
        """Return the intervals (…, S, 2) that hold at joint parameters (…, S)."""
        bounds = np.tile(self.interval, (*joint_params.shape[:-1], 1, 1))
        if len(self.narrowed):
            which, by = self.narrowed.T
            bend = np.clip(joint_params[..., by] / self.narrow_at, 0.0, 1.0)
            share = 1.0 - (1.0 - self.narrow_to) * bend
            middle = np.clip(0.0, *self.interval[which].T)[:, None]
            wide = bounds[..., which, :] - middle
            bounds[..., which, :] = middle + share[..., None] * wide
        return bounds
