"""Hypotheses of one frame: near-equal ones merged and ranked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats, Ints, M, N, P
from handtrack.geometry.rotation import rotation_matrix

MERGED_RAD = 0.1
"""two minima closer than this, root mean square over all angles, count as one"""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """One minimum of a frame's cost, and the bell around it."""

    params: Floats[P]
    """solver parameters, the first three in metres, the next three the root's rotation vector"""
    cost: float
    """½ Σ r² at the minimum, priors included"""
    covariance: Floats[P, P]
    """[m, rad]"""
    weight: float
    """share of the posterior among the hypotheses of its frame"""
    origin: str
    """how it was found: a chain's flips, diffusion, the last frame"""


def angle_distance(params: Floats[P], others: Floats[N, P]) -> Floats[N]:
    """Return the root mean square difference [rad] of all angles between params and each of others.

    The root's three count as one turn: the angle from one attitude to the other, so that rotation vectors of the same
    attitude (2π apart) are at no distance. Translations do not count.
    """
    others = np.atleast_2d(others)
    hinges = ((others[:, 6:] - params[6:]) ** 2).sum(axis=1)
    between = rotation_matrix(params[3:6]).T @ rotation_matrix(others[:, 3:6])
    # from both sine and cosine: the cosine alone cannot tell small angles from rounding
    sine = 0.5 * np.linalg.norm(
        np.stack([between[:, i, j] - between[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))]), axis=0
    )
    turn = np.arctan2(sine, 0.5 * (np.trace(between, axis1=1, axis2=2) - 1.0))
    return np.sqrt((hinges + turn**2) / (len(params) - 3))


def distinct(params: Floats[N, P], costs: Floats[N], threshold_rad: float = MERGED_RAD) -> Ints[M]:
    """Return the indices of rows of params that stand for all: best first, none within the threshold of a better."""
    kept: list[int] = []
    open_rows = np.argsort(costs, kind="stable")
    while len(open_rows):
        best = int(open_rows[0])
        kept.append(best)
        far = angle_distance(params[best], params[open_rows]) > threshold_rad
        far[0] = False
        open_rows = open_rows[far]
    return np.array(kept, dtype=int)


def merged(
    hypotheses: Sequence[Hypothesis], threshold_rad: float = MERGED_RAD
) -> tuple[Hypothesis, ...]:
    """Return one hypothesis for each group of near-equal ones: the one of least cost, with the group's largest weight.

    The group's weights are not summed: samples that fell into one basin more often do not make it more probable.
    """
    if not hypotheses:
        return ()
    params = np.stack([h.params for h in hypotheses])
    weights = np.array([h.weight for h in hypotheses])
    kept = distinct(params, np.array([h.cost for h in hypotheses]), threshold_rad)
    group = np.argmin([angle_distance(params[k], params) for k in kept], axis=0)
    return tuple(
        replace(hypotheses[k], weight=float(weights[group == n].max()))
        for n, k in enumerate(kept.tolist())
    )


def ranked(hypotheses: Sequence[Hypothesis]) -> tuple[Hypothesis, ...]:
    """Return the hypotheses by falling weight, equal ones by rising cost."""
    return tuple(sorted(hypotheses, key=lambda h: (-h.weight, h.cost)))
