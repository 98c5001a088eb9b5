"""Damage of a video is told, kept with what counting its frames told, and holds for first poses."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack.session.sources.video_audits import keep_audits
from tests.session.small_session import edit, make_session, write_init

FRAMES = 40


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A session with a video."""
    make_session(tmp_path)
    edit(tmp_path / "session.toml", 'images = "cam0/*.png"', 'images = "cam0.avi"')
    write_video(tmp_path / "cam0.avi")
    return tmp_path


def write_video(path: Path, frames: int = FRAMES) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    for frame in range(frames):
        writer.write(np.full((48, 64, 3), 5 * frame, np.uint8))
    writer.release()


def cut(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def test_damage_is_told_and_remembered(folder):
    """Fault C3."""
    cut(folder / "cam0.avi")
    session = Session.open(folder)
    assert session.known_frames == range(FRAMES)  # as it announces
    count = len(session.videos[0].frames)
    assert 4 < count < FRAMES - 4
    assert session.known_frames == range(count)
    assert session.frame_count == count
    told = [text for text in session.warnings if f"only {count} can be decoded" in text]
    assert len(told) == 1 and "camera 'cam0'" in told[0]
    keep_audits(folder, session.videos)
    again = Session.open(folder)
    assert again.known_frames == range(count)
    assert again.warnings == session.warnings


def test_a_first_pose_behind_the_end_of_a_cut_video_is_refused_once_it_is_counted(
    folder,
):
    write_init(folder, frame=FRAMES - 2)
    cut(folder / "cam0.avi")
    session = Session.open(folder)
    count = session.frame_count
    with pytest.raises(
        HandtrackError, match=f"init.json: frame = 38, but .* frames 0 to {count - 1}"
    ):
        session.check_init()
    write_init(folder, frame=FRAMES)
    with pytest.raises(HandtrackError, match=r"init.json: frame = 40, but .* frames 0 to 39"):
        Session.open(folder)
