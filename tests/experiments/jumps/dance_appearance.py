"""Benchmark: a dance before one camera tracked by edges and intensity, as in the 2003 paper's §5.2.

The motion is the Bandai Namco data's in the shared test data (HANDTRACK_DATA); dancer and room are rendered.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from handtrack.arrays import D3, Array, F, Floats, H, P, W
from handtrack.bench.measuring import data_folder
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.kinematics import BonePoses
from handtrack.model.model_file import load_model
from handtrack.model.surfaces.surface_mesh import model_mesh
from handtrack.observation.observation import ImageKeypoints, ImageView, Observation
from handtrack.simulation.motion_files.bvh import read_bvh
from handtrack.simulation.motion_files.joint_tables import BANDAI_JOINTS
from handtrack.simulation.retarget import fitted_model, retarget
from handtrack.terms.images.depth_picture import depth_picture
from handtrack.tracking.frame.result import FrameResult
from tests.experiments.scenes.textured_mesh import Pattern, cluttered_background, textured_picture
from tests.experiments.tracked_frames import mean_mm, tracked

FPS, FRAMES = 25.0, 100
CLIP = "bandai_body_motion/dance-short_frames_0300-0899.bvh"
BAR = 0.75
"""mean overlap with the true silhouette, to the end"""
_NOISE_PX, _NOISE_DEG, _NOISE_M = 2.0, 3.0, 0.02  # of the first frame's image joints and pose
_WAVE_M = 0.12  # of the pattern on the clothes

APPEARANCE: dict[str, object] = {"silhouettes.weight": 0, "edges.weight": 1, "intensity.weight": 1}
EIGHT: dict[str, object] = {"tracker.hypotheses": 8, "mixture.scale": 5}
WAYS: dict[str, dict[str, object]] = {
    "last_frame_1": {**APPEARANCE, "intensity.memory": 0},
    "memory_1": APPEARANCE,
    "last_frame_8": {**APPEARANCE, "intensity.memory": 0, **EIGHT},
    "memory_8": {**APPEARANCE, **EIGHT},
}
"""settings of each way to track; `last_frame_8` is the paper's, `memory` carries the first frame's texture as well"""


@dataclass(frozen=True, eq=False)
class Dance:
    """The dance, and what the camera saw of it."""

    model: ArticulatedModel
    params: Floats[F, P]
    """the truth"""
    camera: Camera
    images: tuple[Array[H, W, D3], ...]
    """uint8 of each frame"""
    covered: tuple[Array[H, W], ...]
    """the share of each pixel that the dancer covers"""

    def bones(self, frame: int) -> BonePoses:
        """Return the true pose."""
        return self.model.bones(self.params[frame])

    def observation(self, frame: int) -> Observation:
        """Return the frame's image; of the first one also where its joints are seen, as marked by hand."""
        seen = (ImageView(self.camera, self.images[frame]),)
        marks: tuple[ImageKeypoints, ...] = ()
        if frame == 0:
            names = self.model.joint_names
            places = self.camera.project(self.model.joint_positions(self.bones(0)))
            places = places + np.random.default_rng(1).normal(scale=_NOISE_PX, size=places.shape)
            marks = (ImageKeypoints(self.camera, names, places, _NOISE_PX),)
        return Observation(frame, frame / FPS, keypoints=marks, images=seen)


@dataclass(frozen=True, eq=False)
class DanceTrack:
    """One way to track, by frame."""

    results: tuple[FrameResult, ...]
    overlap: Floats[F]
    """intersection over union with the true silhouette"""
    error_mm: Floats[F]
    """mean over joints, relative to the root"""


def dance(frames: int = FRAMES, size: tuple[int, int] = (640, 480), seed: int = 0) -> Dance:
    """Return the first frames of the dance at 25 a second, danced by a textured body34 of the dancer's size."""
    clip = read_bvh(data_folder() / CLIP, positions="replace").renamed(BANDAI_JOINTS)
    places = clip.resampled(FPS).positions[:FRAMES]
    model = fitted_model(lambda scale: load_model("body34", scale=scale), clip.names, places)
    params = retarget(model, clip.names, places[:frames])
    camera = front_camera(size)
    rng = np.random.default_rng(seed)
    paint = Pattern.random(model.skeleton.bone_count, rng, _WAVE_M)
    room, mesh = cluttered_background(size, rng), model_mesh(model)
    pictures = [textured_picture(camera, mesh, model.bones(x), paint, room) for x in params]
    return Dance(model, params, camera, *(tuple(part) for part in zip(*pictures, strict=True)))


def front_camera(size: tuple[int, int] = (640, 480)) -> Camera:
    """Return the camera that sees the whole dance, from the front."""
    focal, (width, height) = 1.19 * size[0], size
    matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    rotation = np.diag([1.0, -1.0, -1.0])
    return Camera("front", size, matrix, np.zeros(5), rotation, -rotation @ (0.0, 0.95, 4.3))


def first_guess(what: Dance) -> Floats[P]:
    """Return the first pose as somebody poses it by hand: near the truth."""
    rng = np.random.default_rng(2)
    scale = np.full(what.params.shape[1], np.deg2rad(_NOISE_DEG))
    scale[:3] = _NOISE_M
    return what.model.clipped(what.params[0] + rng.normal(scale=scale))


def track(what: Dance, settings: Mapping[str, object]) -> DanceTrack:
    """Return the dance tracked from the first guess on."""
    seen = [what.observation(frame) for frame in range(len(what.images))]
    results = tuple(tracked(what.model, settings, seen, first_guess(what)))
    overlap, error = [], []
    for result in results:
        bones = what.model.bones(what.model.transform.solver_params(result.parameters))
        overlap.append(overlap_with(what, result.frame, bones))
        found = what.model.joint_positions(bones) - bones.position[0]
        true = what.bones(result.frame)
        error.append(mean_mm(found, what.model.joint_positions(true) - true.position[0]))
    return DanceTrack(results, np.array(overlap), np.array(error))


def overlap_with(what: Dance, frame: int, bones: BonePoses) -> float:
    """Return the intersection over union of the model at `bones` and the true silhouette."""
    face, _ = depth_picture(model_mesh(what.model), bones, what.camera).in_image()
    ours, true = face >= 0, what.covered[frame] > 0.5
    return float((ours & true).sum() / max((ours | true).sum(), 1))


def dance_appearance() -> dict[str, float | str]:
    """Return overlap with the true silhouette and root-relative joint error [mm] for each way to track."""
    what = dance()
    figures: dict[str, float | str] = {"bar": f"mean overlap to the end ≥ {BAR} with 8 hypotheses"}
    for name, settings in WAYS.items():
        found = track(what, settings)
        figures |= {
            f"{name}_overlap_mean": float(found.overlap.mean()),
            f"{name}_overlap_last_second": float(found.overlap[-int(FPS) :].mean()),
            f"{name}_overlap_least": float(found.overlap.min()),
            f"{name}_error_mm": float(found.error_mm.mean()),
        }
    return figures
