"""Frames: numbered files, videos, raw mosaics, and images that are cut off."""

import struct

import cv2
import numpy as np
import pytest

import handtrack.capture.images.video as video_module
from handtrack import HandtrackError
from handtrack.capture.images.frames import DEPTH, MASK, ImageFiles, frame_number
from handtrack.capture.images.raw_frames import (
    METHODS,
    PATTERNS,
    MosaicFiles,
    demosaic,
    level_line_at,
    level_line_green,
)
from handtrack.capture.images.video import VideoFile
from tests.capture.mosaics import mosaic_of
from tests.capture.sample_files import filmed
from tests.conftest import refused


def written(folder, images):
    for name, image in images.items():
        cv2.imwrite(str(folder / name), image)
    return [folder / name for name in images]


def picture(value):
    return np.full((48, 64), value, np.uint8)


@pytest.mark.parametrize(
    ("name", "frame"),
    [("000018.png", 18), ("cam1_frame_7.png", 7), ("2024-03-01_12.png", 12), ("a9b10c.jp2", 10)],
)
def test_the_frame_is_the_last_group_of_digits(name, frame):
    assert frame_number(name) == frame
    with pytest.raises(HandtrackError):
        frame_number("1700000000.040000.png")


def test_gaps_are_misses_and_shift_nothing(tmp_path):
    files = written(tmp_path, {f"f{n}.png": picture(200 + n) for n in (2, 10, 3)})
    source = ImageFiles(files, MASK)
    assert source.frames == range(11)
    assert [frame for frame in source.frames if source.has(frame)] == [2, 3, 10]
    assert source.size == (64, 48)
    assert (source.read(10) == 210).all()
    assert source.read(4) is None
    assert source.read(99) is None
    assert source.warnings == ()


def test_kinds_have_their_shapes(tmp_path):
    paths = written(tmp_path, {"5.png": picture(205)})
    colour, mask = ImageFiles(paths).read(5), ImageFiles(paths, MASK).read(5)
    assert colour.shape == (48, 64, 3)
    assert mask.shape == (48, 64)
    deep = written(tmp_path, {"d1.png": np.full((48, 64), 40000, np.uint16)})
    depth = ImageFiles(deep, DEPTH).read(1)
    assert depth.dtype == np.uint16
    assert (depth == 40000).all()
    with pytest.raises(HandtrackError, match="uint8"):
        ImageFiles(paths, DEPTH).read(5)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("damage", ["cut", "empty", "text"])
def test_unreadable_files_are_misses_with_a_warning(suffix, damage, tmp_path, rng):
    noise = rng.integers(0, 255, (48, 64, 3), dtype=np.uint8)
    (path,) = written(tmp_path, {f"3{suffix}": noise})
    whole = path.read_bytes()
    path.write_bytes({"cut": whole[: len(whole) * 2 // 3], "empty": b"", "text": b"hello"}[damage])
    source = ImageFiles([path])
    assert source.read(3) is source.read(3) is None
    (said,) = source.warnings
    assert str(path) in said and "frame 3" in said


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
)
def test_what_only_looks_like_a_mask_is_refused(image, expected, tmp_path):
    with pytest.raises(HandtrackError, match=expected):
        ImageFiles(written(tmp_path, {"0.png": image}), MASK).read(0)


FRAMES = 90


def striped(frame):
    """The frame's number as eight black and white stripes, which no codec can blur away."""
    bits = [(frame >> bit) & 1 for bit in range(8)]
    stripes = np.repeat(np.array(bits, np.uint8) * 255, 8)
    return np.broadcast_to(stripes[None, :, None], (48, 64, 3)).copy()


@pytest.fixture
def clip(tmp_path):
    """A video whose stripes tell its frame."""
    return filmed(tmp_path / "clip.avi", map(striped, range(FRAMES)))


def shown(source, frame):
    image = source.read(frame)
    bright = image.mean(axis=(0, 2)).reshape(8, 8).mean(axis=1) > 128
    return sum(1 << bit for bit in range(8) if bright[bit])


@pytest.fixture
def source(clip, monkeypatch):
    """A video of which nothing is kept but places to begin at."""
    monkeypatch.setattr(video_module, "_CACHE_BYTES", 0)
    monkeypatch.setattr(video_module, "_CHECKPOINT_EVERY", 10)
    return VideoFile(clip)


def test_any_order_gives_the_frame_that_was_asked_for(source, rng):
    assert source.frames == range(FRAMES)
    frames = [*range(30), *range(80, 40, -1), *rng.integers(0, FRAMES, 60).tolist()]
    assert [shown(source, frame) for frame in frames] == frames


def test_a_seek_that_arrives_elsewhere_is_noticed(source):
    assert source.frames
    source._checkpoints = {at: (ms, one ^ 1) for at, (ms, one) in source._checkpoints.items()}
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
    (said,) = source.warnings
    assert f"{FRAMES} frames" in said and f"only {count}" in said


@pytest.mark.parametrize(
    ("turn", "cos", "sin", "size", "corner"),
    [(90, 0, 1, (48, 64), [0, 24]), (180, -1, 0, (64, 48), [24, 32]), (270, 0, -1, (48, 64), [32, 0])],
)  # fmt: skip
def test_c12_a_video_that_asks_to_be_turned_is_and_it_is_said(
    turn, cos, sin, size, corner, tmp_path
):
    path = tmp_path / "portrait.mp4"
    picture = np.zeros((48, 64, 3), np.uint8)
    picture[:24, :32] = 255
    filmed(path, [picture] * 3, "mp4v")
    assert VideoFile(path).warnings == ()
    data = bytearray(path.read_bytes())
    matrix = (
        np.array([cos, sin, 0, -sin, cos, 0, 0, 0, 1 << 14]) << 16
    )  # of 16 bits behind the point, the last of 30
    struct.pack_into(">9i", data, data.index(b"tkhd") + 44, *matrix)
    path.write_bytes(data)
    source = VideoFile(path, size)
    assert np.argwhere(source.read(0).mean(axis=2) > 128).min(axis=0).tolist() == corner
    assert len(source.warnings) == 1 and f"{turn}°" in source.warnings[0]


def raw_picture(level=1.0):
    """(48, 64, 3) uint8 BGR: smooth ramps, another one in each colour."""
    v, u = np.mgrid[:48, :64] / 64.0
    channels = [60 + 120 * u, 200 - 90 * v, 40 + 80 * (u + v)]
    return (level * np.stack(channels, axis=-1)).astype(np.uint8)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_eight_bits_come_back_in_colour(pattern, tmp_path):
    files = written(tmp_path, {"0.png": mosaic_of(raw_picture(), pattern)})
    source = MosaicFiles(files, pattern)
    off = source.read(0)[4:-4, 4:-4].astype(int) - raw_picture()[4:-4, 4:-4]
    assert np.abs(off).max() <= 3
    assert source.size == (64, 48)
    assert source.warnings == ()


def test_sixteen_bits_have_one_white_level_for_all_frames(tmp_path):
    """Twelve bits in sixteen; the second frame is half as bright, and stays so."""
    full, half = (mosaic_of(raw_picture(n), "RGGB").astype(np.uint16) * 16 for n in (1.0, 0.5))
    files = written(tmp_path, {"0.png": full, "1.png": half})
    bright, dark = (MosaicFiles(files, "RGGB").read(frame) for frame in (0, 1))
    assert bright.dtype == np.uint8
    assert 250 <= bright.max() <= 255
    assert bright.mean() / dark.mean() == pytest.approx(2.0, rel=0.03)
    backwards = MosaicFiles(files, "RGGB")
    assert np.array_equal(backwards.read(1), dark)  # whatever is read first


KINDS = ".png .jpg .bmp .tif .webp .ppm .pgm .jp2"


@pytest.mark.parametrize("kind", KINDS.split())
def test_c15_an_image_larger_than_its_camera_is_not_unpacked(kind, tmp_path, monkeypatch, rng):
    noise = rng.integers(0, 255, (200, 300) if kind == ".pgm" else (200, 300, 3), np.uint8)
    files = ImageFiles(written(tmp_path, {f"0{kind}": noise}), expected_size=(299, 200))
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was unpacked"))
    refused("300 x 200.*299 x 200", files.read, 0)


def test_green_is_found_by_the_rule_for_any_place(rng):
    """At a pixel without green, from its four neighbours: left, above, below, right."""
    mosaic = rng.integers(0, 4095, (20, 26)).astype(float)
    green = level_line_green(mosaic, "RGGB")
    for row, column in ((2, 2), (3, 5), (10, 12), (17, 23)):  # red or blue
        around = [mosaic[row + v, column + u] for v, u in ((0, -1), (-1, 0), (1, 0), (0, 1))]
        middle = level_line_at(np.reshape(around, (2, 2)), *np.full((2, 1), 0.5))
        assert green[row, column] == pytest.approx(middle[0])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_picture_stays_where_it_was(pattern, method):
    """OpenCV's VNG moves the picture down by two rows before 4.12; that would spoil a calibration."""
    image = np.full((40, 44, 3), 40, np.uint8)
    image[17:, 23:] = 180
    off = np.abs(demosaic(mosaic_of(image, pattern), pattern, method).astype(int) - image).max(
        axis=2
    )
    far = np.ones((40, 44), dtype=bool)
    far[15:19, 21:] = far[15:, 21:25] = False
    assert off[far].max() <= 1


# a square's corners 0 1 / 2 7; its gradient is (6, 8), so the level line through (¼, ½) goes from 1.375 at (0, 11/16) to 11/12 at
# (11/12, 0), of which the point is 3/11 away from the first
SQUARE = [[0, 1], [2, 7]]


@pytest.mark.parametrize(
    ("square", "x", "y", "value"),
    [
        (SQUARE, 0.25, 0.5, 1.25),
        (SQUARE, 0.5, 0.25, 1.0),
        (SQUARE, 1.0, 0.5, 4.0),
        (SQUARE, 0.5, 1.0, 4.5),
        ([[90, 90], [90, 90]], 0.3, 0.6, 90.0),
        ([[0, 10], [20, 30]], 0.3, 0.6, 15.0),
    ],
    ids=["inside", "across the other corner", "right side", "lower side", "flat", "slope"],
)
def test_at_any_place_it_is_the_paper_s_rule(square, x, y, value):
    """The level line through a point is cut with the sides, both ends are interpolated there, and the point between the ends."""
    image = np.zeros((4, 5, 2))
    image[1:3, 2:4, 0], image[1:3, 2:4, 1] = square, np.subtract(100, square)
    found = level_line_at(image, np.array([2.0 + x]), np.array([1.0 + y]))
    np.testing.assert_allclose(found, [[value, 100 - value]], atol=1e-9)
