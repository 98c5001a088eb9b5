"""Motions of a body stay within its limits and come back; a simulated body is a session that opens and is tracked."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.session.doctor.examine import examine
from handtrack.session.first_pose.first_pose import FirstPose
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from handtrack.simulation.body_motion import BODY_MOTIONS, BODY_POSES, body_motion, body_pose
from handtrack.simulation.simulate import Simulation, simulate
from handtrack.terms.collision import CollisionTerm

BODY = load_model("body34")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Somebody who stands and sways, seen by three small cameras."""
    what = Simulation(
        cameras=3, frames=30, size=(160, 120), motion="still", model="body34", scale=0.95, distance_m=3.5, images=False
    )  # fmt: skip
    return Session.open(simulate(tmp_path_factory.mktemp("body") / "new", what))


@pytest.mark.parametrize("name", BODY_POSES)
def test_poses_are_within_limits_and_hardly_collide(name):
    joint = body_pose(BODY, name)
    low, high = BODY.limits.interval.T
    assert ((joint >= low) & (joint <= high)).all()
    assert CollisionTerm.of(BODY).depths(BODY.bones(joint)).max() < 0.03


@pytest.mark.parametrize("name", BODY_MOTIONS)
def test_motions_pass_through_their_poses(name):
    joint = body_motion(BODY, name, 61, np.random.default_rng(0))
    low, high = BODY.limits.interval.T
    assert ((joint >= low) & (joint <= high)).all()
    poses = BODY_MOTIONS[name]
    for pose, frame in zip(poses, np.linspace(0, 60, len(poses)), strict=True):
        if frame == int(frame):
            expected = body_pose(BODY, pose)[6:]
            np.testing.assert_allclose(joint[int(frame), 6:], expected, atol=1e-12)
    again = body_motion(BODY, name, 61, np.random.default_rng(0))
    np.testing.assert_array_equal(joint, again)
    assert np.abs(joint[:, :3]).max() < 0.4


def test_unknown_names_are_said():
    with pytest.raises(HandtrackError, match="no motion of a body 'curl'; known: dance"):
        body_motion(BODY, "curl", 5, np.random.default_rng(0))
    with pytest.raises(HandtrackError, match="no pose of a body 'fist'; known: stand"):
        body_pose(BODY, "fist")


def test_a_simulated_body_is_tracked_from_its_parameters(session):
    run = TrackingRun.open(session)
    assert run.model.kind == "body"
    assert not run.forearm
    first, params = run.initial()
    results = list(run.track(range(5), first, params))
    truth = session.truth
    assert truth is not None
    assert truth.keypoints21 is None
    for result in results:
        off = np.linalg.norm(result.joint_positions - truth.joint_positions[result.frame], axis=1)
        assert np.median(off) < 0.02, result.frame
        assert result.keypoints21 is None
    saved = run.result(results)
    assert saved.model == "body34"


def test_the_doctor_has_nothing_against_a_body(session):
    bad = [f.text for f in examine(session) if f.severity in ("warning", "error")]
    assert bad == []


def test_what_is_only_for_hands_is_refused_in_words(session):
    keypoints = FirstPose(0, xyz=np.zeros((21, 3)))
    run = TrackingRun.open(session, first=None)
    with pytest.raises(
        HandtrackError, match="21 keypoints are a hand's, but the model is 'body34'"
    ):
        TrackingRun(session, keypoints, run.settings, run.scale, False, run.model).initial()
