"""Videos: exact at random access, counted by decoding, honest about damage."""

from __future__ import annotations

import struct
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

import handtrack.capture.images.video as video_module
from handtrack.capture.images.video import VideoFile
from handtrack.capture.images.video_audit import oddities
from handtrack.errors import HandtrackError

FRAMES = 90


def striped(frame: int) -> np.ndarray:
    """The frame's number as eight black and white stripes, which no codec can blur away."""
    bits = [(frame >> bit) & 1 for bit in range(8)]
    stripes = np.repeat(np.array(bits, np.uint8) * 255, 8)
    return np.broadcast_to(stripes[None, :, None], (48, 64, 3)).copy()


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """A video whose stripes tell its frame."""
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30.0, (64, 48))
    assert writer.isOpened()
    for frame in range(FRAMES):
        writer.write(striped(frame))
    writer.release()
    return path


def shown(source: VideoFile, frame: int) -> int:
    image = source.read(frame)
    assert image is not None
    bright = image.mean(axis=(0, 2)).reshape(8, 8).mean(axis=1) > 128
    return sum(1 << bit for bit in range(8) if bright[bit])


def test_any_order_gives_the_frame_that_was_asked_for(
    clip: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video_module, "_CACHE_BYTES", 0)
    monkeypatch.setattr(video_module, "_CHECKPOINT_EVERY", 10)
    source = VideoFile(clip)
    assert source.frames == range(FRAMES)
    forward = list(range(0, 30))
    backward = list(range(80, 40, -1))
    anywhere = [int(frame) for frame in rng.integers(0, FRAMES, 60)]
    for frame in forward + backward + anywhere:
        assert shown(source, frame) == frame


def test_a_seek_that_arrives_elsewhere_is_noticed(
    clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(video_module, "_CACHE_BYTES", 0)
    monkeypatch.setattr(video_module, "_CHECKPOINT_EVERY", 10)
    source = VideoFile(clip)
    assert source.frames == range(FRAMES)
    lying = {
        at: mark._replace(checksum=mark.checksum ^ 1) for at, mark in source._checkpoints.items()
    }
    source._checkpoints = lying
    assert [shown(source, frame) for frame in (70, 25, 60, 24)] == [70, 25, 60, 24]


def test_stepping_back_decodes_a_window_once(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = VideoFile(clip)
    shown(source, 89)
    restarts = 0
    original = source._restart

    def counted() -> None:
        nonlocal restarts
        restarts += 1
        original()

    monkeypatch.setattr(source, "_restart", counted)
    assert [shown(source, frame) for frame in range(88, -1, -1)] == list(range(88, -1, -1))
    assert restarts == 0  # 90 small frames fit into the cache


def test_memory_stays_bounded(clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_module, "_CACHE_BYTES", 12 * 48 * 64 * 3)
    source = VideoFile(clip)
    for frame in range(FRAMES):
        source.read(frame)
    assert len(source._cache) == 12


def test_after_the_end_and_before_the_start_are_misses(clip: Path) -> None:
    source = VideoFile(clip)
    assert source.read(FRAMES) is None
    assert source.read(10**6) is None
    assert source.read(-1) is None
    assert shown(source, 5) == 5
    source.close()
    assert shown(source, 7) == 7


def test_a_cut_video_misses_its_end_and_says_so(clip: Path) -> None:
    """Fault C2."""
    data = clip.read_bytes()
    clip.write_bytes(data[: len(data) // 2])
    source = VideoFile(clip)
    count = len(source.frames)
    assert 10 < count < FRAMES - 10
    assert source.read(count) is None
    assert shown(source, count - 1) == count - 1
    assert len(source.warnings) == 1
    expected = (
        f"announces {FRAMES} frames, but only {count} can be decoded; it is cut off or damaged"
    )
    assert expected in source.warnings[0]


@pytest.mark.parametrize(("turn", "size"), [(90, (48, 64)), (180, (64, 48)), (270, (48, 64))])
def test_c12_a_video_that_asks_to_be_turned_is_and_it_is_said(
    turn: int, size: tuple[int, int], tmp_path: Path
) -> None:
    path = tmp_path / "portrait.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 30.0, (64, 48))
    picture = np.zeros((48, 64, 3), np.uint8)
    picture[:24, :32] = 255
    for _ in range(3):
        writer.write(picture)
    writer.release()
    assert VideoFile(path).warnings == ()
    data, (cos, sin) = bytearray(path.read_bytes()), {90: (0, 1), 180: (-1, 0), 270: (0, -1)}[turn]
    matrix = (
        cos,
        sin,
        0,
        -sin,
        cos,
        0,
        0,
        0,
        1 << 14,
    )  # of 16 bits behind the point, the last of 30
    struct.pack_into(">9i", data, data.index(b"tkhd") + 44, *(value << 16 for value in matrix))
    path.write_bytes(data)
    source = VideoFile(path, size)
    image = source.read(0)
    assert image is not None
    assert np.argwhere(image.mean(axis=2) > 128).min(axis=0).tolist() == {
        90: [0, 24], 180: [24, 32], 270: [32, 0],
    }[turn]  # fmt: skip
    assert [f"asks to be turned by {turn}°" in text for text in source.warnings] == [True]


def test_files_that_are_no_videos_are_refused(tmp_path: Path) -> None:
    """Fault C1."""
    with pytest.raises(HandtrackError, match=r"none.mp4: no such file; expected a video"):
        VideoFile(tmp_path / "none.mp4")
    (tmp_path / "text.mp4").write_text("hello")
    with pytest.raises(
        HandtrackError, match=r"text.mp4: cannot be opened as a video.*re-encode it"
    ):
        VideoFile(tmp_path / "text.mp4")


def test_another_size_than_the_calibrations_is_refused(clip: Path) -> None:
    with pytest.raises(
        HandtrackError, match=r"the image is 64 x 48, but .* calibrated for 720 x 720"
    ):
        VideoFile(clip, (720, 720))


def test_two_readers_at_once_get_their_own_frames(clip: Path) -> None:
    source = VideoFile(clip)
    wrong: list[int] = []

    def play(frames: range) -> None:
        wrong.extend(frame for frame in frames if shown(source, frame) != frame)

    readers = [
        threading.Thread(target=play, args=(frames,))
        for frames in (range(0, FRAMES), range(FRAMES - 1, -1, -1))
    ]
    for reader in readers:
        reader.start()
    for reader in readers:
        reader.join()
    assert wrong == []


def test_uneven_times_are_reported() -> None:
    times = np.array([0, 33, 67, 100, 200, 233, 267], dtype=float)
    (text,) = oddities(7, times)
    assert "1 steps between frames are longer than the usual 33" in text
    assert "after frame 3" in text
    assert oddities(7, np.arange(7) * 33.3) == []
