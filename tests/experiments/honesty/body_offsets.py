"""Benchmark: people of unknown size, seen by a detector that sees joints beside ours and by cameras that are off: what is found, and is it true?

Bodies that are the model's own, and other people's captured motion (shared test data, HANDTRACK_DATA), in three cameras; a fourth is looked
at afterwards. Where the detector sees a joint is 30 mm off in its bone, left and right mirrored, and 5 px that last; each camera is turned by 0.3°.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from handtrack.arrays import D2, D3, C, F, Floats, J, P
from handtrack.bench.measuring import data_folder
from handtrack.capture.images.openpose import LAYOUTS
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix
from handtrack.model.articulated import ArticulatedModel, HandScale
from handtrack.model.model_file import load_model
from handtrack.model.size import SizeParameters
from handtrack.observation.observation import ImageKeypoints, Observation
from handtrack.simulation.motion import motion
from handtrack.simulation.retarget import fitted_model, retarget
from handtrack.tracking.frame.control import Control
from handtrack.tracking.frame.result import FrameResult
from handtrack.tracking.search.initialize import fit_keypoints
from handtrack.tracking.search.keypoint_start import in_space
from handtrack.tracking.sequence import refine_recording, track_frames
from handtrack.tracking.size.person import OpenPerson
from handtrack.tracking.tracker import Tracker
from handtrack.tracking.whole.chosen_frames import fit_person
from handtrack.tracking.whole.refinement import Refinement
from tests.experiments.honesty.bodies import CHI2_90, EVERY, FPS, SETTINGS, SIGMA_PX, lasting
from tests.experiments.jumps.body_retarget import captured_clips
from tests.experiments.jumps.monocular_dance import framing_camera

FRAMES, OWN_FRAMES, CAMERAS, OWN = 30, 40, 3, 4
"""of a stretch of captured motion, and of one of our own; that are tracked by; bodies of our own"""
_OFFSET_M, _TURN_DEG = 0.030, 0.3
_SIZED_FRAMES = 16
WAYS = {
    "mean": (False, False, False),
    "size": (True, False, False),
    "size_offsets": (True, True, False),
    "size_offsets_together": (True, True, True),
}
"""of a person, before tracking: whether size and offsets are found; and whether offsets are again with all frames"""


@dataclass(frozen=True, eq=False)
class Filmed:
    """A stretch of somebody's motion, and what cameras see of it."""

    names: tuple[str, ...]
    places: Floats[F, J, D3]
    """the true joints [m]"""
    said: tuple[Camera, ...]
    """the cameras as they are said to be"""
    other: Camera
    pixels: Floats[C, F, J, D2]
    """the last of the other camera"""

    def observation(self, frame: int, bones: object = None) -> Observation:
        """Return the joints as the cameras see them."""
        seen = (
            ImageKeypoints(camera, self.names, pixels[frame], SIGMA_PX)
            for camera, pixels in zip(self.said, self.pixels, strict=False)
        )
        return Observation(frame, frame / FPS, keypoints=tuple(seen))

    def placed(self, model: ArticulatedModel, frame: int) -> Floats[P]:
        """Return the pose that the cameras' joints say in space."""
        joints = [k for k in self.observation(frame).keypoints if isinstance(k, ImageKeypoints)]
        points = in_space(model, joints, 0.003)
        assert points is not None
        return fit_keypoints(model, points)


def body(scale: HandScale) -> ArticulatedModel:
    """Return somebody's body34."""
    return load_model("body34", scale=scale)


def own_bodies() -> Iterator[Filmed]:
    """Yield dancers who are the model's own, of any size."""
    names = tuple(LAYOUTS["body_25b"].points)
    for seed in range(OWN):
        rng = np.random.default_rng([seed, 99])
        size = SizeParameters(body(HandScale()))
        deviations = rng.normal(size=len(size.names))
        deviations[0] *= 0.5  # 5 %: the 10 that the prior allows are for children as well
        scale = replace(size.scale(deviations), offsets_mm=_offsets_mm(names, rng))
        model = body(scale)
        joint = motion(model, "dance", OWN_FRAMES, rng)
        poses = np.array([model.clipped(model.transform.solver_params(row)) for row in joint])
        rows = [model.joint_names.index(name) for name in names]
        places = np.array([model.joint_positions(model.bones(pose))[rows] for pose in poses])
        yield _filmed(model, names, places, poses, rng)


def captured() -> Iterator[Filmed]:
    """Yield stretches of captured motion, every other one."""
    clips = {name: clip.resampled(FPS) for name, clip in captured_clips(data_folder()).items()}
    stretches = [
        (name, first) for name, clip in clips.items() for first in range(0, len(clip.positions) - FRAMES, EVERY)
    ]  # fmt: skip
    for name, first in stretches[::2]:
        clip = clips[name]
        size = fitted_model(body, clip.names, clip.positions).scale
        rng = np.random.default_rng([first, len(clip.positions), 7])
        turn = rotation_matrix(np.array([0.0, rng.uniform(0.0, 2.0 * np.pi), 0.0]))
        places = clip.positions[first : first + FRAMES]
        places = (places - places.reshape(-1, 3).mean(axis=0)) @ turn.T
        model = body(replace(size, offsets_mm=_offsets_mm(clip.names, rng)))
        yield _filmed(model, clip.names, places, retarget(model, clip.names, places), rng)


def _filmed(
    model: ArticulatedModel, names: tuple[str, ...], places: Floats[F, J, D3], poses: Floats[F, P], rng: np.random.Generator
) -> Filmed:  # fmt: skip
    rows = [model.joint_names.index(name) for name in names]
    beside = model.seen_point - model.joint_point
    turned = [np.einsum("jab,jb->ja", model.bones(pose).rotation[model.joint_bone], beside) for pose in poses]  # fmt: skip
    seen, first = places + np.array(turned)[:, rows], framing_camera(places)
    cameras = []
    for k in range(CAMERAS + 1):  # not opposite each other
        around = rotation_matrix(np.array([0.0, 0.9 * 2.0 * np.pi * k / (CAMERAS + 1), 0.0]))
        cameras.append(replace(first, name=f"cam{k}", rotation=first.rotation @ around.T))
    pixels = [camera.project(seen) + lasting(len(places), len(names), rng) for camera in cameras]
    said = []
    for camera in cameras[:CAMERAS]:
        axis = rng.normal(size=3)
        off = rotation_matrix(np.deg2rad(_TURN_DEG) * axis / np.linalg.norm(axis))
        rotation = camera.rotation @ off
        said.append(replace(camera, rotation=rotation, translation=-rotation @ camera.centre))
    return Filmed(names, places, tuple(said), cameras[-1], np.array(pixels))


def _offsets_mm(names: tuple[str, ...], rng: np.random.Generator) -> dict[str, tuple[float, float, float]]:  # fmt: skip
    """Return where a detector sees joints: mirror images left and right, and in the middle plane what has no side."""
    size = SizeParameters(body(HandScale()), names)
    deviations = np.zeros(len(size.names))
    drawn = rng.normal(scale=_OFFSET_M / np.sqrt(3.0), size=size.offset_count)
    deviations[-size.offset_count :] = drawn / size.units[-size.offset_count :]
    return size.scale(deviations).offsets_mm


def body_offsets() -> dict[str, float]:
    """Return means over stretches, of own bodies and captured ones, for each way: the joints' error [mm], as they came and refined; how far the
    fourth camera's joints are (median) [px]; the share of joints in their stated 90 % region; of frames beyond twice what is stated.
    """
    figures: dict[str, float] = {}
    for kind, filmed in (("own", list(own_bodies())), ("captured", list(captured()))):
        for way, found in WAYS.items():
            rows = [_figures(one, *found) for one in filmed]
            for key in rows[0]:
                figures[f"{kind}_{way}_{key}"] = float(np.mean([row[key] for row in rows]))
    return figures


def _figures(filmed: Filmed, sizes: bool, offsets: bool, together: bool) -> dict[str, float]:
    model, frames = body(HandScale()), range(len(filmed.places))
    if sizes or offsets:
        looked = np.unique(np.linspace(0, frames[-1], _SIZED_FRAMES).round()).astype(int).tolist()
        seen = [filmed.observation(frame) for frame in looked]
        poses = [filmed.placed(model, frame) for frame in looked]
        scale = fit_person(OpenPerson(body, sizes, offsets), model, SETTINGS, seen, poses)
        model = model if scale is None else body(scale)
    tracker, told = Tracker(model, SETTINGS), list[str]()
    start = filmed.placed(model, 0)
    live = list(track_frames(tracker, filmed.observation, 0, start, frames))
    who = OpenPerson(body, sizes, together) if sizes else None
    control = Control(on_shared=told.append)
    refined = refine_recording(replace(tracker, subject=who), filmed.observation, live, control)
    shared = Refinement.read(told[-1]) if told else None
    person = model if shared is None or shared.scale is None else body(shared.scale)
    covered, beyond = _stated(filmed, refined)
    return {
        "live_mm": _off_mm(filmed, live),
        "mm": _off_mm(filmed, refined),
        "fourth_px": _fourth_px(filmed, person, refined),
        "coverage90": covered,
        "beyond_2_sigma": beyond,
    }


def _rows(filmed: Filmed) -> list[int]:
    names = body(HandScale()).joint_names
    return [names.index(name) for name in filmed.names]


def _off_mm(filmed: Filmed, results: list[FrameResult]) -> float:
    rows = _rows(filmed)
    off = [result.joint_positions[rows] - filmed.places[result.frame] for result in results]
    return 1e3 * float(np.linalg.norm(off, axis=2).mean())


def _fourth_px(filmed: Filmed, person: ArticulatedModel, results: list[FrameResult]) -> float:
    off, rows = [], _rows(filmed)
    for result in results:
        bones = person.bones(person.transform.solver_params(result.parameters))
        points = bones.to_world(person.joint_bone, person.seen_point)[rows]
        off.append(filmed.other.project(points) - filmed.pixels[-1][result.frame])
    return float(np.median(np.linalg.norm(off, axis=2)))


def _stated(filmed: Filmed, results: list[FrameResult]) -> tuple[float, float]:
    """Return the shares of joints in their stated 90 % region, and of frames whose error is beyond twice the stated."""
    inside, beyond, rows = [], [], _rows(filmed)
    for result in results:
        off = result.joint_positions[rows] - filmed.places[result.frame]
        stated = result.joint_covariance[rows]
        inside.append((off * np.linalg.solve(stated, off[..., None])[..., 0]).sum(axis=1) < CHI2_90)
        error, said = (off**2).sum(axis=1).mean(), np.trace(stated, axis1=1, axis2=2).mean()
        beyond.append(error > 4.0 * said)
    return float(np.mean(inside)), float(np.mean(beyond))
