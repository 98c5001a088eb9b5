"""How sure a first pose is: how well it fits what was seen, and how much better than the next."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.observation.observation import Observation
from handtrack.terms.outline_overlap import outline_overlap
from handtrack.tracker.cloud_terms import explained_share
from handtrack.tracker.frame_terms import frame_terms
from handtrack.tracker.settings import TrackerSettings

_NEAR_M = 0.006  # as in assessment
_INDEPENDENT = (
    30  # measurements; outlines and clouds of one hand that is not the model's err together
)


def shares(costs: Floats) -> Floats:
    """Return (N,) the share of each pose among all found, from their costs (N,).

    How large errors usually are is not known for a first frame, so it is integrated out: with n independent
    measurements of unknown spread, a pose of cost E has the likelihood E^(−n/2).
    """
    least = max(float(costs.min()), 1e-12)
    weight = (np.maximum(costs, 1e-12) / least) ** (-0.5 * _INDEPENDENT)
    return weight / weight.sum()


def fit_quality(
    model: ArticulatedModel, settings: TrackerSettings, seen: Observation, params: Floats
) -> float:
    """Return 0 to 1: 0 where tracking would call the pose (P,) lost, ½ where doubtful, 1 as far above that again."""
    bones, limits = model.bones(params), settings.tracker
    terms = frame_terms(model, settings, seen, bones, None)
    qualities = []
    if terms.prepared:
        overlap = float(np.median(outline_overlap(terms.prepared, model.flesh["fine"], bones).iou))
        qualities.append(_between(overlap, limits.lost_overlap, limits.doubtful_overlap))
    if terms.cloud is not None:
        share = explained_share(terms.cloud, model, bones, _NEAR_M)
        qualities.append(_between(share, limits.lost_cloud, limits.doubtful_cloud))
    return min(qualities, default=0.0)


def _between(value: float, lost: float, doubtful: float) -> float:
    return float(np.clip(0.5 * (value - lost) / max(doubtful - lost, 1e-9), 0.0, 1.0))
