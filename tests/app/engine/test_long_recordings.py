"""Long recordings: what is done and told does not grow with the frames there are (faults A18, C60). Counts, not seconds."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack.session.session_state import DecidedPose, decide
from handtrack.store.current_track import CurrentTrack, TakeFrames
from handtrack_app.engine import document_snapshots
from handtrack_app.engine.document import Document
from handtrack_app.engine.document_snapshots import (
    timeline_change,
    timeline_snapshot,
    work_snapshot,
)
from handtrack_app.engine.store import edits
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.engine.timeline import TrackedRows
from tests.app.fake_run import fake_document

LENGTHS = (100, 2_000)


@pytest.fixture(params=LENGTHS)
def long_document(request, tmp_path: Path) -> Document:
    """A document of so many frames, all tracked."""
    document = fake_document(tmp_path)
    count: int = request.param
    take, result = TakeFrames(document.model.parameter_names), document.run._result  # type: ignore[attr-defined]
    one = result(0, document.model.rest_params(), 0)
    take.heads.update({frame: replace(one, frame=frame) for frame in range(count)})
    document.frames, document.rows = range(count), TrackedRows(range(count))
    document.takes.put(1, take)
    document.results = CurrentTrack([(range(count), take)])
    timeline_snapshot(document)
    return document


@pytest.fixture
def looked_at(monkeypatch) -> list[int]:
    """The frames that were asked for."""
    frames: list[int] = []
    head, all_of = CurrentTrack._take, CurrentTrack.__iter__

    def noted(track: CurrentTrack, frame: int) -> TakeFrames | None:
        frames.append(frame)
        return head(track, frame)

    def all_noted(track: CurrentTrack) -> Iterator[int]:
        found = list(all_of(track))
        frames.extend(found)
        return iter(found)

    monkeypatch.setattr(CurrentTrack, "_take", noted)
    monkeypatch.setattr(CurrentTrack, "__iter__", all_noted)
    return frames


def _track_on(document: Document, frames: range) -> None:
    take = document.results.layers[0][1]
    for frame in frames:
        take.put(replace(take[frame], energy=1000.0 + frame), None)


def test_a18_a_frame_tracked_is_looked_at_and_no_other(long_document, looked_at) -> None:
    document = long_document
    while document_snapshots.read_more(document):
        pass
    timeline_snapshot(document)
    _track_on(document, range(10, 15))
    looked_at.clear()
    change = timeline_change(document)
    assert set(looked_at) == set(range(10, 15))
    assert change.row.tolist() == list(range(10, 15))
    assert change.energy.tolist() == [1000.0 + f for f in range(10, 15)]
    assert len(pickle.dumps(change, 5)) < 2000, "through the pipe"


def test_a18_what_is_told_of_the_timeline_adds_up_to_the_whole(tmp_path: Path) -> None:
    document = fake_document(tmp_path)
    take = TakeFrames(document.model.parameter_names)
    document.results = CurrentTrack([(document.frames, take)])
    strip = timeline_snapshot(document)
    result = document.run._result  # type: ignore[attr-defined]
    document.apply(edits.pose(document, 5, (document.start + 0.01).tolist()))
    for frame in (3, 4, 5, 4):
        take.put(replace(result(frame, document.model.rest_params(), 0), energies={"rest": 2.0}), None)  # fmt: skip
        strip = timeline_change(document).over(strip)
    whole = timeline_snapshot(document)
    for name in ("status", "energy", "error_mm"):
        np.testing.assert_array_equal(getattr(strip, name), getattr(whole, name))
    np.testing.assert_array_equal(strip.terms["priors"], whole.terms["priors"])
    other = replace(timeline_change(document), frames=range(99))
    assert other.over(strip) is strip, "of a recording that is counted anew meanwhile"


def test_c60_takes_are_looked_at_once_for_a_track(long_document, looked_at) -> None:
    first = work_snapshot(long_document, "saved")
    assert first.takes[0].shown == len(long_document.frames)
    looked_at.clear()
    assert work_snapshot(long_document, "saving").takes == first.takes
    assert not looked_at


def test_c60_the_pose_before_is_found_without_looking_at_all(long_document, looked_at) -> None:
    looked_at.clear()
    edits.taken_pose(long_document, len(long_document.frames) // 2, "previous")
    assert len(looked_at) < 10


def test_c60_the_error_of_a_given_pose_is_found_once(tmp_path: Path, monkeypatch) -> None:
    document, asked = fake_document(tmp_path), []
    for frame in range(5):
        document.apply(edits.pose(document, frame, (document.start + 0.01).tolist()))
    real = document_snapshots._error_mm
    monkeypatch.setattr(
        document_snapshots, "_error_mm", lambda d, f, bones: asked.append(f) or real(d, f, bones)
    )
    first = timeline_snapshot(document).error_mm
    document.apply(edits.pose(document, 2, (document.start + 0.02).tolist()))
    second = timeline_snapshot(document).error_mm
    assert asked == [0, 1, 2, 3, 4, 2]
    assert np.flatnonzero(first != second).tolist()[:1] == [2]


@pytest.mark.parametrize("known", LENGTHS)
def test_c60_an_edit_is_written_alone(tmp_path: Path, known: int) -> None:
    document = fake_document(tmp_path)
    (tmp_path / "session.toml").write_text("")
    store = Persistence.open(document)
    document.apply(decide(pose={1000 + n: DecidedPose({}) for n in range(known)}))
    store.do("Pose", edits.pose(document, 5, (document.start + 0.01).tolist()), waits=True)
    store.flush()
    store.close()
    (log,) = (tmp_path / "tracks" / "actions").iterdir()
    assert log.stat().st_size < 4000
