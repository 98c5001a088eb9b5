"""What a point cloud contributes to a frame: which of its points, how much, how robustly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.metaballs import MetaballSurface
from handtrack.observation.observation import PointCloud
from handtrack.terms.cloud_distance import CloudDistanceTerm, PreparedCloud, prepare_cloud
from handtrack.terms.loss import GemanMcClure
from handtrack.tracker.settings import TrackerSettings

_MM = 1e-3
_ROBUST_BANDS = 4.0  # points further off than this many bands hardly pull
_FEWEST = 30


@dataclass(frozen=True)
class SeenCloud:
    """The hand's part of a cloud, ready for terms."""

    prepared: PreparedCloud
    share: float
    """how much one point counts: neighbours a few millimetres apart err together"""


def see_cloud(
    cloud: PointCloud | None, model: ArticulatedModel, start: BonePoses, settings: TrackerSettings
) -> SeenCloud | None:
    """Return the points near the hand at `start`; None where too few are.

    Far points are background or the rest of the body; beyond the forearm's stretch the model knows nothing.
    """
    if cloud is None or settings.cloud.weight == 0:
        return None
    points = cloud.points[np.isfinite(cloud.points).all(axis=1)]
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
    return SeenCloud(prepare_cloud(points), min(1.0, patches / len(points)))


def cloud_term(
    seen: SeenCloud, model: ArticulatedModel, settings: TrackerSettings, band_mm: float
) -> CloudDistanceTerm:
    """Return E1 as a negative log-likelihood, robust beyond a few bands."""
    chosen = settings.cloud
    return CloudDistanceTerm(
        seen.prepared,
        MetaballSurface.of(model),
        sigma_m=chosen.sigma_mm * _MM,
        loss=GemanMcClure(max(_ROBUST_BANDS * band_mm / chosen.sigma_mm, 2.0)),
        weight=chosen.weight * seen.share,
    )


def explained_share(seen: SeenCloud, model: ArticulatedModel, bones: BonePoses, within_m: float) -> float:
    """Return the share of the cloud's points that lie within a distance of the surface."""
    off = cloud_distances(seen, model, bones)
    return float(np.mean(np.abs(off) < within_m))


def cloud_distances(seen: SeenCloud, model: ArticulatedModel, bones: BonePoses) -> Floats:
    """Return the points' signed distances (N,) to the surface [m]."""
    points = np.ascontiguousarray(seen.prepared.points[:, : seen.prepared.count].T)
    return MetaballSurface.of(model).distance(bones, points)
