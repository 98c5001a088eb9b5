"""The networks themselves, where the shared data with their weights are: a few frames of two real recordings."""

from importlib.util import find_spec

import cv2
import numpy as np
import pytest

from handtrack import Session
from handtrack.detector.hand_detector import (
    HandDetector,
    HandFollower,
    HandObservation,
    epipolar_miss,
    log_odds,
)
from handtrack.session.detection import joints_of_frame

FIRST = 18  # of desk_two_view: both cameras see the hand, and init.json is about it
FRAMES = range(FIRST, FIRST + 3)


@pytest.fixture(scope="session")
def weights(data_dir):
    return data_dir / "hand_detector" / "hand_landmarker.task"


@pytest.fixture(scope="session")
def detector(weights):
    return HandDetector.open(weights, "opencv")


@pytest.fixture(scope="session")
def desk(data_dir):
    return Session.open(data_dir / "sessions" / "desk_two_view")


def test_the_hand_over_the_desk_is_found_in_both_views_where_it_is(detector, desk):
    """Near the first pose's joints, which another program's detector gave; a right hand; on its epipolar lines."""
    followers = {view.name: HandFollower(detector) for view in desk.views}
    for frame in FRAMES:
        seen = {}
        for view in desk.views:
            (hand,) = followers[view.name].step(view.image(frame)).values()
            assert hand.presence > 0.95
            assert hand.right > 0.95
            seen[view.name] = HandObservation(view.camera, hand, log_odds(hand.right, "right"))
            if frame == FIRST:
                true = view.camera.project(desk.init.xyz)
                away = np.linalg.norm(hand.points - true, axis=1)
                assert (
                    np.nanmedian(away) < 4.0
                )  # px; the middle of MediaPipe's own pipeline is 1.85 off
                assert np.nanmax(away) < 15.0
        assert epipolar_miss(seen["cam0"], seen["cam1"]) < 0.03


def test_a_mirrored_hand_is_one_of_the_other_side(detector, desk):
    image = cv2.flip(desk.views[1].image(FIRST), 1)
    (hand,) = HandFollower(detector).step(image).values()
    assert hand.right < 0.1


def test_a_hand_of_a_twentieth_of_the_images_width_is_found(detector, desk):
    image, (x, y, shrunk) = np.full((960, 1280, 3), 128, np.uint8), (800, 150, 270)
    found = HandFollower(detector).step(desk.views[1].image(FIRST))[0].points * shrunk / 720
    image[y : y + shrunk, x : x + shrunk] = cv2.resize(
        desk.views[1].image(FIRST), (shrunk, shrunk), interpolation=cv2.INTER_AREA
    )
    assert detector.find(image, 2) == []
    (hand,) = HandFollower(detector).step(image).values()
    off = np.linalg.norm(hand.points - found - [x, y], axis=1)
    assert np.ptp(found[:, 0]) < 0.05 * 1280 and np.median(off) < 3.0  # px


def test_two_hands_in_one_image_are_found_and_told_apart(detector, desk):
    image = desk.views[0].image(FIRST)
    both = np.hstack([image, cv2.flip(image, 1)])
    follower = HandFollower(detector)
    found = follower.step(both)
    assert found.keys() == follower.step(both).keys() == {0, 1}
    left, right = sorted(found.values(), key=lambda hand: hand.points[0, 0])
    assert left.right > 0.9 > 0.1 > right.right
    mirrored = both.shape[1] - 1 - right.points[:, 0]
    assert np.median(np.abs(mirrored - left.points[:, 0])) < 5.0


@pytest.mark.skipif(find_spec("ai_edge_litert") is None, reason="LiteRT is not installed")
def test_litert_says_the_same(weights, detector, desk):
    image = desk.views[0].image(FIRST)
    ours, theirs = (
        next(iter(HandFollower(one).step(image).values()))
        for one in (detector, HandDetector.open(weights, "litert"))
    )
    assert theirs.points == pytest.approx(ours.points, abs=0.02)
    assert theirs.presence == pytest.approx(ours.presence, abs=1e-4)


def test_a_hand_whose_palm_is_overlooked_is_found_where_two_other_cameras_see_it(
    detector, data_dir
):
    session = Session.open(data_dir / "sessions" / "marked_real_5cam")
    frame = 8  # the hand is slow: this camera is half a frame late
    joints = joints_of_frame(session, frame, detector, 5.0)
    assert detector.find(session.view("cam6").image(frame), 2) == []
    (found,) = (one for one in joints if one.camera.name == "cam6")
    off = np.linalg.norm(
        found.pixels - found.camera.project(session.truth.keypoints21[frame]), axis=1
    )
    assert np.nanmedian(off) < 8.0  # px
