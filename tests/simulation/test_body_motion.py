"""Motions of a body stay within its limits and come back; a simulated body is a session that opens and is tracked."""

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose, pose_names
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
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


@pytest.mark.parametrize("name", pose_names("body"))
def test_poses_are_within_limits_and_hardly_collide(name):
    joint = named_pose(BODY, name)
    low, high = BODY.limits.interval.T
    assert ((joint >= low) & (joint <= high)).all()
    assert CollisionTerm.of(BODY).depths(BODY.bones(joint)).max() < 0.03


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
