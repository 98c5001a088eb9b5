"""`handtrack takes`: list, compare, restore, prune."""

import errno
import io
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from handtrack import read_npz
from handtrack.store.store import Store, WritableStore
from handtrack.tracking.state import Step
from tests.app.command_line import FRAMES


@pytest.fixture
def session(tracked, tmp_path):
    """The small recording with three takes: as it came, refined, and one of three frames that is a centimetre off."""
    folder = Path(shutil.copytree(tracked, tmp_path / "session"))
    with WritableStore(folder / "tracks", "a test") as store:
        first = store.take(2)
        writer = store.begin(replace(first.about, by="another", frames=(1, 4)))
        for result in first.results(range(1, 4)):
            points = result.joint_positions + [0.01, 0.0, 0.0]
            moved = result.parameters + np.eye(1, len(result.parameters))[0] * 0.01
            writer.add(
                Step(replace(result, parameters=moved, joint_positions=points, keypoints21=points))
            )
    return folder


def test_takes_are_listed_with_their_size(handtrack, session):
    told = json.loads(handtrack("takes", session, "--json").out)
    assert [take["take"] for take in told["takes"]] == [1, 2, 3]
    assert told["takes"][2]["statuses"] == {"tracked": 3}
    assert told["takes"][0]["settings"]["silhouettes.weight"] == 1.0
    assert set(told["takes"][0]["versions"]) == {"handtrack", "numpy", "numba", "python"}
    assert told["damage"] == []
    assert told["writer"] is None


def test_a_span_of_a_take_is_made_current_and_undone(handtrack, session):
    poses = session / "tracks/poses.npz"
    before = poses.read_bytes()
    handtrack.does("takes", session, "--restore", 3, "--frames", "2:5")
    mixed = read_npz(poses)
    assert mixed.frame.tolist() == list(range(FRAMES))
    ours = Store(session / "tracks").take(3).track()
    assert np.array_equal(mixed.at(3).joint_positions, ours.at(3).joint_positions)
    ended = handtrack("takes", session, "--restore", 2)
    assert ended.out == f"current: frames 0 to 4 of take 2. Saved to {poses}\n"
    with np.load(io.BytesIO(before)) as old, np.load(poses) as new:
        assert set(old.files) == set(new.files)
        assert "refinement" in old.files
        assert all(
            np.array_equal(old[name], new[name], equal_nan=old[name].dtype.kind == "f")
            for name in old.files
        )
    handtrack.does("takes", session, "--restore", 1)
    assert read_npz(poses).refinement is None, "the live pass knows nothing of it"


def test_a_full_disk_leaves_both_track_and_file_as_they_were(handtrack, session, monkeypatch):
    """Whichever write fails."""
    poses = session / "tracks/poses.npz"
    before = poses.read_bytes(), Store(session / "tracks").current()

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    for place in (
        "handtrack.session.takes.take_recorder.write_npz",
        "handtrack.store.log.os.write",
    ):
        with monkeypatch.context() as patch:
            patch.setattr(place, full)
            ended = handtrack("takes", session, "--restore", 1)
        assert ended.code == 2 and ended.out == ""
        assert (poses.read_bytes(), Store(session / "tracks").current()) == before
    handtrack.does("takes", session, "--restore", 1)
    assert poses.read_bytes() != before[0]


def test_two_takes_are_compared(handtrack, session):
    found = json.loads(handtrack("takes", session, "--compare", 2, 3, "--json").out)
    assert found["frames_of_both"] == 3
    assert found["distance_mm"] == pytest.approx(10.0)
    assert found["energy_of_first"] == found["energy_of_second"]
    assert found["take_2_error_mm"] < found["take_3_error_mm"]
    assert found["take_2_overlap"] > 0.9 > found["take_3_overlap"] > 0.5
    assert "distance_max_mm" in handtrack("takes", session, "--compare", 2, 3).out


def test_a_take_is_removed_by_its_user_alone(handtrack, session):
    ended = handtrack("takes", session, "--prune", 2)
    assert ended.code == 2
    assert "take 2 is part of the current track; restore another one first." in ended.err
    pruned = handtrack("takes", session, "--prune", 3).out
    assert re.fullmatch(r"take 3 is removed; 0\.\d MB are free\.\n", pruned)
    assert len(handtrack("takes", session).out.splitlines()) == 2
    assert handtrack("takes", session, "--restore", 3).code == 2
