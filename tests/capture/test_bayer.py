"""Raw mosaics → colour: the paper's rule by hand, its properties, and PSNR beside the library's."""

from __future__ import annotations

import re

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
    mosaic_doubts,
)
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import rotation_matrix
from tests.capture.demosaicing_quality import mosaic_of, psnr_db, psnr_table
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


def test_an_edge_is_followed_not_averaged():
    """A vertical edge through a pixel without green: its value is that of the pixels above and below."""
    mosaic = np.tile(np.array([0, 0, 0, 70, 200, 200, 200, 200.0]), (8, 1))
    green = level_line_green(mosaic, "RGGB")
    assert np.allclose(green[2:-2], mosaic[2:-2])


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_slope_is_reproduced(pattern):
    v, u = np.mgrid[:20, :24].astype(float)
    slope = 3 * u - 2 * v + 100
    assert np.allclose(level_line_green(slope, pattern)[1:-1, 1:-1], slope[1:-1, 1:-1])


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


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("bits", [8, 16])
def test_flat_colours_come_back(pattern, method, bits):
    dtype, factor = (np.uint8, 1) if bits == 8 else (np.uint16, 200)
    image = np.empty((24, 31, 3), dtype)  # an odd width
    image[:] = np.array([40, 90, 200]) * factor
    if method == "library_vng" and bits == 16:
        with pytest.raises(HandtrackError, match="library_vng takes 8 bits a pixel"):
            demosaic(mosaic_of(image, pattern), pattern, method)
        return
    found = demosaic(mosaic_of(image, pattern), pattern, method)
    assert found.dtype == dtype
    assert np.abs(found.astype(int) - image)[3:-3, 3:-3].max() <= 1


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


def test_wrong_patterns_and_other_images_are_noticed(pictures):
    for picture in pictures.values():
        mosaic = mosaic_of(picture, "RGGB")
        assert mosaic_doubts(mosaic, "RGGB") == ()
        (text,) = mosaic_doubts(mosaic, "GRBG")
        assert (
            "the pattern GRBG looks wrong: the green pixels seem to lie as in RGGB or BGGR" in text
        )
        (text,) = mosaic_doubts(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), "RGGB")
        assert "the image may be no mosaic (grey, or colour made grey)" in text


@pytest.mark.parametrize(
    ("mosaic", "pattern", "message"),
    [
        (
            np.zeros((8, 8), np.uint8),
            "RGB",
            "no Bayer pattern 'RGB'; known: RGGB, BGGR, GRBG, GBRG",
        ),
        (
            np.zeros((8, 8, 3), np.uint8),
            "RGGB",
            "a raw mosaic has one channel; found an image of shape (8, 8, 3)",
        ),
        (np.zeros((8, 8)), "RGGB", "8 or 16 bits a pixel; found float64"),
        (np.zeros((2, 8), np.uint8), "RGGB", "at least 4 x 4 pixels; found shape (2, 8)"),
    ],
)
def test_what_is_no_mosaic_is_refused(mosaic, pattern, message):
    with pytest.raises(HandtrackError, match=re.escape(message)):
        demosaic(mosaic, pattern)


def test_an_unknown_method_names_the_known_ones():
    with pytest.raises(
        HandtrackError, match="no method 'magic'; known: library, library_vng, bilinear, level_line"
    ):
        demosaic(np.zeros((8, 8), np.uint8), "RGGB", "magic")


def test_the_table_has_a_row_a_method(rng):
    truth = cv2.GaussianBlur(rng.integers(0, 255, (40, 40, 3)).astype(np.uint8), (0, 0), 2)
    rows = psnr_table({"noise": truth}).splitlines()
    assert rows[0] == "| method | noise: green | all |"
    assert [row.split("`")[1] for row in rows[2:]] == list(METHODS)


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


def test_pixels_stay_and_the_border_is_repeated(rng):
    image = rng.integers(0, 255, (6, 7)).astype(np.uint8)
    v, u = np.mgrid[:6, :7].astype(float)
    np.testing.assert_allclose(level_line_at(image, u, v), image)
    outside = level_line_at(image, np.array([[-5.0, 99.0]]), np.array([[-5.0, 99.0]]))
    np.testing.assert_allclose(outside, [[image[0, 0], image[-1, -1]]])


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
