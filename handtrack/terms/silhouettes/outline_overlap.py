"""Overlap of the model's outline with the mask, per camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import C, Floats
from handtrack.model.flesh import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette
from handtrack.terms.silhouettes.silhouette_field import field_system, plain_field, prepared


@dataclass(frozen=True)
class OutlineOverlap:
    """Areas (C,) [px] within the observed pixels of each camera."""

    model: Floats[C]
    mask: Floats[C]
    both: Floats[C]

    @property
    def iou(self) -> Floats[C]:
        """Return intersection over union; 1 where neither is seen."""
        union = self.model + self.mask - self.both
        return np.where(union > 0, self.both / np.maximum(union, 1e-12), 1.0)


def outline_overlap(
    silhouettes: Sequence[Silhouette | PreparedSilhouette], ellipsoids: Ellipsoids, bones: BonePoses
) -> OutlineOverlap:
    """Return the areas of the model's hard outline, of the masks, and of both together."""
    seen = prepared(silhouettes)
    shape = plain_field(len(seen), len(ellipsoids))
    _, areas = field_system(seen, ellipsoids, shape, bones, 1.0, want_system=False)
    return OutlineOverlap(areas[:, 0], np.array([s.area for s in seen]), areas[:, 1])
