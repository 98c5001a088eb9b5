"""Opening a session decodes next to nothing; what counting the frames told is kept, for that very video only; damage is told."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest

import handtrack.capture.images.video as video_module
from handtrack.errors import HandtrackError
from handtrack.session.session import Session
from handtrack.session.sources.video_audits import keep_audits
from tests.session.small_session import edit, make_session, write_init

FRAMES = 40
_open = cv2.VideoCapture


class CountingCapture:
    """OpenCV's video, with what is asked of it counted."""

    calls: ClassVar[Counter[str]] = Counter()

    def __init__(self, path: str, *how: object) -> None:
        self._capture = _open(path, *how)

    def grab(self) -> bool:
        self.calls["grab"] += 1
        return self._capture.grab()

    def read(self) -> tuple[bool, np.ndarray]:
        self.calls["grab"] += 1
        return self._capture.read()

    def __getattr__(self, name: str) -> object:
        return getattr(self._capture, name)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A session with a video, whose decoding is counted."""
    make_session(tmp_path)
    edit(tmp_path / "session.toml", 'images = "cam0/*.png"', 'images = "cam0.avi"')
    write_video(tmp_path / "cam0.avi")
    CountingCapture.calls.clear()
    monkeypatch.setattr(video_module.cv2, "VideoCapture", CountingCapture)
    return tmp_path


def write_video(path: Path, frames: int = FRAMES) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    for frame in range(frames):
        writer.write(np.full((48, 64, 3), 5 * frame, np.uint8))
    writer.release()


def cut(path: Path) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def decoded() -> int:
    return CountingCapture.calls["grab"]


def test_opening_decodes_one_frame_a_video(folder: Path) -> None:
    session = Session.open(folder)
    assert session.known_frames == range(FRAMES)
    assert decoded() == 1
    assert not session.is_counted
    assert session.frame_count == FRAMES
    assert decoded() > FRAMES
    assert session.is_counted


def test_damage_is_told_and_remembered(folder: Path) -> None:
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
    folder: Path,
) -> None:
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
