"""Benchmark: the three papers' experiments, each by its own method (`--set method=…`) and by the default, in the live pass.

Two of them need the shared test data (HANDTRACK_DATA). Run: handtrack bench papers.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from handtrack import (
    ArticulatedModel,
    Camera,
    ImageKeypoints,
    Observation,
    TrackingRun,
    load_model,
)
from handtrack.arrays import D3, Array, Floats, H, P, W
from handtrack.bench.measuring import data_folder, recording
from handtrack.model.metaballs import model_mesh
from handtrack.model.pose_library import named_pose
from handtrack.observation.observation import ImageView
from handtrack.session.layout import TRUTH_FILE
from handtrack.simulation.motion import motion
from handtrack.simulation.motion_files.clip import read_bvh
from handtrack.simulation.motion_files.read_motion import BANDAI_JOINTS
from handtrack.simulation.retarget import fitted_model, retarget
from handtrack.simulation.simulate import simulated_rig
from handtrack.solver.levenberg_marquardt import solve
from handtrack.solver.problem import Problem
from handtrack.solver.solver_settings import SolverSettings
from handtrack.terms.images import depth_picture
from handtrack.terms.silhouettes import ConicFieldTerm
from handtrack.tracking.sequence import track_frames
from tests.experiments.scenes.closing_fist import scene
from tests.experiments.scenes.simulated_clouds import DIGICLOPS, depth_views
from tests.experiments.scenes.simulated_fields import field_views
from tests.experiments.scenes.textured_mesh import (
    Pattern,
    cluttered_background,
    in_image,
    textured_picture,
)
from tests.experiments.tracked_frames import joint_error_mm, mean_mm, tracked

Settings = Mapping[str, object]
_FRAMES = 25
"""of the stereo recordings and of the dance; the others have a hundred"""
_LIVE: Settings = {"tracker.estimate": "forward"}
_PALM = ("wrist", "middle_mcp")
_DANCE = "bandai_body_motion/dance-short_frames_0300-0899.bvh"
_DANCE_FPS, _DANCER_FRAMES = 25.0, 100
_SIZE, _WAVE_M = (640, 480), 0.12
_NOISE_PX, _NOISE_RAD, _NOISE_M = 2.0, np.deg2rad(3.0), 0.02
"""of the first frame's joints in the image, and of its pose"""
_POSES, _FOUND_MM = 100, 0.05
_NAMES = "rest", "open", "fist", "point", "pinch", "curl", "flat"
_APPEARANCE: Settings = {
    "silhouettes.weight": 0, "edges.weight": 1, "intensity.weight": 1, "tracker.hypotheses": 8, "mixture.scale": 5,
}  # fmt: skip


def papers() -> dict[str, float]:
    """Return each experiment's error by the paper's method and by the default."""
    figures: dict[str, float] = {}
    for experiment, method in (
        (_fist, "paper2007"), (_poor_clouds, "paper2004"), (_stereo, "paper2004"), (_dance, "paper2003"),
    ):  # fmt: skip
        for name, settings in ((method, {"method": method}), ("default", _LIVE)):
            figures |= {f"{name}_{key}": value for key, value in experiment(settings)}
    return figures | {
        "paper2007_fields_found": _fields(True),
        "default_fields_found": _fields(False),
    }


def _fields(depth_scaled: bool) -> float:
    """Return how many of random poses are found again from 5 mm and 3° away in field images of two cameras, as a share.

    A perfect model sees its own field, so the true pose costs nothing. depth_scaled: fields by the paper's scale.
    """
    model, cameras, found = load_model(), simulated_rig(2).cameras, 0
    settings = SolverSettings(iterations=20, cost_tolerance=0.0, step_tolerance=1e-9)
    for seed in range(_POSES):
        rng = np.random.default_rng(seed)
        (a, b), share = rng.choice(_NAMES, 2, replace=False), rng.uniform()
        joint = (1 - share) * named_pose(model, str(a)) + share * named_pose(model, str(b))
        joint[:6] = rng.normal(scale=[0.02] * 3 + [0.25] * 3)
        joint[1] -= 0.09  # the palm's middle, not the wrist, where the cameras look
        truth = model.clipped(model.transform.solver_params(joint))
        off = rng.normal(size=len(truth)) * ([0.005] * 3 + [np.deg2rad(3.0)] * (len(truth) - 3))
        seen = field_views(model, truth, cameras, depth_scaled)
        term = ConicFieldTerm(seen, model.ellipsoids["fine"], normalised=not depth_scaled)
        end = solve(Problem(model, [term]), model.clipped(truth + off), settings)
        found += joint_error_mm(model, end.params, truth) < _FOUND_MM
    return found / _POSES


def _fist(settings: Settings) -> Iterator[tuple[str, float]]:
    """Masks of a hand that closes and opens: two cameras cannot see the fingers in the fist, six can."""
    for cameras in (2, 6):
        what = scene(cameras)
        start = what.model.transform.solver_params(what.joint_params[0])
        found = tracked(what.model, settings, what.observations, start)
        joints = np.stack([result.joint_positions for result in found])
        yield f"{cameras}cam_mean_mm", mean_mm(joints, what.joints)


def _poor_clouds(settings: Settings) -> Iterator[tuple[str, float]]:
    """The palm in clouds of 320 × 240 of a closing and opening hand."""
    rng, model = np.random.default_rng(0), load_model()
    truth = [model.transform.solver_params(x) for x in motion(model, "open_fist_open", 100, rng)]
    seen = list(
        depth_views(model, np.array([model.joint_params(x) for x in truth]), DIGICLOPS, rng)
    )
    palm = [model.joint_names.index(name) for name in _PALM]
    true = np.array([model.joint_positions(model.bones(x))[palm] for x in truth])
    found = np.array([r.joint_positions[palm] for r in tracked(model, settings, seen, truth[0])])
    off = np.linalg.norm(found - true, axis=2).mean(axis=1)
    yield "poor_clouds_median_mm", 1e3 * float(np.median(off))


def _stereo(settings: Settings) -> Iterator[tuple[str, float]]:
    """Clouds of stereo: a synthetic pair of another hand, and three infrared pairs of a real one beside joints that a detector saw."""
    for name, file, figure, of_all in (
        ("webxr_stereo_768", TRUTH_FILE, "stereo_mean_mm", np.nanmean),
        ("d405_real_stereo", "reference_dlt.npz", "real_stereo_median_mm", np.nanmedian),
    ):
        session = recording(name)
        run = TrackingRun.open(
            session, {"model.fit_size": False, "keypoints.weight": 0, **settings}
        )
        first, start = run.initial()
        wanted = range(first, first + _FRAMES)
        found = run.result(track_frames(run.tracker, run.observation, first, start, wanted))
        assert found.keypoints21 is not None
        with np.load(session.folder / file) as known:
            places = known["keypoints21"]
            frames = known["frame"].tolist() if "frame" in known else range(len(places))
        true = dict(zip(frames, places, strict=True))
        shared = [n for n, frame in enumerate(found.frame.tolist()) if frame in true]
        off = found.keypoints21[shared] - np.array([true[found.frame[n]] for n in shared])
        yield figure, 1e3 * float(of_all(np.linalg.norm(off, axis=2)))


@dataclass(frozen=True, eq=False)
class Dance:
    """A textured body34 of the dancer's size before one camera."""

    model: ArticulatedModel
    params: Floats
    """(F, P) the truth"""
    camera: Camera
    images: tuple[Array[H, W, D3], ...]
    covered: tuple[Array[H, W], ...]
    """the share of each pixel that the dancer covers"""

    @classmethod
    def rendered(cls, frames: int, seed: int = 0) -> Dance:
        """Return the first frames, at 25 a second."""
        clip = read_bvh(data_folder() / _DANCE, positions="replace").renamed(BANDAI_JOINTS)
        places = clip.resampled(_DANCE_FPS).positions[:_DANCER_FRAMES]
        model = fitted_model(lambda scale: load_model("body34", scale=scale), clip.names, places)
        params = retarget(model, clip.names, places[:frames])
        focal, (width, height) = 1.19 * _SIZE[0], _SIZE
        matrix = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
        turn = np.diag([1.0, -1.0, -1.0])
        camera = Camera("front", _SIZE, matrix, np.zeros(5), turn, -turn @ (0.0, 0.95, 4.3))
        rng = np.random.default_rng(seed)
        paint = Pattern.random(model.skeleton.bone_count, rng, _WAVE_M)
        room, mesh = cluttered_background(_SIZE, rng), model_mesh(model)
        pictures = [textured_picture(camera, mesh, model.bones(x), paint, room) for x in params]
        images, covered = zip(*pictures, strict=True)
        return cls(model, params, camera, images, covered)

    def observation(self, frame: int) -> Observation:
        """Return the frame's image; of the first one also where its joints are, as marked by hand."""
        marks: tuple[ImageKeypoints, ...] = ()
        if frame == 0:
            joints = self.model.joint_positions(self.model.bones(self.params[0]))
            pixels = self.camera.project(joints)
            pixels = pixels + np.random.default_rng(1).normal(scale=_NOISE_PX, size=pixels.shape)
            marks = (ImageKeypoints(self.camera, self.model.joint_names, pixels, _NOISE_PX),)
        images = (ImageView(self.camera, self.images[frame]),)
        return Observation(frame, frame / _DANCE_FPS, keypoints=marks, images=images)

    def start(self) -> Floats[P]:
        """Return a first pose near the truth, as somebody poses it by hand."""
        scale = np.full(self.params.shape[1], _NOISE_RAD)
        scale[:3] = _NOISE_M
        return self.model.clipped(self.params[0] + np.random.default_rng(2).normal(scale=scale))


def _dance(settings: Settings) -> Iterator[tuple[str, float]]:
    """A dance before one camera, by edges and intensity: overlap with the dancer, error relative to the root."""
    if "method" not in settings:
        settings = {**settings, **_APPEARANCE}
    what = Dance.rendered(_FRAMES)
    model, mesh = what.model, model_mesh(what.model)
    seen = [what.observation(frame) for frame in range(_FRAMES)]
    overlap, error = [], []
    for result in tracked(model, settings, seen, what.start()):
        bones = model.bones(model.transform.solver_params(result.parameters))
        ours = in_image(depth_picture(mesh, bones, what.camera))[0] >= 0
        true = what.covered[result.frame] > 0.5
        overlap.append((ours & true).sum() / (ours | true).sum())
        joints = [model.joint_positions(b) - b.position[0] for b in (bones, model.bones(what.params[result.frame]))]  # fmt: skip
        error.append(mean_mm(*joints))
    yield "dance_overlap", float(np.mean(overlap))
    yield "dance_relative_mm", float(np.mean(error))
