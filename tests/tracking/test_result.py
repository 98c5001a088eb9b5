"""Frames stacked into a sequence, and taken out again."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest

from handtrack.errors import HandtrackError
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


def test_a_frame_taken_out_is_a_copy(rng):
    track = sample_track(rng)
    before = track.parameters.copy()
    track.at(0).parameters[:] = 0
    np.testing.assert_array_equal(track.parameters, before)


def test_a_part_keeps_frame_numbers_and_provenance(rng):
    part = sample_track(rng, range(10, 20)).between(range(12, 15))
    assert part.frame.tolist() == [12, 13, 14]
    assert part.session == "invented"
    assert part.keypoints21 is not None
    assert len(part.keypoints21) == 3


def test_frames_that_are_not_there_are_the_users_error(rng):
    track = sample_track(rng, [2, 3, 5])
    with pytest.raises(HandtrackError) as error:
        track.at(4)
    assert str(error.value) == "frame 4 was not tracked; this result has 3 frames from 2 to 5."
    with pytest.raises(HandtrackError, match="no tracked frame between 10 and 19; .* 2 to 5"):
        track.between(range(10, 20))


def test_a_model_without_keypoints_has_none(rng):
    bare = [replace(sample_frame(rng, f), keypoints21=None) for f in range(3)]
    track = stacked(bare)
    assert track.keypoints21 is None
    assert track.at(1).keypoints21 is None
    assert track.between(range(2)).keypoints21 is None


@pytest.mark.parametrize("frames", [[], [1, 1], [2, 1]])
def test_our_own_mistakes_are_assertions(rng, frames):
    with pytest.raises(AssertionError):
        sample_track(rng, frames)
