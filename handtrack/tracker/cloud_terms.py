"""What a point cloud contributes to a frame: which of its points, how much, how robustly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface
from handtrack.model.surface import surface_mesh
from handtrack.observation.observation import Observation
from handtrack.terms.cloud_distance import CloudDistanceTerm, PreparedCloud, prepare_cloud
from handtrack.terms.cloud_emptiness import CloudEmptinessTerm
from handtrack.terms.cloud_rays import CloudRaysTerm
from handtrack.terms.loss import GemanMcClure
from handtrack.terms.term import ObservationTerm
from handtrack.tracker.settings import TrackerSettings

_MM = 1e-3
_ROBUST_BANDS = 4.0  # points further off than this many bands hardly pull
_SIGMA_BANDS = 0.5  # of depths, in bands: beyond three of them a doubted depth counts as wrong
_FEWEST = 30
_CELL_M = 0.004  # of the grid that measures a surface, and of the model's mesh
_CELL_AREA = _CELL_M**2 / 1.5  # in each cell: a plane meets 1.5 of them per a² (mean of directions)
_NORMAL_MEDIAN = 1.4826  # σ of a normal distribution by the median of its absolute values
_BETTER = 0.7  # of the usual σ: a cloud that lies nearer than that is taken as found,
_EXACT = 0.1  # but for no more exact than this
_EMPTY_FAR_M = 0.012  # a part further from all points was rather not measured than misplaced


@dataclass(frozen=True)
class SeenCloud:
    """The hand's part of a cloud, ready for terms."""

    prepared: PreparedCloud
    share: float
    """how much one point counts: neighbours on the same finger err together"""
    emptiness: CloudEmptinessTerm | None
    """E2, for the surface where the frame starts; None when only the cloud's side is asked for"""
    length: Floats
    """(B,) bone lengths of the model that `emptiness` was made for [m]"""
    views: tuple[Floats, ...] = ()
    """what can have seen the surface, as in `seen_from`"""
    sigma_m: float | None = None
    """how far points were found to be from the surface, where that is less than `cloud.sigma_mm`"""

    def sharpened(self, model: ArticulatedModel, bones: BonePoses, usual_m: float) -> SeenCloud:
        """Return the same points, taken as exactly as they are found to lie on the surface of a solved pose.

        What is usual is mostly the misfit of a hand that is not made of ellipsoids; of one that fits better, more is known.
        Fewer patches than freedoms tell nothing: the hand can be bent to meet them all.
        """
        if self.share * self.prepared.count < len(model.transform.names):
            return self
        points = np.ascontiguousarray(self.prepared.points[:, : self.prepared.count].T)
        off = np.abs(MetaballSurface.of(model).distance(bones, points))
        found = max(_NORMAL_MEDIAN * float(np.median(off)), _EXACT * usual_m)
        return replace(self, sigma_m=found) if found < _BETTER * usual_m else self

    def looked_at(self, model: ArticulatedModel, bones: BonePoses) -> SeenCloud:
        """Return the same points, asking of the model what is in view at another pose.

        A finger that folds behind the palm leaves the view; asked for where it was in view, it could never fold.
        """
        if self.emptiness is None:
            return self
        mesh = surface_mesh(MetaballSurface.of(model), bones)
        term = _hand_only(self.emptiness.asking(mesh, self.views), model)
        return replace(self, emptiness=term, length=model.skeleton.length)


def see_cloud(
    seen: Observation, model: ArticulatedModel, start: BonePoses, settings: TrackerSettings
) -> SeenCloud | None:
    """Return the points near the hand at `start`; None where too few are.

    Far points are background or the rest of the body; beyond the forearm's stretch the model knows nothing.
    """
    if seen.cloud is None or settings.cloud.weight == 0:
        return None
    points = seen.cloud.points[np.isfinite(seen.cloud.points).all(axis=1)]
    surface = MetaballSurface.of(model)
    points = points[surface.distance(start, points) < settings.cloud.crop_mm * _MM]
    if model.has_forearm:
        bone = model.skeleton.bone("forearm")
        along = (points - start.position[bone]) @ start.rotation[bone][:, 1]
        points = points[along < settings.silhouettes.forearm_seen_mm * _MM]
    if len(points) < _FEWEST:
        return None
    patches = _area(points) / _patch_area(model, settings)
    emptiness = None
    if settings.cloud.balance < 1 and not _is_doubted(seen.cloud_views, settings):
        margin = settings.cloud.crop_mm * _MM
        mesh = surface_mesh(surface, start)
        emptiness = CloudEmptinessTerm.at_start(points, mesh, seen.cloud_views, margin_m=margin)
        emptiness = _hand_only(emptiness, model)
    share = min(1.0, patches / len(points))
    views = tuple(seen.cloud_views)
    return SeenCloud(prepare_cloud(points), share, emptiness, model.skeleton.length, views)


def _is_doubted(views: Sequence[Floats], settings: TrackerSettings) -> bool:
    """Return whether lines of sight are all that is believed; each point's must be known. Holes then say nothing."""
    return settings.cloud.doubt_depth and len(views) == 1


def _area(points: Floats) -> float:
    """Return about how much surface [m²] points (N, 3) lie on, however dense they are."""
    cells = np.unique(np.floor(points / _CELL_M).astype(np.int64), axis=0)
    return len(cells) * _CELL_AREA


def _patch_area(model: ArticulatedModel, settings: TrackerSettings) -> float:
    """Return the surface [m²] over which the error is the same; a larger hand's parts are broader."""
    return (settings.cloud.patch_mm * _MM * model.scale.overall) ** 2


def _hand_only(term: CloudEmptinessTerm, model: ArticulatedModel) -> CloudEmptinessTerm:
    """Return E2 without the forearm's points: a sleeve may hide it anywhere, and where it is bare it is seen anyway."""
    kept = ~model.is_forearm(term.bone)
    return replace(term, bone=term.bone[kept], local=np.ascontiguousarray(term.local[kept]))


def cloud_terms(
    seen: SeenCloud, model: ArticulatedModel, settings: TrackerSettings, band_mm: float
) -> list[ObservationTerm]:
    """Return E1 and E2 as negative log-likelihoods, robust beyond a few bands; lines of sight where depths are doubted.

    Both ask after the same error, from either side, so their weights add up to one.
    """
    chosen, sigma_m = settings.cloud, settings.cloud.sigma_mm * _MM
    if _is_doubted(seen.views, settings):
        return [
            CloudRaysTerm(
                np.ascontiguousarray(seen.prepared.points[:, : seen.prepared.count].T),
                np.atleast_2d(seen.views[0])[0],  # of a pair, the left one's pixels are matched
                MetaballSurface.of(model),
                along_m=max(_SIGMA_BANDS * band_mm, chosen.sigma_mm) * _MM,
                weight=chosen.weight * seen.share,
            )
        ]
    robust = GemanMcClure(max(_ROBUST_BANDS * band_mm * _MM / (seen.sigma_m or sigma_m), 2.0))
    terms: list[ObservationTerm] = [
        CloudDistanceTerm(
            seen.prepared,
            MetaballSurface.of(model),
            sigma_m=seen.sigma_m or sigma_m,
            loss=robust,
            weight=chosen.balance * chosen.weight * seen.share,
        )
    ]
    if seen.emptiness is not None:
        share = min(1.0, _CELL_AREA / _patch_area(model, settings))
        # A person's size scales each bone's flesh about the bone's head.
        stretch = (model.skeleton.length / seen.length)[seen.emptiness.bone, None]
        terms.append(
            replace(
                seen.emptiness,
                local=seen.emptiness.local * stretch,
                sigma_m=sigma_m,
                loss=GemanMcClure(_EMPTY_FAR_M / sigma_m),
                weight=(1 - chosen.balance) * chosen.weight * share,
            )
        )
    return terms


def explained_share(
    seen: SeenCloud, model: ArticulatedModel, bones: BonePoses, within_m: float
) -> float:
    """Return the share of the cloud's points that lie within a distance of the surface."""
    points = np.ascontiguousarray(seen.prepared.points[:, : seen.prepared.count].T)
    off = MetaballSurface.of(model).distance(bones, points)
    return float(np.mean(np.abs(off) < within_m))
