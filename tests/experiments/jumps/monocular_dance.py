"""Benchmark: joint error of several hypotheses on a dance that one camera sees as 2D joints.

The motion is the Bandai Namco data's in the shared test data (HANDTRACK_DATA), put on body34 in the dancer's size; that
body's joints are the truth. `python -m docs.pictures.monocular_dance FILE.png` draws it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from handtrack.arrays import D2, D3, Axes, F, Floats, J, P
from handtrack.bench.measuring import data_folder
from handtrack.geometry.camera import Camera
from handtrack.model.articulated import ArticulatedModel
from handtrack.model.model_file import load_model
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.simulation.motion_files.bvh import read_bvh
from handtrack.simulation.motion_files.joint_tables import BANDAI_JOINTS
from handtrack.simulation.retarget import fitted_model, retarget
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.sequence import track_recording
from handtrack.tracking.tracker import Tracker
from tests.experiments.tracked_frames import mean_mm

FPS, FRAMES = 25.0, 100
CLIP = "bandai_body_motion/dance-short_frames_0300-0899.bvh"
NOISE_PX, NEAR_MM, SHOWN = 2.0, 60.0, 8
SEGMENTS = (0, 125, 250, 375)
"""first frames of four stretches of 4 s; the experiment is the first, settings were chosen on the third"""
MOTION_DEG = 5.0
"""unknown acceleration of an angle in a frame: what the CMU clip's are at 24 frames a second, at most (1 to 6 degrees)"""
SETTINGS: dict[str, object] = {"prior.motion_sigma_deg": MOTION_DEG, "mixture.draws": 40}
_SIZE, _DISTANCE_M, _MARGIN = (1920, 1080), 4.5, 0.9


@dataclass(frozen=True, eq=False)
class SeenDance:
    """A stretch of the dance, and its joints in one camera."""

    model: ArticulatedModel
    params: Floats[F, P]
    """the truth"""
    places: Floats[F, J, D3]
    """world [m]"""
    camera: Camera
    pixels: Floats[F, J, D2]
    """with noise"""

    def observation(self, frame: int) -> Observation:
        """Return the joints as seen."""
        names = self.model.joint_names
        joints = ImageKeypoints(self.camera, names, self.pixels[frame], NOISE_PX)
        return Observation(frame, frame / FPS, keypoints=(joints,))

    def start(self) -> Floats[P]:
        """Return a first guess that knows nothing of the pose: at rest in the middle of the scene, facing the camera."""
        params = self.model.rest_params()
        params[:3] = self.places[:, self.model.joint_names.index("pelvis")].mean(axis=0)
        return params

    def errors(self, shape: Floats[J, D3], frame: int) -> float:
        """Return the mean over the joints (J, 3) of their distance to the truth, both relative to the pelvis [mm]."""
        root = self.model.joint_names.index("pelvis")
        true = self.places[frame] - self.places[frame, root]
        return mean_mm(shape - shape[root], true)


@dataclass(frozen=True, eq=False)
class DanceErrors:
    """Joint errors of each frame [mm]."""

    oracle: Floats[F]
    """of the best of the hypotheses shown"""
    own: Floats[F]
    """of the heaviest"""
    refined_oracle: Floats[F]
    """of the best of those that stay with a frame once all are known"""
    refined: Floats[F]
    results: tuple[FrameResult, ...]
    """of the live pass"""


@cache
def _whole_dance() -> tuple[ArticulatedModel, Floats]:
    """Return the dancer and 20 s of motion (F, P) at 25 frames a second."""
    clip = read_bvh(data_folder() / CLIP, positions="replace").renamed(BANDAI_JOINTS)
    places = clip.resampled(FPS).positions
    model = fitted_model(lambda scale: load_model("body34", scale=scale), clip.names, places)
    return model, retarget(model, clip.names, places)


def seen_dance(first: int = 0, frames: int = FRAMES, seed: int = 0) -> SeenDance:
    """Return a stretch of the dance in a full HD camera before the dancer, framed so that all of it is just in the image."""
    model, params = _whole_dance()
    params = params[first : first + frames]
    places = np.stack([model.joint_positions(model.bones(pose)) for pose in params])
    camera = framing_camera(places)
    pixels = camera.project(places)
    rng = np.random.default_rng(seed)
    return SeenDance(
        model, params, places, camera, pixels + rng.normal(scale=NOISE_PX, size=pixels.shape)
    )


def framing_camera(places: Floats[*Axes, D3]) -> Camera:
    """Return a camera in front, 4.5 m from the middle of the points, that they fill."""
    points = places.reshape(-1, 3)
    rotation = np.diag([1.0, -1.0, -1.0])
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    translation = -rotation @ middle + (0.0, 0.0, _DISTANCE_M)
    local = points @ rotation.T + translation
    rays = local[:, :2] / local[:, 2:]
    low, high = rays.min(axis=0), rays.max(axis=0)
    size = np.array(_SIZE)
    focal = _MARGIN * float((size / (high - low)).min())
    cx, cy = 0.5 * (size - 1) - focal * 0.5 * (low + high)
    matrix = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    return Camera("front", _SIZE, matrix, np.zeros(5), rotation, translation)


def tracked(what: SeenDance, hypotheses: int, **more: object) -> DanceErrors:
    """Return the errors of tracking a dance with a number of hypotheses."""
    values = {"tracker.hypotheses": hypotheses, **SETTINGS, **more}
    settings = TrackerSettings().with_values(values)
    tracker = Tracker(what.model, settings)
    found = list(
        track_recording(
            tracker, lambda n, _: what.observation(n), 0, what.start(), range(len(what.pixels))
        )
    )
    results, refined = found[: len(what.pixels)], found[len(what.pixels) :]
    return DanceErrors(*_errors(what, results), *_errors(what, refined), results=tuple(results))


def _errors(what: SeenDance, results: list[FrameResult]) -> tuple[Floats[F], Floats[F]]:
    """Return the errors of each frame's best pose of those shown, and of its own."""
    own = np.array([what.errors(r.joint_positions, r.frame) for r in results])
    oracle = own.copy()
    for row, result in enumerate(results):
        for pose in result.alternatives[:SHOWN]:
            params = what.model.transform.solver_params(pose.parameters)
            shape = what.model.joint_positions(what.model.bones(params))
            oracle[row] = min(oracle[row], what.errors(shape, result.frame))
    return oracle, own


def monocular_dance(segments: tuple[int, ...] = SEGMENTS) -> dict[str, Any]:
    """Return shares of frames within 60 mm, and mean errors [mm]: of the best of 8, the tracker's choice, and one alone."""
    figures: dict[str, Any] = {
        "truth": "body34's joints, retargeted from the BVH file (median 3 mm from its own)",
        "bar": f"the best of {SHOWN} within {NEAR_MM:g} mm in 95 % of the frames of the first stretch",
    }
    for first in segments:
        what = seen_dance(first)
        found = summary(tracked(what, SHOWN), tracked(what, 1))
        figures |= {f"at_{first / FPS:g}_s_{name}": value for name, value in found.items()}
    return figures


def summary(several: DanceErrors, one: DanceErrors) -> dict[str, float]:
    """Return share of frames that are near, and mean error [mm], of each way to choose."""
    rows = {
        "best_of_8": several.oracle,
        "own_choice": several.own,
        "refined_best_of_8": several.refined_oracle,
        "refined": several.refined,
        "single": one.own,
        "single_refined": one.refined,
    }
    near = {f"{name}_near": float((errors < NEAR_MM).mean()) for name, errors in rows.items()}
    return near | {f"{name}_mm": float(errors.mean()) for name, errors in rows.items()}
