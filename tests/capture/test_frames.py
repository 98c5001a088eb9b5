"""Numbered image files: numbers, gaps, kinds, damage."""

from __future__ import annotations

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
def test_the_frame_is_the_last_group_of_digits(name: str, frame: int) -> None:
    assert frame_number(name) == frame


def test_gaps_are_misses_and_shift_nothing(tmp_path: Path) -> None:
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


def test_kinds_have_their_shapes(tmp_path: Path) -> None:
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
def test_unreadable_files_are_misses_with_a_warning(
    suffix: str, damage: str, tmp_path: Path, rng: np.random.Generator
) -> None:
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


def jpeg_to_be_turned(orientation: int) -> bytes:
    """A picture, wider than high, whose EXIF data ask for it to be turned."""
    image = np.random.default_rng(1).integers(0, 255, (6, 8, 3), dtype=np.uint8)
    coded = cv2.imencode(".jpg", image)[1].tobytes()
    exif = (
        b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0"
        + bytes([orientation])
        + b"\0" * 6
    )
    return coded[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + coded[2:]


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
def test_what_only_looks_like_a_mask_is_refused(
    image: np.ndarray, expected: str, tmp_path: Path
) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), image)
    with pytest.raises(HandtrackError, match=expected):
        ImageFiles([tmp_path / "0.png"], MASK).read(0)


@pytest.mark.parametrize(
    "image",
    [np.dstack([HAND] * 3), np.dstack([HAND] * 3 + [HAND | 255]), HAND * 0],
    ids=["colour", "opaque", "empty"],
)
def test_masks_in_other_forms(image: np.ndarray, tmp_path: Path) -> None:
    """Fault C13."""
    cv2.imwrite(str(tmp_path / "0.png"), image)
    mask = ImageFiles([tmp_path / "0.png"], MASK).read(0)
    assert np.array_equal(mask, HAND * bool(image[..., 0].any() if image.ndim == 3 else 0))


@pytest.mark.parametrize(("orientation", "size"), [(1, (8, 6)), (3, (8, 6)), (6, (6, 8))])
def test_an_image_that_asks_to_be_turned_is_and_it_is_said(
    orientation: int, size, tmp_path: Path
) -> None:
    """Fault C12."""
    path = tmp_path / "0.jpg"
    path.write_bytes(jpeg_to_be_turned(orientation))
    source = ImageFiles([path])
    assert source.size == size
    assert ["EXIF orientation" in text for text in source.warnings] == [True] * (orientation > 1)
    if size == (6, 8):
        with pytest.raises(
            HandtrackError, match=r"Its sides are exchanged: .* \(EXIF orientation\)"
        ):
            ImageFiles([path], expected_size=(8, 6)).read(0)


def test_ten_bits_in_sixteen_are_said(tmp_path: Path) -> None:
    """Fault C13."""
    for frame, most in enumerate((1023, 65535)):
        cv2.imwrite(str(tmp_path / f"{frame}.png"), np.full((6, 8, 3), most, np.uint16))
    (text,) = dim_notes(tmp_path / "0.png")
    assert "16 bits whose largest value is 1023" in text
    assert dim_notes(tmp_path / "1.png") == ()


def dim_notes(path: Path) -> tuple[str, ...]:
    source = ImageFiles([path])
    assert source.read(frame_number(path.name)) is not None
    return source.warnings


def test_a_jpeg_called_png_is_read(tmp_path: Path) -> None:
    (tmp_path / "0.png").write_bytes(jpeg_to_be_turned(1))
    assert ImageFiles([tmp_path / "0.png"]).size == (8, 6)


def test_many_damaged_files_are_one_sentence(tmp_path: Path) -> None:
    paths = folder_of(tmp_path, [f"{frame:03d}.png" for frame in range(9)])
    for path in paths[2:8]:
        path.write_bytes(b"")
    source = ImageFiles(paths)
    assert sum(source.read(frame) is None for frame in range(9)) == 6
    assert source.warnings == (
        f"{paths[2]}: the file is empty; frame 2 counts as missing. The same in 5 more frames: 3-7.",
    )


def test_a_time_is_no_frame_number(tmp_path: Path) -> None:
    with pytest.raises(HandtrackError, match=r"1699999999\.png: 1699999999 is no frame number"):
        ImageFiles([tmp_path / "1699999999.png"])


def test_two_files_of_one_frame_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        HandtrackError, match=r"'007.png' and '7.png' are both frame 7; expected one"
    ):
        ImageFiles(folder_of(tmp_path, ["7.png", "007.png"]))


def test_names_without_digits_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        HandtrackError, match=r"first.png: no digits in the file name; expected the"
    ):
        ImageFiles([tmp_path / "first.png"])


def test_another_size_than_the_calibrations_is_refused(tmp_path: Path) -> None:
    source = ImageFiles(folder_of(tmp_path, ["1.png"]), expected_size=(640, 480))
    with pytest.raises(
        HandtrackError, match=r"frame 1: the image is 64 x 48, .* calibrated for 640 x 480"
    ):
        source.read(1)
