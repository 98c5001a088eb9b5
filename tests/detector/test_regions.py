"""Squares of an image: what a crop shows lies where its points are said to lie."""

import numpy as np
import pytest

from handtrack.detector.hand_detector import (
    Region,
    region_of_hand,
    region_of_palm,
)


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


def hand_pointing(direction):
    """Return 21 points: fingers of 40 px beside one another, from a wrist at (100, 100)."""
    up = np.array(direction, float)
    right = np.array([-up[1], up[0]])
    points = [np.zeros(2)]
    for finger in range(5):
        points += [right * 10 * (finger - 2) + up * (20 + 10 * k) for k in range(4)]
    return np.array(points) + 100.0


@pytest.mark.parametrize("angle", [0.3, 2.0, -1.2])
def test_a_hands_region_turns_with_it(angle):
    cos, sin = np.cos(angle), np.sin(angle)
    turning = np.array([[cos, -sin], [sin, cos]])
    straight = hand_pointing((0, -1))
    before, after = region_of_hand(straight), region_of_hand((straight - 100) @ turning.T + 100)
    assert after.side == pytest.approx(before.side)
    assert after.centre == pytest.approx(turning @ (before.centre - 100) + 100)
    assert np.cos(after.turn - before.turn - angle) == pytest.approx(1.0)
