"""What `handtrack warmup` compiles: a frame of every kind of tracking. The command itself is a step of .ci/run."""

import pytest

from handtrack.simulation.warm_up import KINDS, track_small_frame


@pytest.mark.parametrize("kind", KINDS)
def test_a_frame_of_each_kind_is_tracked(kind):
    assert track_small_frame(kind) == kind
