"""Mask methods: known answers on drawn images, settings read and refused."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from handtrack.capture.masks.segmentation import (
    BackgroundMedian,
    BackgroundMog2,
    DepthRange,
    SkinAdaptive,
    SkinYCrCb,
    segmenter,
)
from tests.capture.seeded_scenes import Recording

SKIN = (110, 140, 200)  # BGR
DESK = (120, 110, 100)


def frames(*images):
    return Recording(list(images), [], [], [], size=(80, 60))


def scene(rng, *boxes):
    """A desk with skin-coloured boxes x, y, w, h and a little noise."""
    image = np.full((60, 80, 3), DESK, np.int16)
    for x, y, w, h in boxes:
        image[y : y + h, x : x + w] = SKIN
    return (image + rng.integers(-2, 3, image.shape)).clip(0, 255).astype(np.uint8)


def box_mask(x, y, w, h):
    mask = np.zeros((60, 80), np.uint8)
    mask[y : y + h, x : x + w] = 255
    return mask


HAND = (20, 15, 30, 25)


def test_skin_ycrcb_keeps_the_closed_box_of_colours():
    ycrcb = np.array(
        [[[40, 138, 85], [39, 138, 85], [40, 175, 125], [40, 176, 125], [255, 150, 84]]]
    )
    image = cv2.cvtColor(ycrcb.astype(np.uint8), cv2.COLOR_YCrCb2BGR)
    back = cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)
    method = SkinYCrCb(open_px=0, largest=False)
    mask = segmenter(method, frames())(image)
    y, cr, cb = np.moveaxis(back.astype(int), -1, 0)
    expected = (y >= 40) & (cr >= 138) & (cr <= 175) & (cb >= 85) & (cb <= 125)
    assert_array_equal(mask > 0, expected)
    assert set(np.unique(mask)) <= {0, 255}


def test_the_region_of_interest_comes_before_the_largest_piece(rng):
    other = (60, 5, 8, 8)
    segment = segmenter(SkinYCrCb(open_px=0), frames(), roi=(55, 0, 25, 60))
    assert_array_equal(segment(scene(rng, HAND, other)), box_mask(*other))


def test_skin_adaptive_fits_its_sample(rng):
    sample = frames(None, scene(rng, (60, 40, 20, 20)))
    method = SkinAdaptive(sample=(70, 50, 10, 10), size=4.0, reference=1)
    bright = (scene(rng, HAND) * 0.8).astype(np.uint8)  # chromaticity does not mind the brightness
    mask = segmenter(method, sample)(bright)
    assert np.mean(mask != box_mask(*HAND)) < 0.005


@pytest.mark.parametrize("method", [BackgroundMedian(samples=9), BackgroundMog2(samples=20)])
def test_background_methods_find_what_moves(method, rng):
    images = [
        scene(rng, (4 * i % 50, 5 * i % 35, 20, 20)) if i % 7 else scene(rng) for i in range(60)
    ]
    images[3] = None
    segment = segmenter(method, frames(*images))
    box = (4 * 26 % 50, 5 * 26 % 35, 20, 20)
    image = scene(rng, box)
    first = segment(image)
    assert np.mean(first != box_mask(*box)) < 0.02
    for other in images[:20]:
        if other is not None:
            segment(other)
    assert_array_equal(segment(image), first)  # no memory of what was asked before


def test_depth_range_is_in_metres_and_ignores_zero():
    depth = np.array([[0, 2999, 3000, 6000, 6001]], np.uint16)
    segment = segmenter(DepthRange(near_m=0.3, far_m=0.6), frames(), unit_m=0.0001)
    assert_array_equal(segment(depth), [[0, 0, 255, 255, 0]])
