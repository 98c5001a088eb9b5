"""A hand found by what a detector sees in the images of a session that has no joints."""

import numpy as np
import pytest

from handtrack.detector.hand_detector import DetectedHand
from handtrack.session import detection
from handtrack.session.bundled import bundled_session
from handtrack.session.first_pose.first_pose_search import find_first_poses
from handtrack.session.run import TrackingRun
from handtrack.session.session import Session
from tests.detector.fake_detector import FakeDetector


class SeesTheTruth(FakeDetector):
    """Sees the true joints of the camera whose image it is handed."""

    def __init__(self, session: Session, frame: int) -> None:
        super().__init__()
        row = int(np.flatnonzero(session.truth.frame == frame)[0])
        truth = session.truth.keypoints21[row]
        self._images = [
            (view.image(frame), DetectedHand(view.camera.project(truth), 0.9, 0.99))
            for view in session.views
        ]

    def find(self, image, most):
        self.hands = [hand for own, hand in self._images if np.array_equal(own, image)]
        return super().find(image, most)


@pytest.fixture(scope="module")
def session() -> Session:
    return Session.open(bundled_session("open_fist_open"))


def test_a_hand_is_found_where_the_detector_sees_it(session, monkeypatch):
    frame = 60  # half closed; searching silhouettes for it takes a minute
    monkeypatch.setattr(detection, "usable_detector", lambda _: SeesTheTruth(session, frame))
    run = TrackingRun.open(session, use_init=False)
    monkeypatch.setattr(
        "handtrack.session.first_pose.first_pose_search.auto_start", None
    )  # not asked
    (best,) = find_first_poses(run, frame)
    row = int(np.flatnonzero(session.truth.frame == frame)[0])
    found = best.model.keypoints21(best.model.bones(best.params))
    assert 1e3 * np.linalg.norm(found - session.truth.keypoints21[row], axis=1).mean() < 8.0
