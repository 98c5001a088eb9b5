"""What a point cloud contributes to a frame: which of its points, how much, how robustly."""

from __future__ import annotations

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
from handtrack.terms.loss import GemanMcClure
from handtrack.terms.term import ObservationTerm
from handtrack.tracker.settings import TrackerSettings

_MM = 1e-3
_ROBUST_BANDS = 4.0  # points further off than this many bands hardly pull
_FEWEST = 30
_CUT_MARGIN_M = 0.02
_MESH_MM = 4.0  # between points of the model's surface
_EMPTY_ROBUST = 3.0  # sigmas; a part further from all points was rather not measured than misplaced
_EMPTY_SIGMAS = 2.0  # the nearest cloud point is rarely the one measured there


@dataclass(frozen=True)
class SeenCloud:
    """The hand's part of a cloud, ready for terms."""

    prepared: PreparedCloud
    share: float
    """how much one point counts: neighbours a few millimetres apart err together"""
    emptiness: CloudEmptinessTerm | None
    """E2, for the surface where the frame starts; None when only the cloud's side is asked for"""
    length: Floats
    """(B,) bone lengths of the model that `emptiness` was made for [m]"""


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
    cells = np.floor(points / (settings.cloud.patch_mm * _MM)).astype(np.int64)
    patches = len(np.unique(cells, axis=0))
    emptiness = None
    if settings.cloud.balance < 1:
        margin = settings.cloud.crop_mm * _MM
        mesh = surface_mesh(surface, start)
        emptiness = CloudEmptinessTerm.at_start(points, mesh, seen.cloud_views, margin_m=margin)
        emptiness = _within_reach(emptiness, model, settings)
    share = min(1.0, patches / len(points))
    return SeenCloud(prepare_cloud(points), share, emptiness, model.skeleton.length)


def _within_reach(
    term: CloudEmptinessTerm, model: ArticulatedModel, settings: TrackerSettings
) -> CloudEmptinessTerm:
    """Return E2 without the forearm's points near and beyond where the cloud was cut off."""
    if not model.has_forearm:
        return term
    reach = settings.silhouettes.forearm_seen_mm * _MM - _CUT_MARGIN_M
    kept = (term.bone != model.skeleton.bone("forearm")) | (term.local[:, 1] < reach)
    return replace(term, bone=term.bone[kept], local=np.ascontiguousarray(term.local[kept]))


def cloud_terms(
    seen: SeenCloud, model: ArticulatedModel, settings: TrackerSettings, band_mm: float
) -> list[ObservationTerm]:
    """Return E1 and E2 as negative log-likelihoods, robust beyond a few bands."""
    chosen = settings.cloud
    robust = GemanMcClure(max(_ROBUST_BANDS * band_mm / chosen.sigma_mm, 2.0))
    terms: list[ObservationTerm] = [
        CloudDistanceTerm(
            seen.prepared,
            MetaballSurface.of(model),
            sigma_m=chosen.sigma_mm * _MM,
            loss=robust,
            weight=2 * chosen.balance * chosen.weight * seen.share,
        )
    ]
    if seen.emptiness is not None:
        share = min(1.0, (_MESH_MM / chosen.patch_mm) ** 2)
        # A person's size scales each bone's flesh about the bone's head.
        stretch = (model.skeleton.length / seen.length)[seen.emptiness.bone, None]
        terms.append(
            replace(
                seen.emptiness,
                local=seen.emptiness.local * stretch,
                sigma_m=_EMPTY_SIGMAS * chosen.sigma_mm * _MM,
                loss=GemanMcClure(_EMPTY_ROBUST),
                weight=2 * (1 - chosen.balance) * chosen.weight * share,
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
