"""Scene of the silhouette benchmarks: three cameras, one hand, a start some millimetres and degrees off."""

from __future__ import annotations

import numpy as np

from handtrack.arrays import Floats
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import Silhouette
from handtrack.simulation.render import render_mask
from handtrack.simulation.simulate import simulated_rig


def silhouette_scene(
    cameras: int = 3, size: tuple[int, int] = (640, 480), distance_m: float = 0.4
) -> tuple[ArticulatedModel, list[Silhouette], Floats]:
    """Return model, silhouettes at the relaxed pose, and parameters (P,) 5 mm and 5° away from it."""
    model = load_model("hand26")
    truth = model.rest_params()
    truth[1] -= 0.09  # the hand's middle to the world's origin, where the cameras look
    flesh = model.flesh["fine"].posed(model.bones(truth))
    seen = []
    for camera in simulated_rig(cameras, size, distance_m).cameras:
        mask = (render_mask(camera, flesh) / 255).astype(np.float32)
        valid = np.tile(np.array([0, size[0]], np.int32), (size[1], 1))
        seen.append(Silhouette(camera.without_distortion(), mask, valid))  # type: ignore[arg-type]
    off = np.random.default_rng(1).normal(size=len(truth))
    off[:3] *= 0.005
    off[3:] *= np.deg2rad(5.0)
    return model, seen, model.clipped(truth + off)
