"""Frames stacked into a sequence, and taken out again."""

from dataclasses import fields

import numpy as np

from handtrack.tracking.frame.result import FrameResult, Status
from tests.sample_track import sample_frame, stacked


def test_frames_come_back_as_they_were(rng):
    given = [sample_frame(rng, 4), sample_frame(rng, 6, Status.LOST)]
    for one, back in zip(given, stacked(given).frames(), strict=True):
        for field in fields(FrameResult):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(back, field.name))
    assert stacked(given).at(6).status is Status.LOST
