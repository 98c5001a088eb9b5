"""A session whose cameras have a detector's joints: where it sees them is found before tracking."""

import numpy as np
import pytest

from handtrack import HandScale, Session, TrackingRun, load_model, read_npz, write_npz
from handtrack.model.articulated import keypoint_names
from handtrack.session.session_file import HandSettings
from handtrack.session.track_session import Refining
from handtrack.simulation.motion import motion
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.control import Control
from handtrack.tracking.whole.refinement import Refinement
from tests.session.small_session import add_seen, joints_session, write_init

OFFSETS = {
    "thumb_mcp": (4.0, 8.0, -4.0), "index_mcp": (0.0, -9.0, 6.0), "little_pip": (0.0, 8.0, 0.0)
}  # fmt: skip
JOINTS_ALONE = {"keypoints.sigma_px": 1.0, "silhouettes.weight": 0}
FILMED = HandScale(1.0, {}, {}, OFFSETS)
FRAMES = 16


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A simulated hand of a given size, and what a detector with offsets sees of it in two cameras."""
    rig = simulated_rig(2, (320, 240))
    made = joints_session(tmp_path_factory.mktemp("joints"), rig, HandSettings(scale=1.0))
    add_seen(made, seen_points(load_model(scale=FILMED)), 0.5)
    write_init(made, xyz=seen_points(load_model())[0].tolist())
    return made


def seen_points(hand):
    """Return where a detector sees the joints (F, 21, 3), world [m]."""
    rows = [hand.joint_names.index(name) for name in keypoint_names()]
    poses = motion(hand, "open_fist_open", FRAMES, np.random.default_rng(3))
    bones = [hand.bones(hand.transform.solver_params(pose)) for pose in poses]
    return np.array([b.to_world(hand.joint_bone, hand.observed_point)[rows] for b in bones])


def check_offsets(scale):
    for joint, true in OFFSETS.items():
        missed_mm = np.linalg.norm(np.subtract(scale.offsets_mm[joint], true))
        assert missed_mm < 0.6 * np.linalg.norm(true), joint


@pytest.fixture(scope="module")
def run(folder):
    """What opens the session: it fits the offsets."""
    return TrackingRun.open(Session.open(folder), JOINTS_ALONE)


def test_offsets_are_found_though_the_size_is_given(run):
    assert (run.scale.overall, set(run.scale.parts.values()) | {1.0}) == (1.0, {1.0})
    check_offsets(run.scale)
    assert set(run.scale.offsets_mm) == set(keypoint_names())


def test_offsets_are_found_again_with_all_frames(folder):
    """The pass that refines the recording finds them itself, where nothing was fitted before; not those of a saved hand."""
    told = Refining()
    run = TrackingRun.open(Session.open(folder), JOINTS_ALONE | {"model.fit_size": "later"})
    list(run.track(range(FRAMES), *run.initial(), Control(observer=told)))
    found = Refinement.read(told.refinement).scale
    check_offsets(found)
    assert found.overall == run.scale.overall, "the size was given"


def test_results_have_landmarks_where_the_detector_sees_the_joints(run, tmp_path):
    """They lie nearer to what was filmed of the detector's points than the joint centres, of which two are 9 mm off."""
    frame, start = run.initial()
    found = run.result(run.track(range(4), frame, start))
    write_npz(tmp_path / "poses.npz", found)
    with np.load(tmp_path / "poses.npz") as file:
        landmarks, joints = file["landmarks"], file["keypoints21"]
        assert str(file["landmark_definition"]) == "mediapipe21"
        assert file["landmark_covariance"].shape == (4, 21, 3, 3)
    true = seen_points(load_model(scale=FILMED))[:4]
    moved = [keypoint_names().index(name) for name in OFFSETS]
    off = 1e3 * np.linalg.norm(np.stack([landmarks, joints]) - true, axis=3)[:, :, moved]
    assert off[0].mean() < 0.5 * off[1].mean()
    again = read_npz(tmp_path / "poses.npz").in_landmarks("mediapipe21")
    np.testing.assert_allclose(again.keypoints21, landmarks, atol=1e-12)
    np.testing.assert_allclose(again.in_landmarks("joints").keypoints21, joints, atol=1e-9)
