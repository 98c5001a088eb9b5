"""A body before one camera, all frames together: what its errors that last leave open, limbs flipped throughout."""

from dataclasses import replace

import numpy as np
import pytest

from handtrack import Camera, Observation, TrackerSettings
from handtrack.arrays import Floats
from handtrack.model.pose_changes import PLACE
from handtrack.tracking.size.estimate import estimate_whole
from handtrack.tracking.whole.evidence import Evidence, new_share
from handtrack.tracking.whole.trajectory_hypotheses import (
    TrajectoryHypothesis,
    trajectory_hypotheses,
)
from tests.tracking.test_doubt_of_bodies import BODY, FRONT, SIDE, joints_of_body

FRAMES = range(4)


def _reaching() -> np.ndarray:
    """Return an arm that is held out to the front, and a little more so in each frame."""
    joint = BODY.joint_params(BODY.rest_params())
    joint[BODY.parameter_names.index("left_shoulder_flex")] = 0.4
    first = BODY.clipped(BODY.transform.solver_params(joint))
    found = np.tile(first, (len(FRAMES), 1))
    found[:, BODY.transform.names.index("left_shoulder_flex")] += 0.02 * np.arange(len(FRAMES))
    return found


def _evidence(
    poses: np.ndarray, *cameras: Camera, off_px: Floats = np.zeros((4, 1, 2))
) -> Evidence:
    def observe(frame: int, _bones: object = None) -> Observation:
        seen = joints_of_body(poses[frame], *cameras, off_px=off_px[frame])
        return replace(seen, frame=frame, time_s=frame / 25.0)

    settings = TrackerSettings().with_values({"prior.motion_sigma_deg": 5.0})
    return Evidence(BODY, settings, observe, dict(zip(FRAMES, poses, strict=True)), 0.04)


def _way(poses: np.ndarray, *cameras: Camera) -> TrajectoryHypothesis:
    evidence = _evidence(poses, *cameras)
    found = estimate_whole(evidence, FRAMES, poses, sweeps=3)
    assert found is not None
    return TrajectoryHypothesis(found, evidence, "followed")


def _places(poses: np.ndarray) -> np.ndarray:
    return np.array([BODY.joint_positions(BODY.bones(pose)) for pose in poses])


def test_limbs_are_flipped_in_all_frames_alone_and_together():
    ways = trajectory_hypotheses(_way(_reaching(), FRONT), FRAMES, 6)
    best, *others = ways
    assert [way.cost for way in ways] == sorted(way.cost for way in ways)
    away = [_places(way.found.poses) - _places(best.found.poses) for way in others]
    deep = [np.abs(off @ FRONT.rotation[2]).max(axis=1) for off in away]
    assert any((frames > 0.1).all() for frames in deep)
    assert any(way.origin.count(" flipped") == 2 for way in ways)


def test_what_two_cameras_see_has_one_way():
    way = _way(_reaching(), FRONT, SIDE)
    assert trajectory_hypotheses(way, FRAMES, 6) == [way]


def test_joints_of_one_camera_count_as_often_as_their_errors_are_new():
    poses = _reaching()
    one, two = (
        replace(_evidence(poses, *cameras), new=0.2).of(0) for cameras in ((FRONT,), (FRONT, SIDE))
    )
    assert (one.share, two.share) == (0.2, 1.0)
    whole, seen = one.linearize(poses[0], [], 0, _evidence(poses, FRONT).shared.person)
    counted = whole.hessian[PLACE, PLACE].trace()
    assert counted == pytest.approx(0.2 * seen[PLACE, PLACE].trace(), rel=1e-6)


@pytest.mark.parametrize(("lasts", "least", "most"), [(0.0, 0.75, 1.0), (1.0, 0.05, 0.06)])
def test_errors_that_come_again_are_told_from_new_ones(rng, lasts, least, most):
    new, again = rng.normal(scale=5.0, size=(2, len(FRAMES), len(BODY.joint_names), 2))
    off_px, poses = (1.0 - lasts) * new + lasts * again[0], _reaching()
    assert least <= new_share(_evidence(poses, FRONT, off_px=off_px), FRAMES, poses) <= most
