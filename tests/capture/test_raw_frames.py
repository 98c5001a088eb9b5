"""Raw mosaics in files as colour images: 8 and 16 bits, one white level for all frames, doubts said."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.capture.images.bayer import PATTERNS
from handtrack.capture.images.raw_frames import MosaicFiles, MosaicSettings
from tests.capture.demosaicing_quality import mosaic_of


def picture(level: float = 1.0) -> np.ndarray:
    """(48, 64, 3) uint8 BGR: smooth ramps, another one in each colour."""
    v, u = np.mgrid[:48, :64] / 64.0
    channels = [60 + 120 * u, 200 - 90 * v, 40 + 80 * (u + v)]
    return (level * np.stack(channels, axis=-1)).astype(np.uint8)


def written(folder: Path, images: list[np.ndarray]) -> list[Path]:
    for frame, image in enumerate(images):
        cv2.imwrite(str(folder / f"{frame:03d}.png"), image)
    return sorted(folder.glob("*.png"))


@pytest.mark.parametrize("pattern", PATTERNS)
def test_eight_bits_come_back_in_colour(pattern, tmp_path):
    source = MosaicFiles(
        written(tmp_path, [mosaic_of(picture(), pattern)]), MosaicSettings(pattern)
    )
    off = source.read(0)[4:-4, 4:-4].astype(int) - picture()[4:-4, 4:-4]
    assert np.abs(off).max() <= 3
    assert source.size == (64, 48)
    assert source.warnings == ()


def test_sixteen_bits_have_one_white_level_for_all_frames(tmp_path):
    """Twelve bits in sixteen; the second frame is half as bright, and stays so."""
    images = [mosaic_of(picture(level), "RGGB").astype(np.uint16) * 16 for level in (1.0, 0.5)]
    files = written(tmp_path, images)
    bright, dark = (MosaicFiles(files, MosaicSettings("RGGB")).read(frame) for frame in (0, 1))
    assert bright.dtype == np.uint8
    assert 250 <= bright.max() <= 255
    assert bright.mean() / dark.mean() == pytest.approx(2.0, rel=0.03)
    backwards = MosaicFiles(files, MosaicSettings("RGGB"))
    assert np.array_equal(backwards.read(1), dark)  # whatever is read first
