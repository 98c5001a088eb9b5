"""Crash safety: what was accepted is there again after the process ended in any way."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.files.versions import versions
from handtrack.session.formats.tables import read_npz
from handtrack_app.engine.store.persistence import WORK_FILE, Persistence
from handtrack_app.engine.store.tracks import export
from tests.app.fake_run import FRAMES, fake_document

pytestmark = pytest.mark.usefixtures("journals_closed")


def _tracked(folder: Path, **options: Any) -> Persistence:
    store = Persistence.open(fake_document(folder, step_s=0.0, **options))
    document = store.document
    for result in document.run.track(document.frames, 3, document.model.rest_params()):
        document.accept(result)
        store.note_result(result)
    return store


def test_poses_and_settings_come_back_after_a_crash(tmp_path: Path) -> None:
    store = Persistence.open(fake_document(tmp_path))
    document = store.document
    values = document.start.copy()
    values[0] = 0.123
    document.set_pose(5, tuple(values))
    store.note_pose(5)
    store.note("setting", {"name": "silhouettes.weight", "value": 2.5})
    store.note("limits", {"name": "index_mcp_flex", "interval": (0.0, 0.5)})
    # no close: the process is gone
    again = Persistence.open(fake_document(tmp_path))
    said = again.restore()
    assert said == "Brought back from last time: 1 pose set by hand, 2 changed settings."
    assert again.document.by_hand[5][0] == pytest.approx(0.123)
    assert again.document.run.settings.silhouettes.weight == 2.5
    assert again.document.limits == {"index_mcp_flex": (0.0, 0.5)}


def test_a_pose_that_was_found_comes_back_as_found(tmp_path: Path) -> None:
    store = Persistence.open(fake_document(tmp_path))
    document = store.document
    for frame in (5, 6):
        document.set_found(frame, tuple(document.start + 0.02))
        store.note_pose(frame)
    document.set_pose(6, tuple(document.start + 0.03))
    store.note_pose(6)
    again = Persistence.open(fake_document(tmp_path))
    said = again.restore()
    assert said == "Brought back from last time: 1 pose set by hand, 1 pose found."
    assert (again.document.is_found(5), again.document.is_found(6)) == (True, False)


def test_tracked_frames_come_back_from_the_journal_of_a_run_that_crashed(tmp_path: Path) -> None:
    store = _tracked(tmp_path)
    store.flush()
    again = Persistence.open(fake_document(tmp_path))
    again.restore()
    assert sorted(again.document.results) == list(range(FRAMES))
    for frame, result in store.document.results.items():
        back = again.document.results[frame]
        np.testing.assert_allclose(back.parameters, result.parameters)
        np.testing.assert_allclose(back.joint_positions, result.joint_positions)
        assert back.status == result.status


def test_a_finished_run_moves_from_the_journal_to_a_file(tmp_path: Path) -> None:
    store = _tracked(tmp_path)
    store.settle()
    assert store.journal is not None
    assert not [e for e in store.journal.events() if e.kind == "tracked"]
    assert len(read_npz(tmp_path / WORK_FILE)) == FRAMES
    again = Persistence.open(fake_document(tmp_path))
    assert again.restore() == f"Brought back from last time: {FRAMES} tracked frames."


def test_the_work_of_another_model_is_kept_beside(tmp_path: Path) -> None:
    store = _tracked(tmp_path)
    store.settle()
    store.settle()
    document = store.document
    assert not versions(tmp_path / WORK_FILE), "the same model's is only brought up to date"
    document.replace_run(document.run.with_values({"model.name": "glove9"}))
    for result in document.run.track(document.frames, 3, document.model.rest_params()):
        document.accept(result)
    store.settle()
    (kept,) = versions(tmp_path / WORK_FILE)
    assert len(read_npz(kept).parameter_names) == 26
    assert len(read_npz(tmp_path / WORK_FILE).parameter_names) == 9


def test_what_the_command_line_tracked_is_shown(tmp_path: Path) -> None:
    store = _tracked(tmp_path)
    store.save_track()  # tracks/poses.npz, as `handtrack track` writes it
    (tmp_path / WORK_FILE).unlink(missing_ok=True)
    (tmp_path / "tracks" / "journal.jsonl").unlink()
    again = Persistence.open(fake_document(tmp_path))
    assert again.restore() == f"Brought back from last time: {FRAMES} tracked frames."
    assert sorted(again.document.results) == list(range(FRAMES))


def test_a_pose_that_tracking_replaced_does_not_come_back_over_it(tmp_path: Path) -> None:
    store = Persistence.open(fake_document(tmp_path, step_s=0.0))
    document = store.document
    document.set_pose(3, tuple(document.start + 0.01))
    store.note_pose(3)
    document.accept(next(document.run.track(range(3, 4), 3, document.model.rest_params())))
    store.settle()
    again = Persistence.open(fake_document(tmp_path))
    again.restore()
    assert not again.document.by_hand


def test_a_damaged_journal_opens(tmp_path: Path) -> None:
    (tmp_path / "tracks").mkdir()
    lines = [
        '{"time_s": 1, "kind": "pose", "data": {"frame": "x"}}',
        '{"time_s": 1, "kind": "setting", "data": {"name": "no.such", "value": 1}}',
        '{"time_s": 1, "kind": "tracked", "data": {"frame": 1}}',
        "torn",
    ]
    (tmp_path / "tracks" / "journal.jsonl").write_text("\n".join(lines))
    assert Persistence.open(fake_document(tmp_path)).restore() == ""


def test_the_first_pose_is_written_and_the_one_before_kept(tmp_path: Path) -> None:
    (tmp_path / "init.json").write_text('{"frame": 0, "parameters": {}}')
    store = Persistence.open(fake_document(tmp_path))
    store.document.show(4)
    said = store.save_first_pose()
    data = json.loads((tmp_path / "init.json").read_text())
    assert said.startswith("Tracking will start from frame 4")
    assert data["frame"] == 4
    assert data["parameters"]["index_pip_flex"] == pytest.approx(store.document.shown[15], abs=1.0)
    assert len(list((tmp_path / "versions").iterdir())) == 1


def test_csv_has_a_row_for_every_frame_and_hand_set_ones_are_keyframes(tmp_path: Path) -> None:
    store = _tracked(tmp_path)
    store.document.set_pose(2, tuple(store.document.start))
    name, data = export(store.document, "csv")
    rows = data.decode().splitlines()
    assert name == "fake.csv"
    assert rows[0].startswith("frame,time_s,status,energy,root_tx_m")
    assert len(rows) == FRAMES + 1
    assert rows[3].split(",")[2] == "3"


def test_npz_can_be_read_back(tmp_path: Path) -> None:
    store = _tracked(tmp_path)
    _, data = export(store.document, "npz")
    with np.load(io.BytesIO(data)) as arrays:
        assert arrays["parameters"].shape[0] == FRAMES


def test_nothing_to_export_is_told_in_words(tmp_path: Path) -> None:
    with pytest.raises(HandtrackError, match="There is nothing to save yet"):
        export(fake_document(tmp_path), "csv")


def test_tracked_frames_wait_for_each_other_on_their_way_to_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    monkeypatch.setattr("os.fsync", synced.append)
    store = _tracked(tmp_path)
    store.flush()
    assert 0 < len(synced) < FRAMES


def test_a7_what_could_not_be_written_is_tried_again(tmp_path: Path, monkeypatch) -> None:
    store = _tracked(tmp_path)
    store.flush()
    assert store.journal is not None
    store.note_result(store.document.results[5])
    with monkeypatch.context() as patch:
        patch.setattr(store.journal, "append_all", _full)
        with pytest.raises(HandtrackError, match="full"):
            store.flush()
    store.flush()
    assert [e.data["frame"] for e in store.journal.events()][-1] == 5


def _full(_events: object) -> None:
    raise HandtrackError("the disk is full")


def test_a3_a_pose_set_ahead_of_the_tracker_stays_after_a_crash(tmp_path: Path) -> None:
    store = Persistence.open(fake_document(tmp_path, step_s=0.0))
    document = store.document
    document.set_pose(6, document.start.tolist())
    store.note_pose(6)
    for result in document.run.track(document.frames, 3, document.model.rest_params()):
        document.accept(result, replaces_hand=result.frame == 3)
        store.note_result(result)
    store.flush()
    assert 6 in document.by_hand
    again = Persistence.open(fake_document(tmp_path))
    again.restore()
    assert sorted(again.document.by_hand) == [6]


def test_a13_c35_a_damaged_journal_is_told_and_kept(tmp_path: Path) -> None:
    store = Persistence.open(fake_document(tmp_path))
    for frame in (5, 7):
        store.document.set_pose(frame, store.document.start.tolist())
        store.note_pose(frame)
    store.close()
    path = tmp_path / "tracks/journal.jsonl"
    damaged = path.read_text().replace('"frame":5', '"frame":4')
    path.write_text(damaged)
    again = Persistence.open(fake_document(tmp_path))
    again.restore()
    assert sorted(again.document.by_hand) == [7]
    assert "1 of its lines cannot be read" in again.warning
    again.close()
    (kept,) = (tmp_path / "tracks/versions").glob("journal_*.jsonl")
    assert kept.read_text() == damaged
