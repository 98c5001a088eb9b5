"""Videos: exact at random access, counted by decoding, honest about damage."""

import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

import handtrack.capture.images.video as video_module
from handtrack.capture.images.video import VideoFile

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


def test_any_order_gives_the_frame_that_was_asked_for(clip, rng, monkeypatch):
    monkeypatch.setattr(video_module, "_CACHE_BYTES", 0)
    monkeypatch.setattr(video_module, "_CHECKPOINT_EVERY", 10)
    source = VideoFile(clip)
    assert source.frames == range(FRAMES)
    forward = list(range(0, 30))
    backward = list(range(80, 40, -1))
    anywhere = [int(frame) for frame in rng.integers(0, FRAMES, 60)]
    for frame in forward + backward + anywhere:
        assert shown(source, frame) == frame


def test_a_seek_that_arrives_elsewhere_is_noticed(clip, monkeypatch):
    monkeypatch.setattr(video_module, "_CACHE_BYTES", 0)
    monkeypatch.setattr(video_module, "_CHECKPOINT_EVERY", 10)
    source = VideoFile(clip)
    assert source.frames == range(FRAMES)
    lying = {
        at: mark._replace(checksum=mark.checksum ^ 1) for at, mark in source._checkpoints.items()
    }
    source._checkpoints = lying
    assert [shown(source, frame) for frame in (70, 25, 60, 24)] == [70, 25, 60, 24]


def test_a_cut_video_misses_its_end_and_says_so(clip):
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
def test_c12_a_video_that_asks_to_be_turned_is_and_it_is_said(turn, size, tmp_path):
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
