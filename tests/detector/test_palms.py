"""The palm network's anchors, and palms out of overlapping boxes: by numbers that can be followed by hand."""

import numpy as np
import pytest

from handtrack.detector.hand_detector import PALM_SIZE, palms

ANCHORS = 2016
SURE, UNSURE = 3.0, -0.01


def outputs(**boxes):
    """Return the network's numbers and logits: boxes as anchor → (logit, box's offset and size [px of the network])."""
    numbers, logits = np.zeros((ANCHORS, 18), np.float32), np.full(ANCHORS, -9.0, np.float32)
    for name, (logit, box) in boxes.items():
        anchor = int(name.removeprefix("at"))
        numbers[anchor, :4], logits[anchor] = box, logit
        numbers[anchor, 4:] = np.tile([0.0, 19.2], 7)
    return numbers, logits


def test_a_box_is_decoded():
    (palm,) = palms(*outputs(at0=(SURE, (19.2, 0.0, 38.4, 57.6))), most=2)
    assert palm.score == pytest.approx(1 / (1 + np.exp(-SURE)))
    assert palm.box == pytest.approx(
        [0.5 / 24 + 0.1, 0.5 / 24, 0.2, 0.3]
    )  # the size has no anchor added
    assert palm.points == pytest.approx(np.tile([0.5 / 24, 0.5 / 24 + 0.1], (7, 1)))


def test_overlapping_boxes_are_averaged_by_their_scores():
    size = 0.5 * PALM_SIZE
    given = outputs(
        at0=(0.0 + 1e-3, (0.0, 0.0, size, size)), at2=(np.log(3.0), (0.0, 0.0, size, size))
    )
    (palm,) = palms(*given, most=2)
    weights = np.array([1 / (1 + np.exp(-1e-3)), 0.75])
    across = weights @ np.array([0.5, 1.5]) / 24 / weights.sum()
    assert palm.box == pytest.approx([across, 0.5 / 24, 0.5, 0.5])
    assert palm.score == pytest.approx(0.75)  # the best one's


def test_boxes_apart_are_two_palms_the_surest_first():
    box = (0.0, 0.0, 19.2, 19.2)
    given = outputs(at0=(SURE, box), **{f"at{ANCHORS - 1}": (2 * SURE, box)})
    assert [palm.box[0] for palm in palms(*given, most=2)] == pytest.approx([11.5 / 12, 0.5 / 24])
    assert len(palms(*given, most=1)) == 1
