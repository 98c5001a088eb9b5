"""First poses: init.json, joints in images, and what the program finds by itself."""

from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import HandScale, Session, TrackerSettings, TrackingRun
from handtrack.detector.hand_detector import DetectedHand
from handtrack.session import detection, first_pose_search
from handtrack.session.first_pose import FirstPose, read_first_pose, write_first_pose
from handtrack.session.first_pose_search import find_first_poses
from handtrack.session.run import poses_of_image_joints
from handtrack.simulation.simulate import Simulation, simulate
from handtrack.tracking.frame.result import Status
from handtrack.tracking.search.engine import Candidate
from tests.detector.fake_detector import FakeDetector
from tests.session.small_session import add_joints, edit, keypoints, make_session, write_init


def test_keypoints_with_unknown_rows(tmp_path):
    known = keypoints()[2:].tolist()
    write_init(tmp_path, frame=18, xyz=[None, [None, None, None], *known])
    pose = read_first_pose(tmp_path / "init.json")
    assert pose.frame == 18
    assert pose.parameters == {}
    assert np.isnan(pose.xyz[:2]).all()
    assert_array_equal(pose.xyz[2:], keypoints()[2:])


def test_what_is_written_reads_back(tmp_path):
    pose = FirstPose(2, {"root_tx": 0.1}, scale=HandScale(0.8, {"thumb": 1.05}))
    write_first_pose(tmp_path / "i.json", pose)
    again = read_first_pose(tmp_path / "i.json")
    assert (again.frame, again.parameters, again.scale) == (2, pose.parameters, pose.scale)


def points(session, frame):
    row = int(np.flatnonzero(session.truth.frame == frame)[0])
    return session.truth.keypoints21[row]


def error_mm(candidate, truth):
    found = candidate.model.keypoints21(candidate.model.bones(candidate.params))
    return 1e3 * np.linalg.norm(found - truth, axis=1).mean()


def test_a_childs_hand_is_found_as_a_childs(tmp_path):
    what = Simulation(
        cameras=2, frames=1, size=(160, 120), scale=0.77, motion="still", images=False
    )
    folder = simulate(tmp_path / "child", what)
    edit(folder / "session.toml", "scale = 0.77", 'scale = "fit"')
    session, shares = Session.open(folder), []
    run = TrackingRun.open(session, use_init=False)
    best, *_ = find_first_poses(run, 0, on_progress=lambda share, _: shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert "times the usual size" in best.note
    assert best.confidence > 0.7
    assert best.model.scale.overall == pytest.approx(0.77, rel=0.01)
    assert error_mm(best, points(session, 0)) < 2.0
    assert_allclose(best.points, best.model.keypoints21(best.model.bones(best.params)))


def test_joints_in_one_image_are_settled_by_the_silhouettes(session):
    truth = points(session, 30)
    first = FirstPose(30, pixels={"cam0": session.rig["cam0"].project(truth)})
    found = poses_of_image_joints(session, TrackerSettings(), first)
    assert error_mm(found[0], truth) < 6.0
    assert found[0].confidence > 0.5
    assert "one camera" in found[0].note


def test_joints_on_which_two_cameras_agree_are_a_first_pose(tmp_path, monkeypatch):
    """Frame 0 has them in one camera only; by the session's masks nothing would be found."""
    folder = make_session(tmp_path)
    rig = Session.open(folder).rig
    pixels = {camera.name: camera.project(keypoints()) for camera in rig}
    add_joints(folder, {"cam0": dict.fromkeys((0, 2), pixels["cam0"]), "cam1": {2: pixels["cam1"]}})
    searched = []
    monkeypatch.setattr(
        first_pose_search, "auto_start", lambda *given: searched.append(given) or []
    )
    run = TrackingRun.open(Session.open(folder), use_init=False)
    (best,) = find_first_poses(run)
    assert searched == []  # the frames with joints in two images come first
    assert best.frame == 2
    assert_allclose(best.points, keypoints(), atol=1e-5)
    assert find_first_poses(run, 0) == []
    assert find_first_poses(run.with_values({"keypoints.weight": 0.0})) == []
    (best,) = find_first_poses(run.with_values({"silhouettes.weight": 0.0}), 0)  # no masks
    posed = best.model.keypoints21(best.model.bones(best.params))
    assert np.median(np.abs(rig["cam0"].project(posed) - pixels["cam0"])) < 1.0


class SeesTheTruth(FakeDetector):
    """Sees the true joints of the camera whose image it is handed."""

    def __init__(self, session, frame):
        super().__init__()
        truth = points(session, frame)
        self._images = [
            (view.image(frame), DetectedHand(view.camera.project(truth), 0.9, 0.99))
            for view in session.views
        ]

    def find(self, image, most, closely=False):
        self.hands = [hand for own, hand in self._images if np.array_equal(own, image)]
        return super().find(image, most)


def test_a_hand_is_found_where_the_detector_sees_it(session, monkeypatch):
    frame = 60  # half closed; searching silhouettes for it takes a minute
    monkeypatch.setattr(detection, "usable_detector", lambda _: SeesTheTruth(session, frame))
    run = TrackingRun.open(session, use_init=False)
    monkeypatch.setattr("handtrack.session.first_pose_search.auto_start", None)  # not asked
    (best,) = find_first_poses(run, frame)
    assert error_mm(best, points(session, frame)) < 8.0


def test_a_pose_that_hardly_says_where_the_joints_are_ends_no_search(session, monkeypatch):
    """Nothing else fits frame 0, where a camera sees no more than an arm; a later frame shows the hand."""
    looked = []

    def found_in(models, settings, seen, *_):
        looked.append(seen.frame)
        confidence, near = (0.003, 0.003) if seen.frame == 0 else (0.9, 0.95)
        solved = SimpleNamespace(result=SimpleNamespace(status=Status.TRACKED))
        params = models[0].rest_params()
        return [Candidate(models[0], params, solved=solved, confidence=confidence, p_in_basin=near)]

    monkeypatch.setattr(first_pose_search, "auto_start", found_in)
    best, *_ = find_first_poses(TrackingRun.open(session, use_init=False))
    assert looked[0] == 0
    assert len(looked) == 2
    assert best.frame == looked[1]
