"""A cloud as a search for the hand sees it: where a palm may be, how well a shape laid there fits, and what pulls it."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from handtrack.arrays import D3, Floats, Ints, K, M, N, P, R, array_dataclass
from handtrack.capture.clouds.cloud_filters import thinned
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.terms.clouds.cloud_distance import CloudDistanceTerm, prepare_cloud
from handtrack.terms.clouds.cloud_emptiness import CloudEmptinessTerm, visible_from
from handtrack.terms.clouds.distance_map import DistanceMap, distance_map
from handtrack.terms.loss import geman_mcclure
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.search.scores.hand_shapes import (
    PALM_DEEP_M,
    PIECE_M,
    REACH_M,
    HandShape,
    group_middles,
    palm_middle,
)
from handtrack.tracking.search.scores.score_kernels import cloud_scores

_VOXEL_M = 0.008
_MOST = 2000  # points; voxels grow until there are no more
_CELLS_A_SIDE = 1.5  # a plane crosses about 1.5 voxels for each of its faces' area
_MAP_M = 0.005
_PLACE_M = 0.028  # between places where a palm may be
_MOST_PLACES = 60
_SIGMA_BANDS, _ROBUST = 0.5, 5.0  # of errors, in bands; how many sigmas pull
_FEWEST = 60


@array_dataclass
class CloudScore:
    """One frame's cloud, thinned; made by `cloud_score`."""

    points: Floats[N, D3]
    """world [m]"""
    area: float
    """of the surface around each point [m²]"""
    distances: DistanceMap
    views: tuple[Floats[K, D3], ...]
    """camera centres, world [m], that must all see a point to measure it"""

    @cached_property
    def _nodes(self) -> Floats:
        return self.distances.at_nodes()

    @cached_property
    def _view_directions(self) -> tuple[Floats, Ints]:
        middle = np.median(self.points, axis=0)
        rays = [np.atleast_2d(view) - middle for view in self.views]
        rays = [way / np.linalg.norm(way, axis=1, keepdims=True) for way in rays]
        start = np.cumsum([0, *map(len, rays)]).astype(np.int64)
        return np.concatenate([*rays, np.zeros((0, 3))]), start

    @cached_property
    def places(self) -> Floats[M, D3]:
        """Where a palm's middle may be, world [m]: all over the cloud, the nearest to the cameras first."""
        directions = self._view_directions[0]
        away = -directions.mean(axis=0) if len(directions) else np.zeros(3)
        near = self.points @ away
        order = np.argsort(near, kind="stable")
        chosen = group_middles(self.points[order], _PLACE_M, _MOST_PLACES)
        return chosen + PALM_DEEP_M * away

    def scores(
        self,
        shape: HandShape,
        rotations: Floats[R, D3, D3],
        places: Floats[M, D3],
        enough: float = 1.0,
    ) -> Floats[R, M]:
        """Return the share of area on which shape and cloud disagree, by rotation and place."""
        points, normals, is_arm = shape.samples
        hand = ~is_arm  # asked for nowhere; where the forearm is seen, `field` explains it
        return cloud_scores(
            (self.points, self.area),
            (self._nodes, self.distances.low, self.distances.spacing),
            self._view_directions,
            (np.ascontiguousarray(rotations), np.ascontiguousarray(places)),
            (points[hand], normals[hand], shape.area, shape.middle, shape.reach),
            shape.field,
        )

    def terms(
        self,
        shape: HandShape,
        model: ArticulatedModel,
        params: Floats[P],
        band_m: float,
        unbiased: bool,
        palms: Floats[M, D3] | None,
    ) -> list[ObservationTerm]:
        """Return E1 and E2 around a pose of the shape's model, or of that without an arm, with arms as long as band_m: coarse,
        but quick.

        Parameters
        ----------
        unbiased
            As always; distances have no outer side that reaches further than the inner.
        """
        middle = palm_middle(model, params)
        around = middle[None] if palms is None else palms
        away = np.linalg.norm(self.points[:, None] - around, axis=2).min(axis=1)
        near = away < shape.reach
        sigma = _SIGMA_BANDS * band_m
        terms: list[ObservationTerm] = []
        if near.sum() >= _FEWEST // 3:
            cloud = prepare_cloud(self.points[near])
            terms.append(
                CloudDistanceTerm(cloud, MetaballSurface.of(model), sigma, geman_mcclure(_ROBUST))
            )
        vertices, normals = shape.mesh.carried(model.bones(params))
        seen = np.linalg.norm(vertices - middle, axis=1) < shape.reach
        seen &= visible_from(vertices, normals, self.views) & ~model.is_forearm(shape.mesh.bone)
        terms.append(
            CloudEmptinessTerm(
                self.distances,
                shape.mesh.bone[seen],
                np.ascontiguousarray(shape.mesh.local[seen]),
                sigma,
                slack_m=0.5 * _VOXEL_M,
                loss=geman_mcclure(_ROBUST),
                weight=shape.area / self.area,
            )
        )
        return terms

    def pieces(self, shape: HandShape, params: Floats[P]) -> float:
        """Return how many pieces of a hand are seen about a pose."""
        middle = palm_middle(shape.model, params)
        near = np.linalg.norm(self.points - middle, axis=1) < shape.reach
        return float(near.sum() * self.area / (0.5 * PIECE_M**2))


def cloud_score(
    points: Floats[N, D3], views: tuple[Floats[K, D3], ...], seed: int = 0
) -> CloudScore | None:
    """Return a cloud, world [m], made ready for the search; None where it is too small for a hand.

    Parameters
    ----------
    seed
        Decides which of a cell's points stands for it.
    """
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return None
    voxel = _VOXEL_M
    kept = points[thinned(points, voxel, seed=seed)]
    while len(kept) > _MOST:
        voxel *= 1.2
        kept = points[thinned(points, voxel, seed=seed)]
    if len(kept) < _FEWEST:
        return None
    low, high = kept.min(axis=0) - REACH_M, kept.max(axis=0) + REACH_M
    distances = distance_map(points, low, high, max(_MAP_M, 0.6 * voxel), most_voxels=1_500_000)
    return CloudScore(np.ascontiguousarray(kept), voxel**2 / _CELLS_A_SIDE, distances, views)
