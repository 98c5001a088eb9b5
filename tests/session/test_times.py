"""Cameras that are late, have a rate of their own or miss frames, and videos that are shorter than they say: a miss never shifts the others."""

import numpy as np
import pytest

from handtrack import Session
from handtrack.session.doctor.examine import examine_start
from handtrack.session.sources.video_audits import keep_audits
from tests.capture.sample_files import filmed as video_of
from tests.conftest import refused
from tests.session.small_session import edit, make_session, write_images, write_init

COUNT = 12


@pytest.fixture
def folder(tmp_path):
    """The first camera's image n is n grey levels bright, at 10 fps."""
    return recorded(make_session(tmp_path), "cam0", range(COUNT))


def recorded(folder, name, levels):
    """Write images 0, 1, 2 … whose grey levels say what moment they show."""
    for old in (folder / name).glob("*"):
        old.unlink()
    write_images(folder / name, levels)
    return folder


def second_camera(folder, settings, levels):
    """Return the session with images of a second camera, and lines for its table."""
    recorded(folder, "cam1", levels)
    edit(
        folder / "session.toml",
        'name = "cam1"',
        f'name = "cam1"\nimages = "cam1/*.png"\n{settings}',
    )
    return Session.open(folder)


def shown(session, name, frames=range(COUNT)):
    """Return what moment the images of some frames show."""
    images = (session.image(name, frame) for frame in frames)
    return [None if image is None else int(image[0, 0, 0]) for image in images]


@pytest.mark.parametrize("late", [3, -2])
def test_c8_a_late_camera_is_joined_by_its_lag(late, folder):
    moments = [100 + frame - late for frame in range(COUNT)]
    session = second_camera(folder, f"lag_s = {late / 10}", moments)
    known = [moment if moment in moments else None for moment in range(100, 100 + COUNT)]
    assert shown(session, "cam1") == known
    assert shown(session, "cam0") == list(range(COUNT))
    assert session.time_s(3) == pytest.approx(0.3)
    assert session.frame_count == max(COUNT, COUNT - late)


def test_c7_a_faster_and_a_slower_camera_are_joined_by_time(folder):
    session = second_camera(folder, "fps = 40.0", range(4 * COUNT))
    assert shown(session, "cam1") == list(range(0, 4 * COUNT, 4))
    assert session.frame_count == COUNT + 1  # its last image is 25 ms before a 13th frame
    edit(folder / "session.toml", "fps = 40.0", "fps = 5.0")
    joined = shown(Session.open(folder), "cam1", range(5))
    assert joined == [0, None, 1, None, 2]


def stamps(folder, times):
    rows = [f"{name},{i},{t:.4f}" for name, row in times.items() for i, t in enumerate(row)]
    (folder / "t.csv").write_text("\n".join(["camera,frame,time_s", *rows]))
    edit(folder / "session.toml", "fps = 10.0", 'timestamps = "t.csv"')
    return Session.open(folder)


def test_c4_c5_a_variable_rate_and_dropped_frames_are_joined_by_time_stamps(folder):
    times = [1000 + 0.1 * m for m in range(COUNT)]  # since any moment
    uneven = [1000 + 0.01 * t for t in (0, 4, 8, 13, 21, 33, 40, 61, 72, 79, 91, 104, 110)]
    second_camera(folder, "", range(len(uneven)))
    session = stamps(folder, {"cam0": times, "cam1": uneven})
    nearest = [int(np.argmin(np.abs(np.array(uneven) - t))) for t in times]
    nearest[5] = None  # dropped: the nearest one is a tenth of a second away
    assert shown(session, "cam1") == nearest
    assert session.fps == pytest.approx(10.0)
    assert [session.time_s(frame) for frame in (5, COUNT + 1)] == pytest.approx([1000.5, 1001.3])


FRAMES = 40


def with_video(folder):
    """Make a session with a video."""
    edit(make_session(folder) / "session.toml", 'images = "cam0/*.png"', 'images = "cam0.avi"')
    pictures = (np.full((48, 64, 3), 5 * frame, np.uint8) for frame in range(FRAMES))
    video_of(folder / "cam0.avi", pictures, fps=10.0)
    return folder


@pytest.fixture
def filmed(tmp_path):
    return with_video(tmp_path)


def test_rates_by_which_cameras_drift_apart_are_told(filmed):
    edit(filmed / "session.toml", 'name = "cam1"', 'name = "cam1"\nimages = "cam1.avi"')
    video_of(filmed / "cam1.avi", [np.zeros((48, 64, 3), np.uint8)] * 80, fps=10.08)
    told = [text for text in examine_start(Session.open(filmed)) if "frames apart" in text]
    assert len(told) == 1 and "`fps = 10.08`" in told[0]


def cut(path):
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def test_damage_is_told_and_remembered(filmed):
    """Fault C3."""
    cut(filmed / "cam0.avi")
    session = Session.open(filmed)
    assert session.known_frames == range(FRAMES)  # as it announces
    count = len(session.videos[0].frames)
    assert 4 < count < FRAMES - 4
    assert session.known_frames == range(count)
    assert session.frame_count == count
    told = [text for text in session.warnings if f"only {count} can be decoded" in text]
    assert len(told) == 1 and "camera 'cam0'" in told[0]
    keep_audits(filmed, session.videos)
    again = Session.open(filmed)
    assert again.known_frames == range(count)
    assert again.warnings == session.warnings


def test_a_first_pose_behind_the_end_of_a_cut_video_is_refused_once_it_is_counted(
    filmed,
):
    write_init(filmed, frame=FRAMES - 2)
    cut(filmed / "cam0.avi")
    session = Session.open(filmed)
    count = session.frame_count
    refused(f"38.* 0 to {count - 1}", session.check_init)
    write_init(filmed, frame=FRAMES)
    refused("40.* 0 to 39", Session.open, filmed)
