"""The start page: what a folder holds, what was opened last, and a recording made from videos in the browser."""

import shutil
from pathlib import Path

import pytest

from handtrack import Session, bundled_session
from handtrack.session.bundled import bundled_names
from handtrack_app.access.web_server import LARGEST_FILE
from handtrack_app.start.recent import recent_sessions, remember
from handtrack_app.start.start_page import ImportProgress, StartPage, find_files
from tests.app.access.test_messages import begins, part
from tests.app.commands.test_new_joints import project
from tests.app.waiting import eventually
from tests.app.wire import WireClient
from tests.capture.sample_files import rig_of_two, sample
from tests.conftest import REPOSITORY

BUNDLED = REPOSITORY / "sessions" / "another_hand"


@pytest.fixture
def folder(tmp_path):
    """Videos with names of their own, in a folder with other files, and the calibration among them."""
    folder = tmp_path / "my take"
    folder.mkdir()
    (folder / "notes.json").write_text('{"who": "me"}')
    shutil.copy(BUNDLED / "calibration.toml", folder / "a calibration.toml")
    for video in BUNDLED.glob("*.mp4"):
        shutil.copy(video, folder / f"take3_{video.name}")
    return folder


@pytest.fixture
def start(monkeypatch, tmp_path):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    page = StartPage("127.0.0.1", 0)
    yield page
    page.stop()


@pytest.fixture
def asked(start, monkeypatch):
    """The words of each `handtrack new` that would be run."""
    asked = []
    monkeypatch.setattr(start, "_run", lambda _title, args, *_: asked.append(args))
    return asked


def test_one_opencv_file_a_camera_is_taken_whole(tmp_path, start, asked):
    rig = rig_of_two()
    files = sample("calibration/opencv_a_file_a_camera", tmp_path)
    video = BUNDLED / "cam0.mp4"
    for name in rig.names:
        shutil.copy(video, tmp_path / f"{name}.mp4")
    found = find_files(tmp_path)
    assert set(found.calibrations) == set(files) and not found.unused
    assert {name: path.stem for name, path in found.videos.items()} == {n: n for n in rig.names}
    start.folder.value = str(tmp_path)
    for _ in range(2):  # the second time by what the page wrote into the field
        start.look()
        assert start.make.visible
        start.make_session()
        words = asked.pop()
        given = {words[n + 1] for n, word in enumerate(words) if word == "--calibration"}
        assert given == {str(path) for path in files}
        assert words.count("--video") == 2


def test_recordings_are_remembered_as_long_as_they_are_there(monkeypatch, tmp_path):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    assert recent_sessions() == []
    folders = [Path(shutil.copytree(BUNDLED, tmp_path / name)) for name in ("a", "b")]
    for one in (*folders, folders[0]):
        remember(one)
    assert recent_sessions() == folders
    shutil.rmtree(folders[0])
    assert recent_sessions() == folders[1:]
    (tmp_path / "home" / "recent.json").write_text("{")
    assert recent_sessions() == []


def test_a_recording_is_made_in_the_browser(start, folder, tmp_path):
    with WireClient(start.web.url) as client:
        client.set_value(start.folder, str(tmp_path / "away"))
        eventually(lambda: "no such folder" in start.output.content)
        client.set_value(start.folder, str(tmp_path))
        eventually(lambda: folder.name in [entry.label for entry in start._entries])
        assert not start.making.visible
        client.press(folder.name)
        eventually(lambda: start.make.visible)
        assert (
            "take3_cam0.mp4" in start.listed.content
            and "a calibration.toml" in start.calibration.value
        )
        client.set_value(start.tracked, "left hand")
        client.set_value(start.masks, "none")
        client.set_value(start.make, True)
        eventually(lambda: start.chosen)
    made = Session.open(tmp_path / "my take_handtrack")
    assert start.wait() == made.folder
    assert made.file.hand.side == "left" and made.frame_count == 100


def test_recordings_are_cards_with_pictures_and_an_example_opens(start):
    with WireClient(start.web.url) as client:
        said = lambda: str(list(client.messages))  # noqa: E731
        eventually(lambda: said().count("class='handtrack-card'") >= len(bundled_names()))
        eventually(lambda: "image/jpeg" in said())
        assert start.folder.value  # whose folders are listed
        client.press("Open another_hand")
        eventually(lambda: start.chosen)
    assert start.wait() == bundled_session("another_hand")


def test_a_camera_without_a_video_and_an_unused_video_are_red(start, folder):
    (folder / "take3_cam2.mp4").rename(folder / "zoom.mp4")
    start.folder.value = str(folder)
    start.look()
    red = start.listed.content.split("handtrack-error")[1:]
    assert any("cam2" in part for part in red) and any("zoom.mp4" in part for part in red)
    assert start.listed.content.count("ready") == 2


def upload(client, start, path):
    """Send a file as viser's page does."""
    content, button = path.read_bytes(), start.upload
    client.send(begins(button, len(content), transfer=path.name, filename=path.name))
    client.send(part(button, content, transfer=path.name))


def test_a_calibration_is_uploaded(start, folder, tmp_path):
    """One file of all cameras, or one after the other of each; the page's own folder goes with it."""
    (folder / "a calibration.toml").rename(tmp_path / "my calibration.toml")
    files = sample("calibration/opencv_a_file_a_camera", tmp_path)
    start.folder.value = str(folder)
    with WireClient(start.web.url) as client:
        eventually(start.web.server.get_clients)
        upload(client, start, tmp_path / "my calibration.toml")
        eventually(lambda: start.make.visible)
        assert start.listed.content.count("ready") == 3
        (kept,) = start._files.calibrations
        assert kept.name == "my calibration.toml"
        for path in files:
            upload(client, start, path)
        eventually(lambda: len(start.calibration.value.split(";")) == 2)
        for name, size in (("large.toml", LARGEST_FILE + 1), ("film.mp4", 3 * 1024**3)):
            client.send(begins(start.upload, size, filename=name))
            eventually(lambda name=name: f"{name} is too large" in start.output.content)
    assert any(kept.parent.iterdir())
    start.stop()
    assert not kept.parent.exists()


def test_what_an_import_prints_becomes_steps_and_the_time_left():
    progress = ImportProgress("Importing take")
    assert progress.hear("detecting:   0%|          | 0/60 [00:00<?, ?frame/s]")
    assert (progress.step, progress.share, progress.left) == ("Detect joints", 0.0, "")
    assert not progress.hear("detecting:  37%|███▋      | 22/60 [00:10<00:17, 2.2frame/s]")
    assert (progress.share, progress.left) == (0.37, "00:17")
    assert progress.hear("looking for the first pose …") and progress.share is None


def test_an_import_that_ends_early_offers_what_is_done(start, folder, monkeypatch):
    def ended(args, tell, end):
        tell("copying …")
        shutil.copytree(BUNDLED, args[args.index("--out") + 1])
        assert not start.pictures.visible
        tell("detecting:  37%|███▋      | 22/60 [00:10<00:17, 2.2frame/s]")
        eventually(lambda: start.pictures.visible)
        assert "<figcaption>cam1" in start.pictures.content
        end(130)

    monkeypatch.setattr("handtrack_app.start.start_page.Program", ended)
    start.folder.value = str(folder)
    start.look()
    start.make_session()
    assert start.open_done.visible and start.opening.visible and not start.cancel.visible
    with WireClient(start.web.url) as client:
        client.press("Open what is done")
        eventually(lambda: start.chosen == folder.parent / "my take_handtrack")


def test_a_pose2sim_project_is_known(start, asked, tmp_path, monkeypatch):
    """It has no videos here: joints alone will do."""
    trial = project(tmp_path / "p")
    monkeypatch.setattr("handtrack_app.start.start_page.has_weights", lambda: False)
    with WireClient(start.web.url) as client:
        client.set_value(start.folder, str(trial))
        eventually(lambda: start.make.visible)
    assert "Pose2Sim" in start.listed.content
    assert not start.fetch.visible, "its joints need no detector"
    start.make_session()
    (words,) = asked
    assert words[words.index("--project") + 1] == str(trial)
    assert "--video" not in words and "--track" in words
