"""Edits reach the disk, each frame's, however they follow one another and whatever failed in between."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from handtrack.errors import HandtrackError
from handtrack.session.session_state import key_of
from handtrack.store.store import Store
from handtrack_app.engine.store import persistence
from handtrack_app.engine.worker import Worker
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.mailbox import Mailbox
from tests.app.calls import call
from tests.app.engine.test_worker import Listener, _desk, _pose
from tests.app.waiting import eventually


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[tuple[Worker, Listener]]:
    yield from _desk(tmp_path)


def written(folder: Path) -> list[int]:
    """Return the frames whose poses are on disk, in their order."""
    actions = Store(folder / "tracks").actions()
    changed = [key_of(c.key) for action in actions for c in action.changes]
    return [frame for kind, frame in changed if kind == "pose"]


def edit(worker: Worker, listener: Listener, frame: int, version: int) -> None:
    worker.engine.set_pose(frame, _pose(listener, index_mcp_flex=0.1), version)
    listener.wait(snapshots.PoseSnapshot, lambda p: p.version == version)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (call("set_pose", 1, (), 1), call("set_pose", 2, (), 2)),
        (call("pull_place", 1, (0, 0, 0), 1, "index_tip"), call("pull_place", 2, (0, 0, 0), 2, "index_tip")),
    ],
)  # fmt: skip
def test_a4_a_waiting_edit_is_not_replaced_by_another_frames(first: Any, second: Any) -> None:
    box: Mailbox[Any] = Mailbox(lambda c: c.key)
    for command in (first, second, first):
        box.put(command)
    assert [box.take(0.0) for _ in range(len(box))] == [second, first]


def test_a5_edits_of_two_frames_in_quick_succession_are_both_written(
    desk: tuple[Worker, Listener], tmp_path: Path
) -> None:
    worker, listener = desk
    edit(worker, listener, 3, 1)
    worker.engine.take_pose(4, "fist", 2)
    listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 2)
    worker.stop()
    assert written(tmp_path) == [3, 4]


def test_a7_an_edit_that_could_not_be_written_is_tried_again_with_the_next(
    desk: tuple[Worker, Listener], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker, listener = desk
    assert worker._session is not None

    def full(_action: object) -> None:
        raise HandtrackError("the disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(worker._session.store.store, "write", full)
        edit(worker, listener, 5, 1)
        listener.wait(snapshots.Notice, lambda n: "the disk is full" in n.text)
    worker.engine.show_frame(6)  # one can look around meanwhile
    listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == 6)
    assert written(tmp_path) == []
    edit(worker, listener, 8, 2)
    worker.stop()
    assert written(tmp_path) == [5, 8]
    assert sum("full" in s.text for s in listener.seen if isinstance(s, snapshots.Notice)) == 1


def test_a15_a_drag_that_goes_on_and_on_is_written_meanwhile(
    desk: tuple[Worker, Listener], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    worker, listener = desk
    monkeypatch.setattr(persistence, "_QUIET_S", float("inf"))  # it never rests
    monkeypatch.setattr(persistence, "_LONGEST_S", 0.05)
    edit(worker, listener, 3, 1)
    eventually(lambda: written(tmp_path) == [3], "the drag on the disk")


def test_a14_while_tracking_is_paused_every_frame_is_on_disk(tmp_path: Path) -> None:
    for worker, listener in _desk(tmp_path, stuck=lambda frame: frame == 7):
        worker.engine.track(0, 12, 3)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.done == 4)
        worker.engine.pause(True)
        listener.wait(snapshots.ProgressSnapshot, lambda p: p.state == "paused")

        results, store = worker.document.results, Store(tmp_path / "tracks")
        eventually(
            lambda shown=results, store=store: (
                len(shown) >= 4 and set(shown) == set(store.frames_of(1))
            ),
            "what is shown is on disk",
        )
        worker.engine.cancel()
