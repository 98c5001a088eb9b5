"""Raw mosaics → colour: the paper's rule by hand, its properties, and PSNR beside the library's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from handtrack.capture.clouds.stereo import StereoMatcher
from handtrack.capture.images.bayer import (
    METHODS,
    PATTERNS,
    demosaic,
    level_line_at,
    level_line_green,
)
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix
from tests.capture.demosaicing_quality import mosaic_of, psnr_db
from tests.capture.level_line_reference import level_line_value


@pytest.fixture(scope="module")
def pictures(data_dir):
    folder = data_dir / "rgb_truth_demosaic"
    if not folder.is_dir():
        pytest.skip(f"no {folder}")
    return {
        name: cv2.imread(str(folder / f"{name}.png")) for name in ("astronaut", "coffee", "chelsea")
    }


def test_the_paper_s_figure_7():
    """P' lies between P1 and P2, P'' between P2 and P4; the value is close to P2."""
    # a bright corner P2: gradient towards the upper right, level line along the other diagonal's side
    p1, p2, p3, p4 = 40.0, 100.0, 10.0, 60.0
    dx, dy = ((p2 - p1) + (p4 - p3)) / 2, ((p3 - p1) + (p4 - p2)) / 2
    slope = dx / -dy  # of the line (−Δy, Δx), here steeper than the square's diagonal
    x = 1 / slope
    first = p1 + (p2 - p1) * (-x + 1) / 2  # where it leaves above, y = −1
    second = p3 + (p4 - p3) * (x + 1) / 2  # and below
    assert abs(x) < 1
    assert level_line_value(p1, p2, p3, p4, 0.0, 0.0) == pytest.approx((first + second) / 2)


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


@pytest.mark.parametrize("name", ["astronaut", "coffee", "chelsea"])
def test_green_is_better_than_linear_and_than_edge_aware(pictures, name):
    """What the paper claims, and what is so: VNG, and red and blue by colour differences, are better still."""
    picture = pictures[name]
    mosaic = mosaic_of(picture, "RGGB")
    db = {method: psnr_db(demosaic(mosaic, "RGGB", method), picture) for method in METHODS}
    assert db["level_line"][1] > db["bilinear"][1] + 0.1
    assert db["level_line"][1] > db["library"][1] + 0.1
    assert db["level_line_hue"][3] > db["level_line"][3] + 1.5
    assert db["library_vng"][3] > db["level_line_hue"][3]


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


def test_rectification_reads_green_at_real_coordinates():
    """A slanting edge, read at real coordinates, keeps its level lines; cameras whose mosaics are read so are rectified so."""
    v, u = np.mgrid[:40, :40].astype(float)
    edge = np.clip(128 + 60 * (u - 0.6 * v - 8), 0, 255).astype(np.uint8)
    x, y = u[4:-4, 4:-4] + 0.37, v[4:-4, 4:-4] + 0.61
    true = np.clip(128 + 60 * (x - 0.6 * y - 8), 0, 255)
    plain = cv2.remap(edge, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR)
    found = level_line_at(edge, x, y)
    assert np.abs(found - true).mean() < 0.9 * np.abs(plain - true).mean()
    left, right = (_eye(name, centre) for name, centre in (("a", 0.0), ("b", 0.06)))
    matcher = StereoMatcher(left, right, along_level_lines=True)
    image = np.repeat(edge[..., None], 3, axis=2)
    view = matcher.match(image, image)
    x, y = matcher.pair.left_maps
    np.testing.assert_array_equal(view.left, np.round(level_line_at(image, x, y)).astype(np.uint8))


def _eye(name, centre):
    """Return a camera that is turned a little, so that rectified pixels fall between real ones."""
    turn = rotation_matrix(np.array([0.0, 0.02, 0.05]))
    matrix = np.array([[60.0, 0, 19.5], [0, 60.0, 19.5], [0, 0, 1]])
    return Camera(name, (40, 40), matrix, np.zeros(5), turn, -turn @ np.array([centre, 0.0, 0.0]))
