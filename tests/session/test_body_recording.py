"""A person's recording by joints alone: first pose, size and where the detector sees joints."""

import numpy as np
import pytest

from handtrack import HandScale, Session, TrackingRun
from handtrack.session.first_pose import FirstPose
from handtrack.session.first_pose_search import (
    SURE,
    find_first_poses,
)
from handtrack.session.session_file import HandSettings
from tests.session.body_session import OFFSETS, film


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Three cameras; the size is to be fitted."""
    return Session.open(film(tmp_path_factory.mktemp("body") / "session"))


@pytest.fixture(scope="module")
def found(session):
    return find_first_poses(TrackingRun.open(session, use_init=False))


@pytest.fixture(scope="module")
def sized(session, found):
    """The run once first pose and size are found."""
    return TrackingRun.open(session, first=FirstPose.of(found[0]))


def error_m(session, found, shape=False):
    """Return how far a candidate's joints are from the true ones on average; shape: about their middle."""
    joints = found.model.joint_positions(found.model.bones(found.params))
    true = session.truth.joint_positions[found.frame]
    if shape:
        joints, true = joints - joints.mean(axis=0), true - true.mean(axis=0)
    return float(np.linalg.norm(joints - true, axis=1).mean())


def test_cameras_that_agree_give_a_bodys_first_pose(session, found):
    (best,) = found
    assert best.confidence == 1.0
    assert best.points is None
    assert error_m(session, best) < 0.04, "of a body of the mean size, by a detector's joints"


def test_one_camera_leaves_a_bodys_pose_open_and_says_so(tmp_path):
    mean = HandSettings("body34")
    folder = film(tmp_path / "session", 1, 1, HandScale(), mean, motion="still")
    alone = Session.open(folder)
    found = find_first_poses(TrackingRun.open(alone, use_init=False))
    sure = [one.confidence for one in found]
    assert sure == sorted(sure, reverse=True)
    assert sum(sure) <= 1.0 + 1e-9
    assert found[0].note == "joints seen by one camera"
    near = sum(one.confidence for one in found if error_m(alone, one, shape=True) < 0.11)
    assert near > 0.3, "what is right is among what is likely"
    assert sure[0] < SURE, "a person who stands may bend to the camera or away from it"


def test_size_and_offsets_are_found_over_the_recording(sized):
    scale = sized.scale
    assert scale.overall * np.mean(list(scale.parts.values())) == pytest.approx(1.05, abs=0.03)
    assert 0.005 < scale.std["overall"] < 0.06
    # a second of one movement counts as two postures, so that half a second's noise is not taken for the person
    for joint, true in OFFSETS.items():
        missed = np.linalg.norm(np.subtract(scale.offsets_mm[joint], true))
        assert missed < 0.9 * np.linalg.norm(true), joint
