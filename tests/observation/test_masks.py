"""Masks as they are handed over: any numbers, a lens, agreement between cameras."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from handtrack import Silhouette
from handtrack.observation.agreement import outline_errors_px, suspected
from handtrack.observation.lens_maps import longest_runs
from handtrack.observation.observation import UNKNOWN, undistort_image, undistort_silhouette
from tests.cameras import pinhole
from tests.conftest import refused

HAND = np.zeros((120, 160), bool)
HAND[30:90, 40:100] = True


BARREL = np.array([-0.25, 0.05, 0.001, -0.001, 0.0])
PINCUSHION = np.array([0.3, 0.0, 0.0, 0.0, 0.0])


def camera(distortions=np.zeros(5)):
    return pinhole("cam0", (160, 120), 150, lens=distortions)


@pytest.mark.parametrize(
    "mask",
    [HAND, HAND.astype(np.uint8), 255 * HAND.astype(np.uint8), HAND.astype(float), 255.0 * HAND, HAND.astype(np.int64)],
    ids=["bool", "0/1", "0/255", "float", "float 0…255", "int"],
)  # fmt: skip
def test_all_forms_of_one_mask_are_the_same(mask):
    silhouette = Silhouette(camera(), mask)
    assert_array_equal(silhouette.mask, HAND.astype(np.float32))
    assert silhouette.mask.dtype == np.float32
    assert_array_equal(silhouette.valid, np.tile([0, 160], (120, 1)))
    assert silhouette.known.all()


def test_grey_borders_are_shares_of_a_pixel():
    found = Silhouette(pinhole("c", (3, 1), 10), np.uint8([[0, 51, 255]])).mask
    assert_allclose(found, [[0, 0.2, 1]], atol=1e-7)


def test_a_lens_is_undistorted_as_a_session_does():
    bent = camera(BARREL)
    mask = 255 * HAND.astype(np.uint8)
    here, there = Silhouette(bent, mask), undistort_silhouette(bent, mask)
    assert_array_equal(here.mask, there.mask)
    assert_array_equal(here.valid, there.valid)
    assert here.camera is there.camera
    assert not here.camera.is_distorted


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (2 * HAND.astype(np.uint8), "its highest value is 2.*Labels are no mask"),
        (1000 * HAND.astype(np.uint16), "its highest value is 1000"),
        (HAND - 0.5, r"its lowest value is -0\.5"),
        (HAND.T, r"\(160, 120\), expected \(120, 160\).*give `mask\.T`"),
        (np.zeros((120, 160, 3), np.uint8), r"one channel: `mask\[\.\.\., 0\]`"),
        (HAND[::2, ::2], "Scale the camera to the mask"),
        (HAND.astype(str), "expected booleans or numbers"),
    ],
)
def test_what_is_no_mask_is_refused(mask, words):
    refused(f"^mask of camera 'cam0': .*{words}", Silhouette, camera(), mask)


@pytest.mark.parametrize("distortions", [np.zeros(5), BARREL], ids=["flat", "barrel"])
def test_what_nobody_knows_stays_unknown(distortions):
    """And so does each undistorted pixel to which one such adds; the others are as without it."""
    columns, rows = np.meshgrid(np.arange(160), np.arange(120))
    mask = np.where(columns < 80, 255, 0).astype(np.uint8)
    known = undistort_silhouette(camera(distortions), mask)
    ring = np.abs(np.hypot(columns - 80, rows - 60) - 30) < 3
    seen = undistort_silhouette(camera(distortions), np.where(ring, 128, mask), None, 128)
    unknown = seen.mask < 0
    assert (seen.mask[unknown] == UNKNOWN).all()
    assert ring.sum() <= unknown.sum() < 1.6 * ring.sum()
    assert_array_equal(seen.mask[~unknown], known.mask[~unknown])
    assert_array_equal(seen.known, ~unknown & known.known)


def test_a_region_of_interest_limits_what_is_valid():
    valid = undistort_silhouette(camera(), np.zeros((120, 160), np.uint8), (30, 20, 50, 40)).valid
    assert (valid[20:60] == (30, 80)).all()
    assert (valid[:20] == 0).all()
    assert (valid[60:] == 0).all()


@pytest.mark.parametrize("distortions", [BARREL, PINCUSHION], ids=["barrel", "pincushion"])
def test_a_disc_lands_where_its_points_project(distortions):
    bent = camera(distortions)
    columns, rows = np.meshgrid(np.arange(160), np.arange(120))
    straight = bent.undistort_points(np.stack([columns, rows], -1).astype(float))
    mask = np.where(np.hypot(*(straight - (110, 40)).T).T < 15, 255, 0).astype(np.uint8)
    silhouette = undistort_silhouette(bent, mask)
    distance = np.hypot(columns - 110, rows - 40)
    assert (silhouette.mask[distance < 13] == 1).all()
    assert (silhouette.mask[distance > 17] == 0).all()
    assert silhouette.mask.sum() == pytest.approx(np.pi * 15**2, rel=0.01)
    assert not silhouette.camera.is_distorted


def test_longest_runs_of_rows():
    rows = ["..###.##", "........", ".......#"]
    inside = np.array([[sign == "#" for sign in row] for row in rows])
    assert longest_runs(inside).tolist() == [[2, 5], [0, 0], [7, 8]]


def test_an_image_is_straightened_as_a_mask_is(rng):
    bent = camera(BARREL)
    grey = np.where(rng.random((30, 40)) < 0.5, 255, 0).astype(np.uint8).repeat(4, 0).repeat(4, 1)
    view = undistort_image(bent, np.repeat(grey[..., None], 3, axis=2))
    silhouette = undistort_silhouette(bent, grey)
    assert view.pixels.dtype == np.uint8
    assert_allclose(view.pixels[..., 1] / 255.0, silhouette.mask, atol=0.01)
    assert not view.camera.is_distorted
    # the same one for every frame
    assert view.camera is undistort_image(bent, view.pixels).camera


SIZE = (200, 160)
BALL_M = 0.04


def ball_from(degrees):
    """Return a ball's silhouette by a camera around it, half a metre away."""
    turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    camera = pinhole(f"cam{degrees}", SIZE, 300, turn, (0, 0, 0.5), at=(100, 80))
    u, v = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    away = np.hypot(u - 100, v - 80)
    mask = (away < 300 * BALL_M / 0.5).astype(np.float32)
    mask[(away > 40) & (v > 140)] = UNKNOWN
    return Silhouette(camera, mask, np.tile(np.int32([0, SIZE[0]]), (SIZE[1], 1)))


def test_one_body_agrees_with_itself():
    assert_allclose(outline_errors_px([ball_from(0), ball_from(50)]), 0, atol=0.3)
    assert outline_errors_px([ball_from(0)]).tolist() == [0]


def test_what_two_cannot_tell_a_third_does():
    good, bad = ball_from(50), ball_from(0)
    bad.mask[20:56, 90:110] = 1.0  # above the ball
    added = (bad.mask > 0.5).sum() - (ball_from(0).mask > 0.5).sum()
    two = outline_errors_px([bad, good])
    assert two[0] == pytest.approx(two[1])
    # half of the added area by the outline's length, each: nobody knows who is wrong
    assert two[0] == pytest.approx(added / 2 / (2 * np.pi * 24 + 50), rel=0.3)
    three = outline_errors_px([bad, good, ball_from(-40)])
    assert three[0] == pytest.approx(two[0], rel=0.3)
    assert three[1:].max() < 0.3


def test_one_mask_of_four_that_shows_something_else_is_told_from_the_others():
    ball, speck = ball_from(0), np.zeros(SIZE[::-1], np.float32)
    speck[10:25, 80:100] = 1.0
    shadow, others = replace(ball, mask=speck), [ball_from(degrees) for degrees in (60, 120, -60)]
    assert suspected((shadow, *others)) == suspected((*others, shadow)) == [shadow]
    assert suspected((ball, *others)) == []
    assert suspected((shadow, others[0])) == []  # of two nobody knows which is wrong
