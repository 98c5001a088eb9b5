"""Raw mosaics → colour: the paper's rule by hand, its properties, and PSNR beside the library's."""

import numpy as np
import pytest

from handtrack.capture.images.bayer import (
    METHODS,
    PATTERNS,
    demosaic,
    level_line_at,
    level_line_green,
)
from tests.capture.demosaicing_quality import mosaic_of
from tests.capture.level_line_reference import level_line_value


def test_the_closed_form_is_the_paper_s_rule(rng):
    """At a pixel without green, from its four neighbours: left, above, below, right."""
    mosaic = rng.integers(0, 4095, (20, 26)).astype(float)
    green = level_line_green(mosaic, "RGGB")
    for row, column in ((2, 2), (3, 5), (10, 12), (17, 23)):  # red or blue
        around = (
            mosaic[row, column - 1],
            mosaic[row - 1, column],
            mosaic[row + 1, column],
            mosaic[row, column + 1],
        )
        assert green[row, column] == pytest.approx(float(level_line_value(*around, 0.0, 0.0)))


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


def test_at_any_place_it_is_the_paper_s_rule(rng):
    image = rng.integers(0, 255, (12, 15)).astype(np.uint8)
    image[:4, :4] = 90  # flat: no line is the level line
    x, y = rng.uniform(0, 14, (5, 40)), rng.uniform(0, 11, (5, 40))
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    corners = [
        image[row + b, column + a].astype(float) for b, a in ((0, 0), (0, 1), (1, 0), (1, 1))
    ]
    expected = level_line_value(*corners, 2 * (x - column) - 1, 2 * (y - row) - 1)
    np.testing.assert_allclose(level_line_at(image, x, y), expected, atol=1e-9)
    colour = np.stack([image, 255 - image, image // 2], axis=-1)
    each = np.stack([level_line_at(colour[..., c], x, y) for c in range(3)], axis=-1)
    np.testing.assert_array_equal(level_line_at(colour, x, y), each)
