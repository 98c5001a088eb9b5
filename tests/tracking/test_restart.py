"""Recovery: a lost hand is found again, and nothing else ever changes."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import (
    ImageKeypoints,
    Observation,
    PointCloud,
    Status,
    Tracker,
    TrackerSettings,
    TrackerState,
    load_model,
)
from handtrack.model.pose_library import named_pose
from handtrack.model.surfaces.metaballs import MetaballSurface
from handtrack.model.surfaces.surface_mesh import sample_surface
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.control import Control
from handtrack.tracking.search import lost_hand
from handtrack.tracking.search.global_search import GlobalObjective
from tests.experiments.starts.recovery import gap_runs

MODEL = load_model()
RIG = simulated_rig(3, (320, 240))
PLAIN = TrackerSettings().with_values({"tracker.recovery": False})
JUMPS = PLAIN.with_values({"tracker.recovery": True})


def posed(pose="rest", turn=(0.0, 0.0, 0.0), away=(0.0, 0.0, 0.0)):
    joint = named_pose(MODEL, pose)
    joint[:3], joint[3:6] = away, turn
    joint[1] -= 0.09
    return MODEL.transform.solver_params(joint)


def first_of(seen, start=None):
    """Return the result of a first frame."""
    begun = TrackerState.beginning_at(posed() if start is None else start)
    return Tracker(MODEL, PLAIN).step(begun, seen)[1]


def followed(settings, known, seen):
    """Return the result of the frame after a known one."""
    return Tracker(MODEL, settings).step(TrackerState.resumed([known]), seen)[1]


@pytest.fixture(scope="module")
def known():
    """The result of a frame that was tracked."""
    seen = mask_views(MODEL, posed(), RIG.cameras, 0)
    return first_of(seen)


def test_a_hand_that_moved_on_unseen_is_found_again():
    """Faults C32, C33."""
    runs = gap_runs(0, (160, 120))
    without, jumps = runs[False], runs[True]
    assert without.moved_mm > 100.0
    assert not without.is_back
    assert jumps.is_back


def test_a_cloud_that_is_elsewhere_is_found_again(rng):
    """After a gap the hand is further away than the crop: without jumps not one point is looked at."""
    truth = posed("open", (0.2, 0.3, 0.0), (0.15, 0.05, 0.1))

    def cloud_at(params, frame):
        bones = MODEL.bones(params)
        points, _ = sample_surface(MetaballSurface.of(MODEL), bones, 2500, rng)
        return Observation(frame, frame / 25.0, cloud=PointCloud(points))

    first = first_of(cloud_at(posed(), 0))
    seen = cloud_at(truth, 1)
    plain, jumps = (followed(s, first, seen) for s in (PLAIN, JUMPS))
    assert plain.status == Status.LOST
    assert jumps.status == Status.TRACKED
    off = jumps.keypoints21 - MODEL.keypoints21(MODEL.bones(truth))
    assert 1e3 * np.linalg.norm(off, axis=1).mean() < 2.0


@pytest.mark.parametrize("spoil", [np.ones_like, lambda mask: 1 - mask], ids=["white", "inverted"])
def test_masks_that_outline_nothing_are_not_searched_and_the_frame_says_so(known, spoil):
    good = mask_views(MODEL, posed(), RIG.cameras, 1)
    spoilt = [replace(one, mask=spoil(one.mask)) for one in good.silhouettes]
    searched = []
    control = Control(on_search=lambda report: searched.append(report.search.situation))
    seen = replace(good, silhouettes=tuple(spoilt))
    result = Tracker(MODEL, JUMPS).step(TrackerState.resumed([known]), seen, control)[1]
    assert result.status == Status.LOST
    assert result.reason.kind == "filled mask"
    assert lost_hand.LOST_HAND.situation not in searched
    assert GlobalObjective.of(seen, JUMPS) is None
    some = GlobalObjective.of(replace(good, silhouettes=(*good.silhouettes[:2], spoilt[2])), JUMPS)
    assert [len(source.whole) for source in some.sources] == [2]


def test_a_hand_whose_joints_two_cameras_see_there_is_not_lost_nor_looked_for(known):
    good = mask_views(MODEL, posed(), RIG.cameras, 1)
    beside = np.zeros_like(good.silhouettes[0].mask)
    beside[:80, :100] = 1.0  # something else of skin's colour
    spoilt = [replace(one, mask=np.maximum(one.mask, beside)) for one in good.silhouettes]
    places = MODEL.joint_positions(MODEL.bones(posed()))
    joints = [
        ImageKeypoints(camera, MODEL.joint_names, camera.project(places), 2.0)
        for camera in RIG.cameras
    ]

    def looked_for(*seen_joints):
        found = []
        control = Control(on_search=lambda report: found.append(report.search.situation))
        seen = replace(good, silhouettes=tuple(spoilt), keypoints=seen_joints)
        result = Tracker(MODEL, JUMPS).step(TrackerState.resumed([known]), seen, control)[1]
        return lost_hand.LOST_HAND.situation in found, result.status

    assert looked_for(joints[0]) == (True, Status.LOST)
    assert looked_for(*joints[:2]) == (False, Status.DOUBTFUL)
