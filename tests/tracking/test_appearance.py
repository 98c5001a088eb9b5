"""Tracking by images alone: no masks, two cameras, a patterned hand before clutter."""

import numpy as np
import pytest

from handtrack import Observation, Status, Tracker, TrackerSettings, load_model
from handtrack.model.surfaces.surface_mesh import model_mesh
from handtrack.observation.observation import ImageView
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.sequence import track_frames
from tests.experiments.scenes.textured_mesh import Pattern, cluttered_background, textured_picture

MODEL = load_model()
COUNT = 8
MOTION = motion(MODEL, "open_fist_open", 100, np.random.default_rng(0))[14 : 14 + 2 * COUNT : 2]
CAMERAS = simulated_rig(2, (320, 240)).cameras


def _pictures():
    rng = np.random.default_rng(3)
    paint = Pattern.random(MODEL.skeleton.bone_count, rng, 0.03)
    rooms = [cluttered_background(camera.size, rng) for camera in CAMERAS]
    mesh = model_mesh(MODEL)
    seen = []
    for frame, joint in enumerate(MOTION):
        bones = MODEL.bones(joint)
        views = [
            ImageView(camera, textured_picture(camera, mesh, bones, paint, room)[0])
            for camera, room in zip(CAMERAS, rooms, strict=True)
        ]
        seen.append(Observation(frame, frame / 25.0, images=tuple(views)))
    return seen


@pytest.fixture(scope="module")
def seen():
    return _pictures()


def settings(**values):
    by_images = {"silhouettes.weight": 0, "cloud.weight": 0, "tracker.escape": False}
    return TrackerSettings().with_values(
        by_images | {k.replace("__", "."): v for k, v in values.items()}
    )


BOTH = settings(edges__weight=1, intensity__weight=1)


def followed(seen, how=BOTH, frames=range(COUNT), start=0):
    observe = {observation.frame: observation for observation in seen}
    tracker = Tracker(MODEL, how)
    return list(track_frames(tracker, lambda f, _: observe[f], start, MOTION[start], frames))


def errors_mm(results):
    truth = [MODEL.joint_positions(MODEL.bones(MOTION[r.frame])) for r in results]
    off = [r.joint_positions - t for r, t in zip(results, truth, strict=True)]
    return np.array([1e3 * np.linalg.norm(x, axis=1).mean() for x in off])


@pytest.fixture(scope="module")
def forward(seen):
    return followed(seen)


def test_the_hand_is_followed_without_any_mask(forward):
    moved = 1e3 * np.linalg.norm(np.diff([r.joint_positions for r in forward], axis=0), axis=2)
    assert moved.mean() > 3.0  # a frame
    assert errors_mm(forward).mean() < 6.0  # measured 4.6 mm: a pixel is 1.7 mm
    assert errors_mm(forward).max() < 9.0  # measured 7.2 mm, in the first frame, by edges alone
    assert {r.status for r in forward[1:]} == {Status.TRACKED}  # of the first, a finger is doubted
    assert set(forward[0].energies) >= {"edges"}
    assert set(forward[3].energies) >= {"edges", "intensity"}
