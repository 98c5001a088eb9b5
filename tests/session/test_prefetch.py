"""The next frame is read beside, once, in the direction of travel, and its faults are told where it is asked for."""

import threading

from handtrack import HandtrackError
from handtrack.session.run import prefetching
from tests.conftest import refused


def test_forward_then_backward_and_a_damaged_frame_when_it_is_asked_for(monkeypatch):
    monkeypatch.setenv("HANDTRACK_THREADS", "2")
    here, read_by = threading.current_thread(), {}

    def prepare(frame):
        if frame == 7:
            raise HandtrackError(f"frame {frame} is damaged")
        read_by.setdefault(frame, threading.current_thread())

    def observe(frame, bones):
        prepare(frame)
        return frame

    with prefetching(observe, prepare, range(2, 8), 5) as ahead:
        assert [ahead(frame, None) for frame in (5, 6)] == [5, 6]
        refused("frame 7", ahead, 7, None)
        assert [ahead(frame, None) for frame in (4, 3, 2)] == [4, 3, 2]
    assert sorted(read_by) == [2, 3, 4, 5, 6]  # nothing outside the range
    assert {frame for frame, by in read_by.items() if by is here} == {5, 4}, "not foreseen"
