"""Sessions: what an opened folder gives, frame by frame and camera by camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack import HandtrackError, PointCloud, Session, bundled_session
from handtrack.capture.clouds.cloud_files import write_cloud
from handtrack.capture.masks.segmentation import DepthRange, SkinYCrCb
from handtrack.session import bundled
from handtrack.session.session_file import (
    CameraSettings,
    CloudSettings,
    HandSettings,
    RecordingSettings,
    SessionFile,
    read_session_file,
    write_session_file,
)
from tests.capture.test_synchrony import camera
from tests.session.small_session import edit, make_session
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
    with pytest.raises(
        HandtrackError, match=r"no camera 'top' in .*session.toml; known: cam0, cam1"
    ):
        session.image("top", 0)


def test_frames_run_to_the_last_of_any_camera(folder):
    (folder / "masks/cam1/003.png").rename(folder / "masks/cam1/009.png")
    session = Session.open(folder)
    assert session.frame_count == 10
    assert session.observation(7).silhouettes == ()
    assert [s.camera.name for s in session.observation(9).silhouettes] == ["cam1"]
    with pytest.raises(HandtrackError, match=r"no frame 10; the session has the frames 0 to 9"):
        session.observation(10)


def test_time_is_that_of_the_first_camera_with_time_stamps(folder):
    rows = ["camera,frame,time_s"]
    rows += [f"cam0,{f},{f * 0.1:.3f}" for f in range(4)]
    rows += [f"cam1,{f},{f * 0.1 + 0.01:.3f}" for f in range(3)]
    (folder / "times.csv").write_text("\n".join(rows))
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "times.csv"')
    session = Session.open(folder)
    assert [session.time_s(f) for f in range(3)] == pytest.approx([0.0, 0.1, 0.2])
    assert session.fps == pytest.approx(10.0, rel=0.06)
    assert session.time_s(5) == pytest.approx(0.3 + 2 / session.fps)


FULL = SessionFile(
    RecordingSettings('two "views"', 29.97, "times.csv", 0.043),
    HandSettings("hand26", "left", 1.05, True),
    (
        CameraSettings("cam0", "cam0.mp4", SkinYCrCb(y_min=50), roi=(1, 2, 30, 40)),
        CameraSettings("cam1", "cam1/*.png", "masks/cam1/*.png"),
        CameraSettings("kinect", masks=DepthRange(0.2, 0.9), depth="d/*.png", depth_scale_m=0.001),
        CameraSettings("drawn"),
    ),
    CloudSettings(stereo=(("cam0", "cam1"),), given={"crop_m": 0.1, "max_points": 2000}),
    {"silhouettes": {"weight": 2.0, "term": "coverage"}, "model": {"coupling": "21"}},
)
BARE = SessionFile(RecordingSettings("bare", 30.0), HandSettings(), (CameraSettings("a"),))


@pytest.mark.parametrize("file", [FULL, BARE], ids=["full", "bare"])
def test_what_is_written_reads_back(file, tmp_path):
    write_session_file(tmp_path / "session.toml", file)
    assert read_session_file(tmp_path / "session.toml") == file


@pytest.fixture
def halved(tmp_path: Path) -> Path:
    """Of the second camera half as large masks as it is calibrated for."""
    halved = make_session(tmp_path)
    mask = np.zeros((24, 32), np.uint8)
    mask[3:22, 9:24] = 255
    for frame in range(4):
        cv2.imwrite(str(halved / f"masks/cam1/{frame:03d}.png"), mask)
    return halved


def test_c11_the_line_to_write_is_said_and_does_it(halved):
    contains(
        refusal(halved), "32 x 24", "calibrated for 64 x 48", "0.5 times", "image_size = [32, 24]"
    )
    edit(halved / "session.toml", 'name = "cam1"', 'name = "cam1"\nimage_size = [32, 24]')
    session = Session.open(halved)
    assert session.rig["cam1"].size == (32, 24)
    assert session.rig["cam1"].matrix.tolist() == [[40, 0, 15.5], [0, 40, 11.5], [0, 0, 1]]
    assert session.rig["cam0"].size == (64, 48)
    assert [s.mask.shape for s in session.observation(0).silhouettes] == [(48, 64), (24, 32)]


def test_c11_pixels_of_a_scaled_camera_are_where_resized_images_have_them(
    rng,
):
    """Averaging blocks of 4 pixels puts what covered them at their middle."""
    large = camera("a", 0.3)
    small = large.scaled((large.size[0] // 4, large.size[1] // 4))
    points = rng.uniform(-0.05, 0.05, (9, 3))
    block = (large.project(points) - 1.5) / 4
    assert np.allclose(small.project(points), block, atol=1e-9)


MIDDLE = np.array([0.0, 0.0, 0.01])


@pytest.fixture
def walled(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A session with masks, and clouds of a hand-sized patch before a wall with forty times its points."""
    folder = make_session(tmp_path)
    (folder / "c").mkdir()
    hand = MIDDLE + rng.uniform(-0.04, 0.04, (1000, 3)) * (1, 1, 0.05)
    wall = rng.uniform(-1.0, 1.0, (40_000, 3)) * (1, 1, 0.001) + (0, 0, 0.4)
    for frame in range(2):
        write_cloud(folder / "c" / f"{frame}.npz", PointCloud(np.vstack([wall, hand])))
    settings = folder / "session.toml"
    text = settings.read_text().replace('scale = "fit"', "scale = 1.0")
    clouds = '[clouds]\nfiles = "c/*.npz"\nmax_points = 400\noutlier_neighbours = 8\n'
    settings.write_text(f"{text}\n{clouds}")
    return folder


def to_middle(points):
    return np.linalg.norm(points - MIDDLE, axis=1) - 0.04


def test_the_crop_comes_before_the_thinning(walled):
    session = Session.open(walled)
    everything = session.observation(0).cloud
    cropped = session.observation(0, hand_distance=to_middle).cloud
    assert len(everything) == len(cropped) == 400
    assert (everything.points[:, 2] < 0.1).sum() < 60  # hardly any of the hand is left
    assert (cropped.points[:, 2] < 0.1).all()


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Pretend to be a wheel: the recordings lie in the package, the working copies elsewhere."""
    shelf = tmp_path / "site-packages" / "handtrack" / "bundled_sessions"
    (shelf / "fist" / "masks").mkdir(parents=True)
    (shelf / "fist" / "session.toml").write_text("[session]")
    (shelf / "fist" / "masks" / "0.png").write_text("mask")
    monkeypatch.setattr(bundled, "_INSTALLED", shelf)
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))
    return shelf


def test_an_installed_program_gives_out_a_working_copy(installed, tmp_path):
    folder = bundled_session("fist")
    assert folder == tmp_path / "home" / "sessions" / "fist"
    assert (folder / "masks" / "0.png").read_text() == "mask"


def test_the_users_work_is_kept_and_a_short_copy_completed(installed):
    folder = bundled_session("fist")
    (folder / "session.toml").write_text("my own settings")
    (folder / "masks" / "0.png").unlink()
    assert bundled_session("fist") == folder
    assert (folder / "session.toml").read_text() == "my own settings"
    assert (folder / "masks" / "0.png").read_text() == "mask"
