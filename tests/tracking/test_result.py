"""Frames stacked into a sequence, and taken out again."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from handtrack.tracking.frame.result import FrameResult, Status
from tests.sample_track import sample_frame, sample_track, stacked


def test_shapes_are_those_of_the_contract(rng):
    track = sample_track(rng, range(3, 8))
    assert track.frame.tolist() == [3, 4, 5, 6, 7]
    assert track.parameters.shape == track.parameter_std.shape == (5, 7)
    assert track.T_world_bone.shape == (5, 2, 4, 4)
    assert track.joint_positions.shape == (5, 21, 3)
    assert track.joint_covariance.shape == (5, 21, 3, 3)
    assert track.keypoints21 is not None
    assert track.keypoints21.shape == (5, 21, 3)
    assert track.status.dtype == np.int64
    assert len(track) == 5


def test_frames_come_back_as_they_were(rng):
    given = [sample_frame(rng, 4), sample_frame(rng, 6, Status.LOST)]
    for one, back in zip(given, stacked(given).frames(), strict=True):
        for field in fields(FrameResult):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(back, field.name))
    assert stacked(given).at(6).status is Status.LOST


def test_a_part_keeps_frame_numbers_and_provenance(rng):
    part = sample_track(rng, range(10, 20)).between(range(12, 15))
    assert part.frame.tolist() == [12, 13, 14]
    assert part.session == "invented"
    assert part.keypoints21 is not None
    assert len(part.keypoints21) == 3
