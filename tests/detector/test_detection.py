"""The detector beside its networks: palms, regions, and the hand that is followed."""

import numpy as np
import pytest

from handtrack.detector.hand_detector import (
    PALM_SIZE,
    DetectedHand,
    HandFollower,
    HandObservation,
    Region,
    epipolar_miss,
    log_odds,
    our_hands,
    palms,
    region_by_others,
    region_of_hand,
    region_of_palm,
)
from handtrack.geometry.rotation import rotation_matrix
from tests.cameras import pinhole
from tests.detector.fake_detector import FakeDetector, columns, hand_at
from tests.session.small_session import keypoints

ANCHORS = 2016
SURE = 3.0


def outputs(**boxes):
    """Return the network's numbers and logits: boxes as anchor → (logit, box's offset and size [px of the network])."""
    numbers, logits = np.zeros((ANCHORS, 18), np.float32), np.full(ANCHORS, -9.0, np.float32)
    for name, (logit, box) in boxes.items():
        anchor = int(name.removeprefix("at"))
        numbers[anchor, :4], logits[anchor] = box, logit
        numbers[anchor, 4:] = np.tile([0.0, 19.2], 7)
    return numbers, logits


def test_a_box_is_decoded():
    ((found, points),) = palms(*outputs(at0=(SURE, (19.2, 0.0, 38.4, 57.6))), most=2)
    assert found == pytest.approx(
        [0.5 / 24 + 0.1, 0.5 / 24, 0.2, 0.3]
    )  # the size has no anchor added
    assert points == pytest.approx(np.tile([0.5 / 24, 0.5 / 24 + 0.1], (7, 1)))


def test_overlapping_boxes_are_averaged_by_their_scores():
    box = (0.0, 0.0, 0.5 * PALM_SIZE, 0.5 * PALM_SIZE)
    ((found, _),) = palms(*outputs(at0=(1e-3, box), at2=(np.log(3.0), box)), most=2)
    weights = np.array([1 / (1 + np.exp(-1e-3)), 0.75])
    across = weights @ np.array([0.5, 1.5]) / 24 / weights.sum()
    assert found == pytest.approx([across, 0.5 / 24, 0.5, 0.5])


def test_boxes_apart_are_two_palms_the_surest_first():
    box = (0.0, 0.0, 19.2, 19.2)
    given = outputs(at0=(SURE, box), **{f"at{ANCHORS - 1}": (2 * SURE, box)})
    assert [found[0] for found, _ in palms(*given, most=2)] == pytest.approx([11.5 / 12, 0.5 / 24])
    assert len(palms(*given, most=1)) == 1


@pytest.mark.parametrize("turn", [0.0, 0.7, -2.5])
@pytest.mark.parametrize("spot", [(40, 30), (33, 52)])
def test_a_spot_of_the_crop_is_where_it_was_in_the_image(turn, spot):
    """To a tenth of a pixel: half a pixel is what creeps in."""
    image = np.zeros((90, 80, 3), np.uint8)
    image[spot[1], spot[0]] = 255
    region = Region(np.array([41.0, 40.0]), 50.0, turn)
    size = 100
    crop = region.crop(image, size)[..., 0]
    rows, columns = np.mgrid[:size, :size]
    seen = np.array([(columns * crop).sum(), (rows * crop).sum()]) / crop.sum()
    assert region.to_image((seen + 0.5) / size) == pytest.approx(np.array(spot, float), abs=0.1)


def test_a_palms_region_by_hand():
    """Wrist left, middle knuckle right: up in the crop is right in the image."""
    points = np.zeros((7, 2))
    points[0], points[2] = (10.0, 50.0), (30.0, 50.0)
    region = region_of_palm(np.array([20.0, 50.0, 16.0, 20.0]), points)
    assert region.turn == pytest.approx(np.pi / 2)
    assert region.centre == pytest.approx([30.0, 50.0])  # by half of the height towards the fingers
    assert region.side == pytest.approx(52.0)
    assert region.to_image(np.array([0.5, 0.0])) == pytest.approx([56.0, 50.0])


@pytest.mark.parametrize("angle", [0.3, 2.0, -1.2])
def test_a_hands_region_turns_with_it(angle):
    cos, sin = np.cos(angle), np.sin(angle)
    turning = np.array([[cos, -sin], [sin, cos]])
    straight = hand_at(100, 100).points
    before, after = region_of_hand(straight), region_of_hand((straight - 100) @ turning.T + 100)
    assert after.side == pytest.approx(before.side)
    assert after.centre == pytest.approx(turning @ (before.centre - 100) + 100)
    assert np.cos(after.turn - before.turn - angle) == pytest.approx(1.0)


IMAGE = np.zeros((200, 400, 3), np.uint8)


@pytest.fixture
def fake():
    return FakeDetector()


@pytest.fixture
def follower(fake):
    """It has found a hand."""
    fake.hands = [hand_at(100, 100)]
    found = HandFollower(fake)
    found.step(IMAGE)
    return found


def test_a_lost_hand_is_searched_in_the_same_image_and_gets_a_new_number(fake, follower):
    fake.hands = [hand_at(300, 100)]
    assert columns(follower.step(IMAGE)) == {1: 300}
    fake.hands = []
    assert follower.step(IMAGE) == {}
    assert fake.searches == 3


def test_a_second_hand_is_found_soon_and_both_keep_their_numbers(fake, follower):
    seen = []
    for x in range(100, 160, 5):
        fake.hands = [hand_at(300, 100), hand_at(x, 100)]
        seen.append(columns(follower.step(IMAGE)))
    assert seen[0] == {0: 100}
    assert seen[-1] == {0: 155, 1: 300}
    assert fake.searches == 2  # with both followed there is nothing to look for


LEFT_PLACE, RIGHT_PLACE = np.array([-0.15, 0.05, 0.0]), np.array([0.12, -0.06, 0.05])


def camera(name, angle):
    """A distorted camera 0.8 m away, turned about the vertical."""
    rotation = rotation_matrix(np.array([0.0, angle, 0.0]))
    return pinhole(name, (640, 480), 600, rotation, (0, 0, 0.8), (-0.1, 0.02, 0, 0, 0))


CAMERAS = {name: camera(name, angle) for name, angle in (("a", 0.0), ("b", 0.6), ("c", -0.5))}


def seen(name, place, right=0.99, noise=1.0):
    rng = np.random.default_rng(5)
    points = keypoints() + [[0, 0, 0.002 * i] for i in range(21)]
    pixels = CAMERAS[name].project(points + place) + noise * rng.normal(size=(21, 2))
    return HandObservation(
        CAMERAS[name], DetectedHand(pixels, 0.9, right), log_odds(right, "right")
    )


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
    ours = our_hands(hands)
    assert ours["a"] is hands["a"][0] and ours["b"] is hands["b"][1]


def test_a_camera_that_overlooks_a_hand_is_told_where_others_see_it():
    others = [seen("a", RIGHT_PLACE, noise=0.0), seen("b", RIGHT_PLACE, noise=0.0)]
    expected, told = (
        seen("c", RIGHT_PLACE, noise=0.0).hand.region, region_by_others(CAMERAS["c"], others)
    )  # fmt: skip
    assert told.centre == pytest.approx(expected.centre, abs=0.01)
    assert (told.side, told.turn) == pytest.approx((expected.side, expected.turn), abs=1e-3)
    assert region_by_others(CAMERAS["c"], others[:1]) is None
    beside = pinhole("c", (640, 480), 600, np.eye(3), (-0.6, 0, 0.8))
    assert region_by_others(beside, others) is None
