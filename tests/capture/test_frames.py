"""Numbered image files: numbers, gaps, kinds, damage."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.capture.images.frames import DEPTH, MASK, ImageFiles, frame_number
from handtrack.errors import HandtrackError


def picture(value: int, dtype: type = np.uint8) -> np.ndarray:
    return np.full((48, 64), value, dtype)


def folder_of(folder: Path, names: list[str]) -> list[Path]:
    paths = [folder / name for name in names]
    for path in paths:
        cv2.imwrite(str(path), picture(200 + frame_number(path.name)))
    return paths


@pytest.mark.parametrize(
    ("name", "frame"),
    [("000018.png", 18), ("cam1_frame_7.png", 7), ("2024-03-01_12.png", 12), ("a9b10c.jp2", 10)],
)
def test_the_frame_is_the_last_group_of_digits(name, frame):
    assert frame_number(name) == frame


def test_gaps_are_misses_and_shift_nothing(tmp_path):
    source = ImageFiles(folder_of(tmp_path, ["f2.png", "f10.png", "f3.png"]), MASK)
    assert source.frames == range(11)
    assert [frame for frame in source.frames if source.has(frame)] == [2, 3, 10]
    assert source.size == (64, 48)
    image = source.read(10)
    assert image is not None
    assert (image == 210).all()
    assert source.read(4) is None
    assert source.read(99) is None
    assert source.warnings == ()


def test_kinds_have_their_shapes(tmp_path):
    paths = folder_of(tmp_path, ["5.png"])
    colour, mask = ImageFiles(paths).read(5), ImageFiles(paths, MASK).read(5)
    assert colour is not None
    assert colour.shape == (48, 64, 3)
    assert mask is not None
    assert mask.shape == (48, 64)
    cv2.imwrite(str(tmp_path / "d1.png"), picture(40000, np.uint16))
    depth = ImageFiles([tmp_path / "d1.png"], DEPTH).read(1)
    assert depth is not None
    assert depth.dtype == np.uint16
    assert (depth == 40000).all()
    with pytest.raises(HandtrackError, match=r"depth must be one channel of 16 bits; found uint8"):
        ImageFiles(paths, DEPTH).read(5)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("damage", ["cut", "empty", "text"])
def test_unreadable_files_are_misses_with_a_warning(suffix, damage, tmp_path, rng):
    path = tmp_path / f"3{suffix}"
    cv2.imwrite(str(path), rng.integers(0, 255, (48, 64, 3), dtype=np.uint8))
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[: len(whole) * 2 // 3], "empty": b"", "text": b"hello"}[damage])
    source = ImageFiles([path])
    assert source.read(3) is None
    assert source.read(3) is None
    assert len(source.warnings) == 1
    assert str(path) in source.warnings[0]
    assert "frame 3 counts as missing" in source.warnings[0]


HAND = np.zeros((6, 8), np.uint8)
HAND[2:4, 3:5] = 255
ALPHA = np.dstack([HAND * 0] * 3 + [HAND])


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        (HAND.astype(np.uint16) * 257, "8 bits, 0 for background and 255 for hand; found uint16"),
        (HAND // 255, "the largest value in the mask is 1."),
        (HAND // 6, "the largest value in the mask is 42."),
        (ALPHA, "alpha channel that is not opaque"),
    ],
    ids=["16 bits", "ones", "dim", "in the alpha channel"],
)
def test_what_only_looks_like_a_mask_is_refused(image, expected, tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), image)
    with pytest.raises(HandtrackError, match=expected):
        ImageFiles([tmp_path / "0.png"], MASK).read(0)
