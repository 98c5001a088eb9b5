"""Tracking by images alone: no masks, two cameras, a patterned hand before clutter."""

import numpy as np

from handtrack import Observation, Status, Tracker, TrackerSettings, load_model
from handtrack.model.metaballs import model_mesh
from handtrack.observation.observation import ImageView
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.sequence import track_frames
from tests.experiments.scenes.textured_mesh import Pattern, cluttered_background, textured_picture
from tests.tracking.scenes import off_mm

MODEL = load_model()
FRAMES = range(8)
POSES = motion(MODEL, "open_fist_open", 100, np.random.default_rng(0))[14:30:2]
BY_IMAGES = TrackerSettings().with_values({
    "silhouettes.weight": 0, "cloud.weight": 0, "edges.weight": 1, "intensity.weight": 1, "tracker.escape": False,
})  # fmt: skip


def observer():
    """Return what sees the patterned hand in a frame."""
    rng = np.random.default_rng(3)
    mesh, paint = model_mesh(MODEL), Pattern.random(MODEL.skeleton.bone_count, rng, 0.03)
    rooms = [(c, cluttered_background(c.size, rng)) for c in simulated_rig(2, (320, 240)).cameras]

    def observe(frame, _bones):
        bones = MODEL.bones(POSES[frame])
        pictures = [textured_picture(c, mesh, bones, paint, room)[0] for c, room in rooms]
        views = [ImageView(c, picture) for (c, _), picture in zip(rooms, pictures, strict=True)]
        return Observation(frame, frame / 25.0, images=tuple(views))

    return observe


def test_the_hand_is_followed_without_any_mask():
    found = list(track_frames(Tracker(MODEL, BY_IMAGES), observer(), 0, POSES[0], FRAMES))
    moved = 1e3 * np.linalg.norm(np.diff([r.joint_positions for r in found], axis=0), axis=2)
    assert moved.mean() > 3.0  # a frame
    off = np.array([off_mm(r, MODEL, pose).mean() for r, pose in zip(found, POSES, strict=True)])
    assert off.mean() < 6.0  # measured 4.6 mm: a pixel is 1.7 mm
    assert off.max() < 9.0  # measured 7.2 mm, in the first frame, by edges alone
    assert {r.status for r in found[1:]} == {Status.TRACKED}  # of the first, a finger is doubted
    assert set(found[0].energies) >= {"edges"}
    assert set(found[3].energies) >= {"edges", "intensity"}
