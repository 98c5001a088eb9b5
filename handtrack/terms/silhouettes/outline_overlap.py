"""Overlap of the model's outline with the mask, per camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D2, C, Floats, Ints, N
from handtrack.model.ellipsoids import Ellipsoids
from handtrack.model.kinematics import BonePoses
from handtrack.observation.observation import Silhouette
from handtrack.terms.silhouettes.overlap_kernels import overlap_areas
from handtrack.terms.silhouettes.prepared_silhouette import PreparedSilhouette
from handtrack.terms.silhouettes.silhouette_terms import prepared


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
    silhouettes: Sequence[Silhouette | PreparedSilhouette],
    ellipsoids: Ellipsoids,
    bones: BonePoses,
    row_step: int = 1,
) -> OutlineOverlap:
    """Return the areas of the model's hard outline, as far out as masks have it, of the masks, and
    of both together.

    Parameters
    ----------
    row_step
        Of how many rows one is looked at.
    """
    seen, whole = prepared(silhouettes), [np.arange(len(ellipsoids))]
    model, both = parts_overlap(seen, ellipsoids, whole, bones, row_step)[0].T
    return OutlineOverlap(model, np.array([camera.area for camera in seen]), both)


def parts_overlap(
    silhouettes: Sequence[PreparedSilhouette],
    ellipsoids: Ellipsoids,
    parts: Sequence[Ints[N]],
    bones: BonePoses,
    row_step: int = 1,
) -> Floats[N, C, D2]:
    """Return for each part alone, the ellipsoids of those numbers, the areas of its outline, and of
    outline and mask together.
    """
    rescaled = ellipsoids.rescaled(bones)
    starts = np.cumsum([0, *map(len, parts)])
    members = np.concatenate([*parts, np.empty(0, np.int64)]).astype(np.int64)
    areas = np.zeros((len(silhouettes), len(parts), 2))
    for seen, found in zip(silhouettes, areas, strict=True):
        arrays = rescaled.thicker(seen.wider_m).arrays
        view = seen.camera.projection, seen.mask
        overlap_areas(bones.frames, arrays, *view, starts, members, row_step, found)
    return areas.swapaxes(0, 1)
