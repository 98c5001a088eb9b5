"""The next frame is read beside, once, in the direction of travel, and its faults are told where it is asked for."""

import threading

import pytest

from handtrack import HandtrackError
from handtrack.session.sources.prefetch import Prefetch


class Recording:
    """Counts what is read, and by which thread."""

    def __init__(self, broken=()):
        self.read, self.beside, self.broken = [], [], set(broken)
        self.main = threading.current_thread()

    def prepare(self, frame):
        if frame in self.broken:
            raise HandtrackError(f"frame {frame} is damaged")
        if frame not in self.read:
            self.read.append(frame)
            if threading.current_thread() is not self.main:
                self.beside.append(frame)

    def observe(self, frame, bones):
        self.prepare(frame)
        return frame


@pytest.fixture(autouse=True)
def _two_threads(monkeypatch):
    monkeypatch.setenv("HANDTRACK_THREADS", "2")


def test_forward_then_backward():
    recording = Recording()
    ahead = Prefetch(recording.observe, recording.prepare, range(2, 8), 5)
    assert [ahead(frame, None) for frame in (5, 6, 7, 4, 3, 2)] == [5, 6, 7, 4, 3, 2]
    ahead.close()
    assert sorted(recording.read) == [2, 3, 4, 5, 6, 7]  # nothing outside the range
    assert recording.beside == [6, 7, 3, 2]  # 5 and 4 were not foreseen


def test_a_damaged_frame_is_told_of_when_it_is_asked_for():
    recording = Recording(broken=[1])
    ahead = Prefetch(recording.observe, recording.prepare, range(3), 0)
    assert ahead(0, None) == 0
    with pytest.raises(HandtrackError, match="frame 1"):
        ahead(1, None)
    assert ahead(2, None) == 2
    ahead.close()
