"""What a point cloud contributes to a frame: which of its points, how much, how robustly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from handtrack.arrays import D3, Array, Floats, Ints, M, N, V, array_dataclass
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface, relaxed_mesh
from handtrack.model.part_mesh import PartMesh
from handtrack.observation.observation import CloudView, Observation, view_centres
from handtrack.terms.clouds import (
    CloudDistanceTerm,
    CloudEmptinessTerm,
    CloudRaysTerm,
    PreparedCloud,
    distance_map,
    hiding,
    prepare_cloud,
    visible_from,
)
from handtrack.terms.loss import Loss, geman_mcclure, quadratic, uniform_outliers
from handtrack.terms.term import ObservationTerm
from handtrack.tracking.frame.constants import CLOUD_PATCH_MM, FOREARM_VISIBLE_MM
from handtrack.tracking.frame.methods import Traits
from handtrack.tracking.frame.reason import NEAR_M
from handtrack.tracking.frame.settings import CloudTermSettings, TrackerSettings
from handtrack.tracking.frame.terms.forearm import is_behind_hand

CLOUD_TERMS = CloudDistanceTerm, CloudEmptinessTerm, CloudRaysTerm
_MM = 1e-3
_ROBUST_BANDS = 4.0  # points further off than this many bands hardly pull
_SIGMA_BANDS = 0.5  # of depths, in bands: beyond three of them a doubted depth counts as wrong
_FEWEST = 30
_CELL_M = 0.004  # of the grid that measures a surface, and of the model's mesh
_CELL_AREA = _CELL_M**2 / 1.5  # in each cell: a plane meets 1.5 of them per a² (mean of directions)
_NORMAL_MEDIAN = 1.4826  # σ of a normal distribution by the median of its absolute values
_BETTER = 0.7  # of the usual σ: a cloud that lies nearer than that, or as much further off, is taken as found,
_EXACT = 0.1  # but for no more exact than this
_EMPTY_FAR_M = 0.012  # a part further from all points was rather not measured than misplaced
_OBJECT_M = 0.02  # from the surface where a frame starts: the breadth of a finger, further than what a hand does beside its prediction
_MOST_HIDDEN = 0.5  # of a cloud before the hand: more of it is rather the hand, which came nearer
_SIGHT_STEP_M = 0.004  # between places on a line of sight: the distance map's own grid
_AS_OFTEN_AS_NOT = uniform_outliers(0.5, np.sqrt(np.pi / 2))  # a hole costs log 2, wherever it is


@array_dataclass
class CloudObservation:
    """The hand's part of a cloud, ready for terms."""

    model: ArticulatedModel
    settings: TrackerSettings
    prepared: PreparedCloud
    share: float
    """how much one point counts: neighbours on the same finger err together"""
    emptiness: CloudEmptinessTerm | None
    """E2, for the surface where the frame starts; of the lines of sight, not the points, where depths are doubted. None when
    only the cloud's side is asked for"""
    views: tuple[CloudView, ...]
    """what can have seen the surface, as in `visible_from`"""
    objects: Floats[M, D3]
    """measured points before the hand, of something else: what they hide is not asked for"""
    sigma_m: float | None = None
    """how far points were found to be from the surface, where that is not about `cloud.sigma_mm`"""

    @property
    def surface(self) -> MetaballSurface:
        """The merged surface that distances are measured to."""
        return fitted_surface(self.model, self.settings.cloud)

    def sharpened(self, bones: BonePoses) -> CloudObservation:
        """Return the same points, taken as exactly as they are found to lie on the surface of a solved pose.

        What is usual is mostly the misfit of a hand that is not made of ellipsoids; of one that fits better, more is known, and of a
        sensor that errs by more less. Fewer patches than freedoms tell nothing: the hand can be bent to meet them all.
        """
        few = self.share * self.prepared.count < len(self.model.transform.names)
        if few or self.settings.traits.plain_sums:
            return self
        usual_m = self.settings.cloud.sigma_mm * _MM
        off = _distances(self, bones)
        off = off[off < _EMPTY_FAR_M]  # other things may stand beside a hand
        if not len(off):
            return self
        found = max(_NORMAL_MEDIAN * float(np.median(off)), _EXACT * usual_m)
        usual = _BETTER * usual_m <= found <= usual_m / _BETTER
        return self if usual else replace(self, sigma_m=found)

    def visible_at(self, bones: BonePoses) -> CloudObservation:
        """Return the same points, asking of the model what is in view at another pose.

        A finger that folds behind the palm leaves the view; asked for where it was in view, it could never fold.
        """
        if self.emptiness is None:
            return self
        model, traits = self.model, self.settings.traits
        mesh, asked = _mesh(model, self.settings.cloud), _asked(self.views, traits)
        kept = visible_from(*mesh.carried(bones), asked, self.objects)
        bone, local = _on_hand(model, mesh, kept)
        return replace(self, emptiness=replace(self.emptiness, bone=bone, local=local))


@lru_cache(maxsize=2)  # a solved pose is asked for both its agreement and its spread
def _distances(seen: CloudObservation, bones: BonePoses) -> Floats[N]:
    """Return how far each point is from the surface [m]."""
    return np.abs(seen.surface.distance(bones, seen.prepared.rows))


def see_cloud(
    seen: Observation, model: ArticulatedModel, start: BonePoses, settings: TrackerSettings
) -> CloudObservation | None:
    """Return the points near the hand at `start`; None where too few are.

    Far points are background or the rest of the body; beyond the forearm's stretch, or a hand without one, the model knows nothing.
    """
    if seen.cloud is None or settings.cloud.weight == 0:
        return None
    points, traits = seen.cloud.points[np.isfinite(seen.cloud.points).all(axis=1)], settings.traits
    surface = fitted_surface(model, settings.cloud)
    views, mesh = _asked(seen.cloud_views, traits), _mesh(model, settings.cloud)
    vertices, normals = mesh.carried(start)
    away = surface.distance(start, points)
    near = away < settings.cloud.crop_mm * _MM
    objects = away > _OBJECT_M
    if objects.any():
        objects[objects] = _is_before(vertices, points[objects], views)
    if near.any() and objects[near].mean() > _MOST_HIDDEN:
        objects[:] = False
    points, before = points[near & ~objects], points[objects]
    if model.has_forearm:
        bone = model.skeleton.bone("forearm")
        along = (points - start.position[bone]) @ start.rotation[bone][:, 1]
        points = points[along < FOREARM_VISIBLE_MM * _MM]
    elif model.has_keypoints21:  # as of masks: to cover an arm, a hand alone would slide along it
        points = points[~is_behind_hand(points, model, start)]
    if len(points) < _FEWEST:
        return None
    patches = _area(points) / _patch_area(model)
    emptiness = None
    if settings.cloud.balance < 1:
        margin = settings.cloud.crop_mm * _MM
        filled = points
        if _is_doubted(seen.cloud_views, settings.cloud):
            filled = _lines_of_sight(points, _eye(seen.cloud_views), vertices, margin)
        low, high = vertices.min(axis=0) - margin, vertices.max(axis=0) + margin
        kept = visible_from(vertices, normals, views, before)
        distances = distance_map(filled, low, high)
        emptiness = CloudEmptinessTerm(distances, *_on_hand(model, mesh, kept))
    share = 1.0 if traits.plain_sums else min(1.0, patches / len(points))
    return CloudObservation(
        model, settings, prepare_cloud(points), share, emptiness, tuple(seen.cloud_views), before
    )


def _is_before(surface: Floats, points: Floats, views: Sequence[CloudView]) -> Array[N]:
    """Return which points (N, 3) are of things that hide a part of a surface's points from a camera."""
    found = np.zeros(len(points), bool)
    for centre in (centre for view in views for centre in view_centres(view)):
        found |= hiding(surface, points, centre)
    if not found.any():
        return found
    from scipy.spatial import KDTree

    return KDTree(points[found]).query(points, distance_upper_bound=_OBJECT_M)[0] < _OBJECT_M


@lru_cache(maxsize=8)
def fitted_surface(model: ArticulatedModel, chosen: CloudTermSettings) -> MetaballSurface:
    """Return the merged surface that distances are measured to."""
    return MetaballSurface.of(model, chosen.sharpness_per_mm / _MM, chosen.distance)


def _mesh(model: ArticulatedModel, chosen: CloudTermSettings) -> PartMesh:
    return relaxed_mesh(model, chosen.sharpness_per_mm / _MM, chosen.distance)


def _on_hand(
    model: ArticulatedModel, mesh: PartMesh, kept: Array[V]
) -> tuple[Ints[N], Floats[N, D3]]:
    """Return the bones and places of a mesh's vertices that are kept, without the forearm's: a sleeve may hide it anywhere, and where it
    is bare it is seen anyway.
    """
    kept = kept & ~model.is_forearm(mesh.bone)
    return mesh.bone[kept], np.ascontiguousarray(mesh.local[kept])


def _asked(views: Sequence[CloudView], traits: Traits) -> Sequence[CloudView]:
    """Return the views of which the surface that they see is asked for; none: all of it."""
    return () if traits.whole_surface else views


def _is_doubted(views: Sequence[CloudView], chosen: CloudTermSettings) -> bool:
    """Return whether lines of sight are all that is believed; each point's must be known."""
    return chosen.doubt_depth and len(views) == 1


def _eye(views: Sequence[CloudView]) -> Floats[D3]:
    """Return the centre (3,) that lines of sight start from; of a pair, the left one's pixels are matched."""
    return view_centres(views[0])[0]


def _lines_of_sight(points: Floats, eye: Floats, surface: Floats, margin_m: float) -> Floats:
    """Return (M, 3) places on the lines from `eye` through points (N, 3), as far as a surface's points may be, world [m]."""
    out = points - eye
    sight = out / np.linalg.norm(out, axis=1)[:, None]
    far = np.linalg.norm(surface - eye, axis=1)
    along = np.arange(far.min() - margin_m, far.max() + margin_m, _SIGHT_STEP_M)
    return (eye + sight[:, None] * along[:, None]).reshape(-1, 3)


def _area(points: Floats) -> float:
    """Return about how much surface [m²] points (N, 3) lie on, however dense they are."""
    cells = np.floor(points / _CELL_M).astype(np.int64)
    x, y, z = (cells - cells.min(axis=0)).T
    flat = (x * (y.max() + 1) + y) * (z.max() + 1) + z  # many times quicker to compare than rows
    return len(np.unique(flat)) * _CELL_AREA


def _patch_area(model: ArticulatedModel) -> float:
    """Return the surface [m²] over which the error is the same; a larger hand's parts are broader."""
    return (CLOUD_PATCH_MM * _MM * model.scale.overall) ** 2


def cloud_terms(seen: CloudObservation, band_mm: float) -> list[ObservationTerm]:
    """Return E1 and E2 as negative log-likelihoods, robust beyond a few bands; lines of sight where depths are doubted.

    E1 and E2 ask after the same error, from either side, so their weights add up to one. A line of sight that meets the
    hand, and a piece of the hand that no line meets, are two observations: at K = ½ each counts whole.
    """
    chosen, sigma_m = seen.settings.cloud, seen.settings.cloud.sigma_mm * _MM
    if _is_doubted(seen.views, chosen):
        rays = CloudRaysTerm(
            seen.prepared.rows,
            _eye(seen.views),
            seen.surface,
            along_m=max(_SIGMA_BANDS * band_mm, chosen.sigma_mm) * _MM,
            weight=2.0 * chosen.balance * chosen.weight * seen.share,
        )
        empty = 2.0 * (1.0 - chosen.balance)
        return [rays, *_empty(seen, _AS_OFTEN_AS_NOT, empty)]
    robust: Loss = geman_mcclure(
        max(_ROBUST_BANDS * band_mm * _MM / (seen.sigma_m or sigma_m), 2.0)
    )
    far: Loss = geman_mcclure(_EMPTY_FAR_M / sigma_m)
    if seen.settings.traits.plain_sums:
        robust = far = quadratic()
    points = CloudDistanceTerm(
        seen.prepared,
        seen.surface,
        sigma_m=seen.sigma_m or sigma_m,
        loss=robust,
        weight=chosen.balance * chosen.weight * seen.share,
    )
    return [points, *_empty(seen, far, 1.0 - chosen.balance)]


def _empty(seen: CloudObservation, loss: Loss, weight: float) -> list[ObservationTerm]:
    """Return E2, or nothing where only the cloud's side is asked for."""
    if seen.emptiness is None:
        return []
    settings = seen.settings
    plain = settings.traits.plain_sums
    share = 1.0 if plain else min(1.0, _CELL_AREA / _patch_area(seen.model))
    term = replace(
        seen.emptiness,
        slack_m=0.0 if plain else seen.emptiness.slack_m,
        sigma_m=max(settings.cloud.sigma_mm * _MM, seen.sigma_m or 0.0),
        loss=loss,
        weight=weight * settings.cloud.weight * share,
    )
    return [term]


@dataclass(frozen=True)
class Agreement:
    """How well a cloud and the hand found in it agree."""

    explained: float
    """share of the points that lie within NEAR_M of the surface"""
    measured: float
    """share of the surface in view that has a point within NEAR_M; NaN where none is known to be in view"""

    @property
    def share(self) -> float:
        """Return the harmonic mean of both (the F-score of reconstructions): high only where both are."""
        return 2.0 * self.explained * self.measured / max(self.explained + self.measured, 1e-9)


def agreement(seen: CloudObservation, bones: BonePoses) -> Agreement:
    """Return how well cloud and model agree at a pose.

    It does not ask how sure the fingers are: those of a fist are hidden even from the best sensor. What is asked is
    whether that was measured which could be.
    """
    off = _distances(seen, bones)
    measured, term = np.nan, seen.emptiness  # of the hand alone
    if term is not None and len(term.bone):
        distances = term.distances
        if _is_doubted(seen.views, seen.settings.cloud):  # those are of lines of sight
            points = seen.prepared.rows
            distances = distance_map(
                points, points.min(axis=0) - NEAR_M, points.max(axis=0) + NEAR_M
            )
        away = distances.at(bones.to_world(term.bone, term.local))[0]
        measured = float(np.mean(away < NEAR_M))
    return Agreement(float(np.mean(off < NEAR_M)), measured)
