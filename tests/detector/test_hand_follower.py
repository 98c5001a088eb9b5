"""Hands are followed from frame to frame, and keep their numbers."""

import numpy as np
import pytest

from handtrack.detector.hand_follower import HandFollower
from tests.detector.fake_detector import FakeDetector, columns, hand_at

IMAGE = np.zeros((200, 400, 3), np.uint8)


@pytest.fixture
def fake() -> FakeDetector:
    return FakeDetector()


def test_a_hand_is_followed_without_searching_again(fake):
    follower = HandFollower(fake)
    for step in range(6):
        fake.hands = [hand_at(100 + 5 * step, 100)]
        assert columns(follower.step(IMAGE)) == {0: 100 + 5 * step}
    assert fake.searches == 1


def test_a_lost_hand_is_searched_in_the_same_image_and_gets_a_new_number(fake):
    follower = HandFollower(fake)
    fake.hands = [hand_at(100, 100)]
    follower.step(IMAGE)
    fake.hands = [hand_at(300, 100)]
    assert columns(follower.step(IMAGE)) == {1: 300}
    fake.hands = []
    assert follower.step(IMAGE) == {}
    assert fake.searches == 3


def test_a_second_hand_is_found_soon_and_both_keep_their_numbers(fake):
    follower = HandFollower(fake)
    fake.hands = [hand_at(100, 100)]
    follower.step(IMAGE)
    fake.hands = [hand_at(300, 100), hand_at(100, 100)]
    seen = [columns(follower.step(IMAGE)) for _ in range(12)]
    assert seen[0] == {0: 100}
    assert seen[-1] == {0: 100, 1: 300}
    assert fake.searches == 2  # with both followed there is nothing to look for
