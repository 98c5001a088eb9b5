"""Silhouettes in the undistorted image: coverage, valid spans, region of interest."""

import numpy as np
import pytest

from handtrack.arrays import Array
from handtrack.geometry.camera import Camera
from handtrack.observation.lens_maps import longest_runs
from handtrack.observation.observation import UNKNOWN
from handtrack.observation.undistortion import undistort_image, undistort_silhouette

BARREL = np.array([-0.25, 0.05, 0.001, -0.001, 0.0])
PINCUSHION = np.array([0.3, 0.0, 0.0, 0.0, 0.0])


def make(distortions: Array | None = None) -> Camera:
    matrix = np.array([[150.0, 0, 79.5], [0, 150, 59.5], [0, 0, 1]])
    flat = np.zeros(5) if distortions is None else distortions
    return Camera("cam0", (160, 120), matrix, flat, np.eye(3), np.zeros(3))


@pytest.mark.parametrize("distortions", [None, BARREL], ids=["flat", "barrel"])
def test_what_nobody_knows_stays_unknown(distortions):
    """And so does each undistorted pixel to which one such adds; the others are as without it."""
    columns, rows = np.meshgrid(np.arange(160), np.arange(120))
    mask = np.where(columns < 80, 255, 0).astype(np.uint8)
    known = undistort_silhouette(make(distortions), mask)
    ring = np.abs(np.hypot(columns - 80, rows - 60) - 30) < 3
    seen = undistort_silhouette(make(distortions), np.where(ring, 128, mask), None, 128)
    unknown = seen.mask < 0
    assert (seen.mask[unknown] == UNKNOWN).all()
    assert ring.sum() <= unknown.sum() < 1.6 * ring.sum()
    np.testing.assert_array_equal(seen.mask[~unknown], known.mask[~unknown])
    np.testing.assert_array_equal(seen.known, ~unknown & known.known)


def test_a_region_of_interest_limits_what_is_valid():
    valid = undistort_silhouette(make(), np.zeros((120, 160), np.uint8), (30, 20, 50, 40)).valid
    assert (valid[20:60] == (30, 80)).all()
    assert (valid[:20] == 0).all()
    assert (valid[60:] == 0).all()


@pytest.mark.parametrize("distortions", [BARREL, PINCUSHION], ids=["barrel", "pincushion"])
def test_a_disc_lands_where_its_points_project(distortions):
    camera = make(distortions)
    columns, rows = np.meshgrid(np.arange(160), np.arange(120))
    straight = camera.undistort_points(np.stack([columns, rows], -1).astype(float))
    mask = np.where(np.hypot(*(straight - (110, 40)).T).T < 15, 255, 0).astype(np.uint8)
    silhouette = undistort_silhouette(camera, mask)
    distance = np.hypot(columns - 110, rows - 40)
    assert (silhouette.mask[distance < 13] == 1).all()
    assert (silhouette.mask[distance > 17] == 0).all()
    assert silhouette.mask.sum() == pytest.approx(np.pi * 15**2, rel=0.01)
    assert not silhouette.camera.is_distorted
    assert silhouette.camera.size == camera.size


def test_longest_runs_of_rows():
    rows = ["..###.##", "########", "........", "##.##...", ".......#"]
    inside = np.array([[sign == "#" for sign in row] for row in rows])
    expected = [[2, 5], [0, 8], [0, 0], [0, 2], [7, 8]]
    np.testing.assert_array_equal(longest_runs(inside), expected)


def test_an_image_is_straightened_as_a_mask_is(rng):
    camera = make(BARREL)
    grey = np.where(rng.random((30, 40)) < 0.5, 255, 0).astype(np.uint8).repeat(4, 0).repeat(4, 1)
    view = undistort_image(camera, np.repeat(grey[..., None], 3, axis=2))
    silhouette = undistort_silhouette(camera, grey)
    assert view.pixels.dtype == np.uint8
    np.testing.assert_allclose(view.pixels[..., 1] / 255.0, silhouette.mask, atol=0.01)
    assert not view.camera.is_distorted
    # the same one for every frame
    assert view.camera is undistort_image(camera, view.pixels).camera
