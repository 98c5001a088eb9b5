"""What one kind of observation says about where a hand may be: the questions that a search asks of it."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from handtrack.arrays import D3, Floats, K, M, N, P, R
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.search.evidence.hand_shapes import HandShape

PALM_DEEP_M = 0.014
"""from the palm's skin to its middle"""
PIECE_M = 0.03
"""length of a phalanx, along which a model that is not this person's hand errs alike; it is half as broad"""


def group_middles(points: Floats[N, D3], apart_m: float, most: int | None = None) -> Floats[K, D3]:
    """Return the means of groups of points that lie within `apart_m` of the group's first, the first points' groups first."""
    chosen: list[Floats] = []
    while len(points) and (most is None or len(chosen) < most):
        near = np.linalg.norm(points - points[0], axis=1) < apart_m
        chosen.append(points[near].mean(axis=0))
        points = points[~near]
    return np.array(chosen).reshape(-1, 3)


class EvidenceSource(Protocol):
    """A frame's silhouettes, or its cloud, made ready for a search."""

    @property
    def places(self) -> Floats[M, D3]:
        """Where a palm's middle may be, world [m], the likelier first"""
        ...

    def scores(
        self,
        shape: HandShape,
        rotations: Floats[R, D3, D3],
        places: Floats[M, D3],
        enough: float = 1.0,
    ) -> Floats[R, M]:
        """Return the share of area on which shape and observation disagree; exact only up to `enough`."""
        ...

    def terms(
        self,
        shape: HandShape,
        params: Floats[P],
        band_m: float,
        unbiased: bool = False,
        palms: Floats[M, D3] | None = None,
    ) -> list[ObservationTerm]:
        """Return what pulls a pose from about band_m around it [m]; unbiased: so that it can tell a size, if less far. palms: around
        which points and pixels count; the pose's own unless given.
        """
        ...

    def pieces(self, shape: HandShape, params: Floats[P]) -> float:
        """Return how many pieces of a hand are seen about a pose: a phalanx's side in a view, or half its skin."""
        ...
