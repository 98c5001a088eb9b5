"""Which hand is ours: by its side, and by lying where other cameras see it."""

import numpy as np
import pytest

from handtrack.detector.hand_detector import DetectedHand
from handtrack.detector.identity import SeenHand, epipolar_miss, log_odds, our_hands
from handtrack.geometry.camera import Camera
from tests.session.small_session import keypoints

LEFT_PLACE, RIGHT_PLACE = np.array([-0.15, 0.05, 0.0]), np.array([0.12, -0.06, 0.05])


def camera(name: str, angle: float) -> Camera:
    """A distorted camera 0.8 m away, turned about the vertical."""
    cos, sin = np.cos(angle), np.sin(angle)
    rotation = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    matrix = np.array([[600.0, 0, 319.5], [0, 600.0, 239.5], [0, 0, 1]])
    return Camera(
        name, (640, 480), matrix, np.array([-0.1, 0.02, 0, 0, 0]), rotation, np.array([0, 0, 0.8])
    )


CAMERAS = {name: camera(name, angle) for name, angle in (("a", 0.0), ("b", 0.6), ("c", -0.5))}


def seen(name: str, place: np.ndarray, right: float = 0.99, noise: float = 1.0) -> SeenHand:
    rng = np.random.default_rng(5)
    points = keypoints() * [1, 1, 1] + [[0, 0, 0.002 * i] for i in range(21)]
    pixels = CAMERAS[name].project(points + place) + noise * rng.normal(size=(21, 2))
    return SeenHand(CAMERAS[name], DetectedHand(pixels, 0.9, right), log_odds(right, "right"))


def chosen(hands: dict[str, list[SeenHand]]) -> dict[str, int]:
    return {n: hands[n].index(one) for n, one in our_hands(hands).items()}


def test_one_hand_lies_on_its_epipolar_lines_another_does_not():
    a, b = seen("a", RIGHT_PLACE, noise=0.0), seen("b", RIGHT_PLACE, noise=0.0)
    assert epipolar_miss(a, b) == pytest.approx(0.0, abs=1e-4)
    assert epipolar_miss(a, b) == pytest.approx(epipolar_miss(b, a))
    assert epipolar_miss(a, seen("b", LEFT_PLACE)) > 0.2


def test_of_two_hands_the_one_of_our_side_is_ours_in_every_view():
    hands = {
        "a": [seen("a", RIGHT_PLACE), seen("a", LEFT_PLACE, right=0.02)],
        "b": [seen("b", LEFT_PLACE, right=0.02), seen("b", RIGHT_PLACE)],
    }
    assert chosen(hands) == {"a": 0, "b": 1}


def test_a_hand_of_the_other_side_is_not_ours():
    assert chosen({"a": [seen("a", RIGHT_PLACE, right=0.1)], "b": []}) == {}
    assert chosen({"a": [seen("a", RIGHT_PLACE)]}) == {"a": 0}
