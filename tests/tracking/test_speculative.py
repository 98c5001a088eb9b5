"""Searches beside: what comes out is what stepping gives, whatever they find and however long they take."""

import threading
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack import Status
from handtrack.tracking.frame.constants import FRAMES_AHEAD as AHEAD
from handtrack.tracking.frame.control import Control
from handtrack.tracking.speculative import SpeculativeExecution
from tests.tracking.scenes import Told

COUNT = 60


@dataclass
class Path:
    """A tracker whose pose is the sum of all frames so far; a search that finds something adds 1000."""

    due: frozenset[int] = frozenset()
    finds: frozenset[int] = frozenset()
    gate: threading.Event = field(default_factory=threading.Event)
    """searches wait for it"""
    glanced: list[int] = field(default_factory=list)

    def expected_bones(self, state, frame):
        return None

    def step_without_search(self, state, seen, control):
        self.glanced.append(seen)
        after = state + seen
        return after, self._result(seen, after), seen in self.due

    def step(self, state, seen, control):
        if seen in self.due:
            while not self.gate.wait(0.001) and not control.should_stop():
                pass
            control.observer.search(
                SimpleNamespace(
                    frame=seen, before=state, winner=seen if seen in self.finds else None
                )
            )
        after = state + seen + 1000 * (seen in self.finds)
        return after, self._result(seen, after)

    def _result(self, frame, pose):
        return SimpleNamespace(
            frame=frame, parameters=np.array([pose]), status=Status.TRACKED, reason=None
        )


def poses(path, threads, monkeypatch, show=id, **more):
    monkeypatch.setenv("HANDTRACK_THREADS", str(threads))
    execution = SpeculativeExecution(path, lambda frame, _: frame, 0, Control(**more), show)
    return [(r.frame, r.parameters[0]) for _, r in execution.frames(range(COUNT))]


@pytest.mark.parametrize("seed", range(5))
def test_the_same_comes_out_whatever_is_due_and_found(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    due = frozenset(np.flatnonzero(rng.random(COUNT) < rng.choice([0.05, 0.3, 1.0])).tolist())
    path = Path(due, frozenset(f for f in due if rng.random() < 0.3))
    path.gate.set()
    told = [Told() for _ in range(4)]
    one = poses(path, 1, monkeypatch, observer=told[1])
    for threads in (2, 3):
        assert poses(path, threads, monkeypatch, observer=told[threads]) == one
        assert told[threads] == told[1]  # in the frames' order, and none of a frame solved anew


def test_frames_go_on_while_a_search_runs_and_come_again(monkeypatch):
    path, early = Path(frozenset({3}), frozenset({3})), []

    def show(result):
        early.append((result.frame, result.parameters[0]))
        if result.frame == 3 + AHEAD:
            path.gate.set()

    found = poses(path, 2, monkeypatch, show)
    assert [f for f, _ in early[: 4 + AHEAD]] == list(range(4 + AHEAD))  # nothing waited
    assert dict(early) == dict(found)  # the last that is shown of a frame holds
    # then each frame with its searches, since one was lost
    assert path.glanced == list(range(4 + AHEAD))


def test_before_a_live_camera_no_frame_waits_for_a_search(monkeypatch):
    path, early = Path(frozenset({3, 5, 40}), frozenset({3, 5, 40})), []
    searches, begun = [], SpeculativeExecution._search

    def noted(self, frame, *given):
        begun(self, frame, *given)
        searches.append(frame.beside)

    monkeypatch.setattr(SpeculativeExecution, "_search", noted)

    def show(result):
        early.append(result.frame)
        if result.frame == 50:
            path.gate.set()
            searches[-1].exception()  # waits

    found = dict(poses(path, 2, monkeypatch, show, waits=False))
    assert early[:51] == list(range(51))
    assert found[39] == sum(range(40))  # of 3 it came too late, and 5 had none beside it
    assert found[40] == sum(range(41)) + 1000
    assert sorted(found) == [*range(41), 41, 44, 47, 50, *range(51, COUNT)]
