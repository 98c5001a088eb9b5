"""Simulated masks of a known pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from handtrack.arrays import D2, Array, Floats, H, P
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.ellipsoids import model_mask
from handtrack.observation.observation import Observation, Silhouette


def mask_views(
    model: ArticulatedModel, params: Floats[P], cameras: Sequence[Camera], frame: int = 0
) -> Observation:
    """Return the binary masks of a pose, decided at pixel centres."""
    ellipsoids = model.ellipsoids["fine"].posed(model.bones(params))
    seen = tuple(
        Silhouette(camera, model_mask(camera, ellipsoids).astype(np.float32), everything(camera))
        for camera in cameras
    )
    return Observation(frame, frame / 25.0, seen)


def everything(camera: Camera) -> Array[H, D2]:
    """Return the spans of a camera whose every pixel is observed."""
    return np.tile(np.array([0, camera.size[0]], np.int32), (camera.size[1], 1))
