"""Sessions: what an opened folder gives, frame by frame and camera by camera."""

import pickle

import cv2
import numpy as np

from handtrack import Session, bundled_session
from handtrack.session import bundled
from tests.conftest import refused
from tests.session.small_session import edit
from tests.session.test_hostile_sessions import contains, refusal


def test_images_and_masks_are_as_they_were_taken(folder):
    session = Session.open(folder)
    image, mask = session.image("cam0", 2), session.mask("cam1", 2)
    assert image.shape == (48, 64, 3)
    assert (image == 80).all()
    assert mask.dtype == np.uint8
    assert set(np.unique(mask)) == {0, 255}
    assert session.image("cam1", 2) is None
    assert session.image("cam0", 99) is None
    refused("'top'.*session.toml.*cam0, cam1", session.image, "top", 0)


def test_another_process_opens_the_same(folder):
    session = pickle.loads(pickle.dumps(Session.open(folder)))
    assert session.mask("cam1", 2) is not None


def test_frames_run_to_the_last_of_any_camera(folder):
    (folder / "masks/cam1/003.png").rename(folder / "masks/cam1/009.png")
    session = Session.open(folder)
    assert session.frame_count == 10
    assert session.observation(7).silhouettes == ()
    assert [s.camera.name for s in session.observation(9).silhouettes] == ["cam1"]
    refused("10.* 0 to 9", session.observation, 10)


def test_c11_the_line_to_write_is_said_and_does_it(folder):
    """Of the second camera half as large masks as it is calibrated for."""
    for frame in range(4):
        half = np.full((24, 32), 255, np.uint8)
        cv2.imwrite(str(folder / f"masks/cam1/{frame:03d}.png"), half)
    contains(
        refusal(folder), "32 x 24", "calibrated for 64 x 48", "0.5 times", "image_size = [32, 24]"
    )
    edit(folder / "session.toml", 'name = "cam1"', 'name = "cam1"\nimage_size = [32, 24]')
    session = Session.open(folder)
    assert session.rig["cam1"].size == (32, 24)
    assert session.rig["cam1"].matrix.tolist() == [[40, 0, 15.5], [0, 40, 11.5], [0, 0, 1]]
    assert session.rig["cam0"].size == (64, 48)
    assert [s.mask.shape for s in session.observation(0).silhouettes] == [(48, 64), (24, 32)]


def test_an_installed_program_gives_out_a_working_copy_keeps_work_and_completes_it(
    tmp_path, monkeypatch
):
    """In a wheel the recordings lie in the package, the working copies elsewhere."""
    shelf = tmp_path / "site-packages" / "handtrack" / "bundled_sessions"
    (shelf / "fist" / "masks").mkdir(parents=True)
    (shelf / "fist" / "session.toml").write_text("[session]")
    (shelf / "fist" / "masks" / "0.png").write_text("mask")
    (shelf / "fist" / "tracks").mkdir()
    (shelf / "fist" / "tracks" / "poses.npz").write_text("made of it, no part of it")
    monkeypatch.setattr(bundled, "_INSTALLED", shelf)
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    folder = bundled_session("fist")
    assert folder == tmp_path / "home" / "sessions" / "fist"
    assert (folder / "masks" / "0.png").read_text() == "mask"
    assert not (folder / "tracks").exists()
    (folder / "session.toml").write_text("my own settings")
    (folder / "masks" / "0.png").unlink()
    assert bundled_session("fist") == folder
    assert (folder / "session.toml").read_text() == "my own settings"
    assert (folder / "masks" / "0.png").read_text() == "mask"
