"""Recovery: a lost hand is found again, and nothing else ever changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from handtrack.bench.starts.recovery import gap_run
from handtrack.capture.clouds.point_cloud import PointCloud
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.observation.observation import Observation
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracker import restart
from handtrack.tracking.frame.result import Status
from handtrack.tracking.frame.settings import TrackerSettings
from handtrack.tracking.search.evidence.start_shapes import shape_of
from handtrack.tracking.search.finger_flips import finger_flips
from handtrack.tracking.search.laid_shapes import Laid
from handtrack.tracking.search.restart import recovered, worth_restarting
from handtrack.tracking.search.start_search import narrowly_measured, start_sources
from handtrack.tracking.tracker import Tracker

MODEL = load_model()
RIG = simulated_rig(3, (320, 240))
PLAIN = TrackerSettings().with_values({"tracker.recovery": False})
JUMPS = PLAIN.with_values({"tracker.recovery": True})


def posed(pose="rest", turn=(0.0, 0.0, 0.0), away=(0.0, 0.0, 0.0)):
    joint = named_pose(MODEL, pose)
    joint[:3], joint[3:6] = away, turn
    joint[1] -= 0.09
    return MODEL.transform.solver_params(joint)


def cost_of(seen, params):
    sources = start_sources(seen, PLAIN)
    shape = shape_of(MODEL, MODEL.joint_params(params), "test")
    return narrowly_measured(sources, Laid(shape, params, np.inf)).cost


@pytest.fixture(scope="module")
def known():
    """The result of a frame that was tracked."""
    seen = mask_views(MODEL, posed(), RIG.cameras, 0)
    return Tracker(MODEL, PLAIN).step(seen, (), posed())


def test_a_hand_that_moved_on_unseen_is_found_again():
    without, jumps = (gap_run(0, on) for on in (False, True))
    assert without.moved_mm > 100.0
    assert not without.is_back
    assert jumps.is_back


def test_a_tracked_frame_is_left_alone(known, monkeypatch):
    def never(*_args, **_more):
        raise AssertionError("nothing is looked for in a frame that fits")

    monkeypatch.setattr(restart, "start_sources", never)
    seen = mask_views(MODEL, posed(turn=(0.05, 0.0, 0.0)), RIG.cameras, 1)
    plain, jumps = (Tracker(MODEL, s).step(seen, [known]) for s in (PLAIN, JUMPS))
    assert plain.status == Status.TRACKED
    assert plain.parameters.tobytes() == jumps.parameters.tobytes()
    assert plain.energy == jumps.energy


def test_no_pose_is_taken_that_fits_worse(known):
    """Whatever descent finds, a pose comes back only if the common measure is clearly lower for it."""
    truth = posed("open", (0.0, 1.2, 0.3), (0.05, 0.0, 0.0))
    seen = mask_views(MODEL, truth, RIG.cameras, 1)
    lost = replace(known, frame=1, status=Status.LOST)  # it stayed where the hand no longer is
    before = cost_of(seen, MODEL.transform.solver_params(lost.parameters))

    def worse(params):
        return replace(lost, parameters=MODEL.joint_params(posed("fist", (2.0, 0.0, 0.0))))

    assert recovered(MODEL, PLAIN, seen, lost, [known], worse) is lost

    def solved(params):
        return Tracker(MODEL, PLAIN).step(seen, (), params)

    found = recovered(MODEL, PLAIN, seen, lost, [known], solved)
    assert cost_of(seen, MODEL.transform.solver_params(found.parameters)) < 0.95 * before
    off = found.keypoints21 - MODEL.keypoints21(MODEL.bones(truth))
    assert 1e3 * np.linalg.norm(off, axis=1).mean() < 5.0
    assert recovered(MODEL, PLAIN, seen, lost, [known], solved, lambda: True) is lost, "stopped"


def test_it_is_tried_ever_more_rarely(known):
    """Of a row of frames that stay in doubt the first, second, fourth, eighth ... are looked at."""
    doubtful, previous, tried = replace(known, status=Status.DOUBTFUL), [known], []
    for row in range(1, 20):
        if worth_restarting(doubtful, previous):
            tried.append(row)
        previous = [*previous, doubtful]
    assert tried == [1, 2, 4, 8, 16]
    assert not worth_restarting(known, previous)
    lost = replace(known, status=Status.LOST)
    assert not worth_restarting(lost, []), "a first frame has nowhere to be near to"
    unseen = replace(lost, energy=float("nan"))
    assert worth_restarting(lost, [known, *[unseen] * 10]), "frames without a picture do not count"
    tried = [
        row for row in range(1, 20) if worth_restarting(unseen, [known, *[unseen] * (row - 1)])
    ]
    assert tried == [1, 2, 4, 5, 8, 10, 15, 16], "a cloud elsewhere is looked at now and then"


def test_a_cloud_that_is_elsewhere_is_found_again(rng):
    """After a gap the hand is further away than the crop: without jumps not one point is looked at."""
    truth = posed("open", (0.2, 0.3, 0.0), (0.15, 0.05, 0.1))

    def cloud_at(params, frame):
        bones = MODEL.bones(params)
        points, _ = sample_surface(MetaballSurface.of(MODEL), bones, 2500, rng)
        return Observation(frame, frame / 25.0, cloud=PointCloud(points))

    first = Tracker(MODEL, PLAIN).step(cloud_at(posed(), 0), (), posed())
    seen = cloud_at(truth, 1)
    plain, jumps = (Tracker(MODEL, s).step(seen, [first]) for s in (PLAIN, JUMPS))
    assert plain.status == Status.LOST
    assert jumps.status == Status.TRACKED
    off = jumps.keypoints21 - MODEL.keypoints21(MODEL.bones(truth))
    assert 1e3 * np.linalg.norm(off, axis=1).mean() < 2.0


def test_flipped_fingers_look_the_same():
    params = posed("curl", (0.3, 0.4, 0.0))
    seen = mask_views(MODEL, params, RIG.cameras[:1], 0)
    camera = seen.silhouettes[0].camera
    here = MODEL.keypoints21(MODEL.bones(params))
    flips = finger_flips(MODEL, seen, params)
    assert flips
    for flipped in flips:
        bounds = MODEL.bounds(flipped)
        assert (bounds[:, 0] - 1e-9 <= flipped).all()
        assert (flipped <= bounds[:, 1] + 1e-9).all()
    joints = np.stack([MODEL.keypoints21(MODEL.bones(flipped)) for flipped in flips])
    apart = np.linalg.norm(joints - here, axis=2).max(axis=1)
    assert apart.max() > 0.01, "a finger stands elsewhere"
    off = np.linalg.norm(camera.project(joints) - camera.project(here), axis=2).max(axis=1)
    sideways = apart * camera.matrix[0, 0] / camera.to_camera(here)[:, 2].mean()
    assert (off / sideways)[apart > 0.01].min() < 0.5, "but seen to move half as much at most"
