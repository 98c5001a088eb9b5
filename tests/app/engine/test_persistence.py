"""Crash safety: what was done is there again after the process ended in any way; and the pose before the last step."""

import io
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack.observation.pins import Pin
from handtrack.session.session_state import Correction, decide
from handtrack.session.sources.corrections import encoded
from handtrack.store.log import LogWriter
from handtrack.store.store import Span
from handtrack_app import protocol
from handtrack_app.engine.persistence import export_beside
from handtrack_app.engine.posing_service import pose as pose_edit
from handtrack_app.engine.posing_service import pose_before
from tests.app.desk import working
from tests.app.fake_run import FRAMES, fake_document
from tests.app.opened import did, opened, posed, tracked

pytestmark = pytest.mark.usefixtures("left_open")


def test_frames_that_no_page_tracked_are_no_return(tmp_path):
    """As after an import, or by `handtrack track`."""
    tracked(opened(tmp_path))
    worker, listener = working(tmp_path, fake_document)
    worker.stop()
    strip = next(one for one in listener.seen if isinstance(one, protocol.TimelineSnapshot))
    assert (strip.status >= 0).all()
    assert not any(getattr(one, "title", "") == "Welcome back" for one in listener.seen)


def test_tracking_again_overwrites_nothing(tmp_path):
    """One wrong slider turned good frames into lost ones for good; now undo brings them back, a restart later too."""
    store = tracked(opened(tmp_path))
    good = store.document.results[8].parameters
    posed(store, 6, 0.3)
    tracked(store, range(6, FRAMES), first=6)
    assert not np.array_equal(store.document.results[8].parameters, good)
    assert 6 not in store.document.by_hand, "tracked from there"
    again = opened(tmp_path)
    for now in (store, again):
        now.document.show(8)
        before = pose_before(now.document, now.history)
        assert_allclose(before, good, atol=1e-9, err_msg="of two trackings the one below")
    assert again.store.current() == (Span(1, 0, 6), Span(2, 6, FRAMES))
    assert 6 not in again.document.by_hand, "it does not come back over what was tracked"
    action = again.undo()
    assert action is not None and action.words == f"Tracking of frames 6 to {FRAMES - 1}"
    assert_array_equal(again.document.results[8].parameters, good)
    assert 6 in again.document.by_hand, "as set by hand before"
    again.redo()
    assert again.store.current() == (Span(1, 0, 6), Span(2, 6, FRAMES))


def test_a5b_a_keyframe_keeps_its_value_when_limits_are_narrowed_later(tmp_path):
    store = opened(tmp_path)
    at = store.document.model.parameter_names.index("index_pip_flex")
    values = store.document.start.copy()
    values[at] = 1.2
    did(store, pose_edit(store.document, 5, values.tolist()))
    for interval in ((0.0, 0.5), None, (0.0, 0.6)):
        did(store, decide(limits={"index_pip_flex": interval}))
    assert store.document.by_hand[5][at] == pytest.approx(1.2)
    assert_array_equal(opened(tmp_path).document.by_hand[5], store.document.by_hand[5])


def test_what_cannot_be_any_more_is_passed_over_and_told(tmp_path):
    store = opened(tmp_path)
    posed(store, 5)
    gone = store.history.next("x", (), "do")
    odd = {"id": gone.id, "kind": "do", "words": "x", "joins": False,
           "changes": [{"key": "setting/no.such", "before": None, "after": 1}]}  # fmt: skip
    store.store.write(type(gone).of(odd))
    again = opened(tmp_path)
    assert sorted(again.document.by_hand) == [5]


def test_what_is_written_beside_comes_to_the_client_that_asked(tmp_path):
    store, sent_to = tracked(opened(tmp_path)), []
    thread = export_beside(store.document, "csv-long", 7, "", sent_to.append)
    thread.join(300)
    (download,) = sent_to
    assert (download.name, download.client_id) == ("fake_long.zip", 7)
    with zipfile.ZipFile(io.BytesIO(download.data)) as archive:
        assert {"fake_long.csv", "fake_long.json"} < set(archive.namelist())
    for up in ("", "z"):
        thread = export_beside(store.document, "trc", 7, up, sent_to.append)
        thread.join(300)
    assert sent_to[1].data != sent_to[2].data, "turned upright"
    assert export_beside(store.document, "init", 7, "", sent_to.append) is None
    assert sent_to[3].name == f"fake_frame{store.document.frame}_init.json"


def test_killed_at_any_write_a_step_and_its_files_are_both_there_or_neither(tmp_path, monkeypatch):
    edit = decide(
        pins={3: (Pin("front", (40.0, 30.0), "index_tip"),)},
        correction={("front", 0): Correction(encoded(np.zeros((72, 96), np.uint8)))},
    )
    ends, moment = False, 0
    while not ends:
        folder, moment = tmp_path / str(moment), moment + 1
        store, left = tracked(opened(folder)), iter(range(moment))
        with monkeypatch.context() as patch, suppress(StopIteration, RuntimeError):
            for place, name in ((Path, "replace"), (LogWriter, "append")):
                really = getattr(place, name)
                counted = lambda *given, go=really, left=left: (next(left), go(*given))[1]  # noqa: E731
                patch.setattr(place, name, counted)
            did(store, edit)
            store.save_track()
            ends = True
        again = opened(folder)
        assert len(again.store.takes()) == 1, "a track that was saved is no other take"
        did(again, edit)  # as the page does again
        files = folder / "pins.json", folder / "masks_corrected/front/000000.png"
        assert all(file.is_file() for file in files)
        again.undo()
        assert not any(file.exists() for file in files)
        again.redo()
        assert files[1].is_file()
    assert moment > 4


def test_it_is_the_pose_before_the_last_step_that_changed_this_frame(tmp_path):
    store = opened(tmp_path)
    document = store.document
    document.show(5)
    assert pose_before(document, store.history) is None, "no step was taken"
    posed(store, 5, by=0.05)
    tracked(store, first=3)
    posed(store, 5, by=0.1)
    posed(store, 6, by=0.2)
    store.do("A setting", decide(setting={"silhouettes.weight": 2.0}))
    document.show(5)
    was = pose_before(document, store.history)
    assert_allclose(was[6:], document.start[6:] + 0.05, atol=1e-9)
    for _ in range(3):
        store.undo()
    document.show(5)
    assert_allclose(document.shown[6:], document.start[6:] + 0.05, atol=1e-9)
