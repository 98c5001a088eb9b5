"""Corrections of masks: strokes, what they make of a mask, and carried on to the frames beside, against known masks."""

import cv2
import numpy as np
import pytest

from handtrack.arrays import Array, Bytes
from handtrack.capture.masks.mask_correction import (
    BACKGROUND,
    HAND,
    carried,
    corrected,
    empty_layer,
    painted,
)
from handtrack.capture.masks.seeded import UNKNOWN_LEVEL
from handtrack.capture.masks.segmentation import SkinYCrCb, segmenter
from tests.capture.seeded_scenes import SIZE, recording


def overlap(mask: Bytes, truth: Array) -> float:
    """Return IoU where the mask says something."""
    known = mask != UNKNOWN_LEVEL
    both, either = (mask == 255) & truth & known, ((mask == 255) | truth) & known
    return float(both.sum() / either.sum())


@pytest.mark.parametrize(
    ("light", "least", "most"),
    [("shadows", 0.92, 0.84), ("wood", 0.88, 0.08)],
)
def test_a_carried_correction_helps_the_frames_beside(rng, light, least, most):
    """By skin colour, shaded fingers are missing, wood is hand, and against the light nothing is: over the five frames before
    and behind one that is corrected, masks overlap the hand by at most `most`; corrected likewise by at least `least`.
    """
    drawn = recording(light, rng, 11, of=120)
    segment = segmenter(SkinYCrCb(), drawn)
    here, truth = segment(drawn.images[5]), drawn.truth[5]
    wrong = cv2.morphologyEx(
        ((here > 127) != truth).astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3))
    )
    brushed = cv2.dilate(wrong, np.ones((7, 7))) > 0
    corrects = empty_layer(SIZE)
    corrects[brushed & truth], corrects[brushed & ~truth] = HAND, BACKGROUND
    before, after = [], []
    for way in (1, -1):
        layer = corrects
        for frame in range(5 + way, 5 + 6 * way, way):
            layer = carried(layer, drawn.images[frame - way], drawn.images[frame])
            own = segment(drawn.images[frame])
            better = corrected(layer, own, UNKNOWN_LEVEL)
            assert (better == UNKNOWN_LEVEL).mean() < 0.05
            before.append(overlap(own, drawn.truth[frame]))
            after.append(overlap(better, drawn.truth[frame]))
    assert np.mean(before) < most
    assert np.mean(after) > least


def test_what_cannot_be_followed_is_unknown(rng):
    grey = cv2.GaussianBlur(rng.normal(size=(120, 160)), (7, 7), 0)
    shade = np.clip(128 + 200 * grey, 0, 255).astype(np.uint8)
    scene = np.repeat(shade[..., None], 3, axis=2)
    layer = painted(empty_layer((160, 120)), np.array([[80.0, 60]]), 30.0, HAND)
    assert (carried(layer, scene, np.roll(scene, 3, axis=1)) == HAND).sum() > 2500
    gone = carried(layer, scene, np.full_like(scene, 30))
    assert (gone == UNKNOWN_LEVEL).sum() > 10 * (gone == HAND).sum()
