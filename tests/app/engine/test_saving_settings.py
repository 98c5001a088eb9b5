"""Settings changed on the page are saved to session.toml: they alone, with the file before kept; or told why not."""

from unittest.mock import Mock

import pytest

from handtrack import HandScale, HandtrackError
from handtrack.capture.clouds.cloud_filters import SkinEllipse
from handtrack.files import toml_edit
from handtrack.files.atomic import versions
from handtrack.model.model_file import read_scale
from handtrack.session.first_pose import read_first_pose
from handtrack.session.session_file import read_session_file
from handtrack.session.session_state import decide
from handtrack_app.engine import edits
from tests.app.cloudy_session import cloudy_session
from tests.app.opened import did, opened, opened_recording
from tests.app.waiting import eventually

pytestmark = pytest.mark.usefixtures("left_open")
TEXT = "[session]\nformat = 1  # of the file\n"


@pytest.fixture
def store(tmp_path):
    """Two settings are changed, one of them twice."""
    (tmp_path / "session.toml").write_text(TEXT)
    store = opened(tmp_path)
    for name, value in (("cloud.weight", 2.0), ("solver.iterations", 5), ("solver.iterations", 7)):
        did(store, decide(setting={name: value}))
    return store


def test_while_tracking_runs_nothing_is_saved(bench):
    path = bench.folder / "session.toml"
    path.write_text(TEXT)
    bench.engine.set_setting("cloud.weight", 2.0)
    bench.engine.track(0, 12, 3)
    bench.engine.save_to_file("setting")
    said = bench.layout.messages
    eventually(lambda: "fixed while tracking" in said.said.content)
    assert path.read_text() == TEXT


def test_the_file_before_is_kept_and_the_journal_gives_way(store):
    path = store.folder / "session.toml"
    store.save_settings("setting")
    store.save_settings("setting")  # which has them already
    (kept,) = versions(path)
    assert kept.read_text() == TEXT
    again = opened(store.folder)  # what stands in session.toml may be edited there from now on
    assert again.document.run.settings.solver.iterations == 30


@pytest.mark.parametrize("text", [TEXT, "[session\nformat = 1\n", "tracking = 3\n", None])
def test_a_file_that_cannot_be_changed_is_left_alone_and_nothing_is_lost(store, text, monkeypatch):
    path = store.folder / "session.toml"
    path.unlink()
    if text is not None:
        path.write_text(text)
    if text == TEXT:  # which is right, in a folder that is read-only
        locked = PermissionError(13, "Permission denied", str(path))
        monkeypatch.setattr(toml_edit, "replace_text", Mock(side_effect=locked))
    with pytest.raises(HandtrackError):
        store.save_settings("setting")
    assert (path.read_text() if path.exists() else None) == text
    again = opened(store.folder)
    assert again.document.run.settings.solver.iterations == 7


def test_the_fitted_size_is_kept_and_one_that_was_given_stays_as_it_is_written(tmp_path):
    path = tmp_path / "session.toml"
    text = '[hand]\nscale = "fit"  # mine\n[session]\nformat = 1\nfps = 25.0\n\n[[camera]]\nname = "front"\n'
    path.write_text(text)
    size = HandScale(1.07, {"thumb": 0.95})
    store = opened(tmp_path)
    did(store, edits.size(size))
    for _ in range(2):
        store.save_first_pose()
    assert read_session_file(path).hand.scale == "hand.json"
    assert read_scale(tmp_path / "hand.json") == size
    assert read_first_pose(tmp_path / "init.json").frame == store.document.frame
    assert "# mine" in path.read_text()
    assert [one.read_text() for one in versions(path)] == [text]
    assert len(versions(tmp_path / "init.json")) == 1
    (tmp_path / "hand.json").unlink()
    path.write_text("[hand]\nscale = 1.05\n")
    store.save_first_pose()
    assert path.read_text() == "[hand]\nscale = 1.05\n"
    assert not (tmp_path / "hand.json").exists()


def test_clouds_are_saved_key_by_key(tmp_path):
    """A usual value that stands there stays; what became usual goes; what somebody added meanwhile is his."""
    folder = cloudy_session(tmp_path)
    path = folder / "session.toml"
    store = opened_recording(folder)
    document = store.document
    added = path.read_text().replace("[clouds]", "[clouds]  # c\nper_voxel = 3")
    path.write_text(added)
    skin = SkinEllipse((0.4, 0.3), (0.001, 0.0, 0.002), 3.0)
    changed = document.clouds.with_values({"voxel_m": None, "skin": skin, "near_m": False})
    did(store, decide(clouds=changed.table))
    store.save_settings("clouds")
    expected = document.clouds.with_values({"per_voxel": 3})
    assert read_session_file(path).clouds == expected
    assert "voxel_m" not in path.read_text()
    assert "[clouds]  # c\nper_voxel = 3\n" in path.read_text()
