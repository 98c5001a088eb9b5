"""Masks of any numbers are understood or refused: never taken for what they are not."""

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.geometry.camera import Camera
from handtrack.observation.observation import Silhouette
from handtrack.observation.undistortion import undistort_silhouette

HAND = np.zeros((120, 160), bool)
HAND[30:90, 40:100] = True


def camera(distortions: list[float] | None = None) -> Camera:
    matrix = [[150.0, 0, 79.5], [0, 150, 59.5], [0, 0, 1]]
    return Camera.from_opencv(matrix, distortions, name="cam0", size=(160, 120))


@pytest.mark.parametrize(
    "mask",
    [HAND, HAND.astype(np.uint8), 255 * HAND.astype(np.uint8), HAND.astype(float), 255.0 * HAND, HAND.astype(np.int64)],
    ids=["bool", "0/1", "0/255", "float", "float 0…255", "int"],
)  # fmt: skip
def test_all_forms_of_one_mask_are_the_same(mask):
    silhouette = Silhouette(camera(), mask)
    np.testing.assert_array_equal(silhouette.mask, HAND.astype(np.float32))
    assert silhouette.mask.dtype == np.float32
    np.testing.assert_array_equal(silhouette.valid, np.tile([0, 160], (120, 1)))
    assert silhouette.known.all()


def test_grey_borders_are_shares_of_a_pixel():
    grey = np.uint8([[0, 51, 255]])
    small = Camera.from_opencv([[10, 0, 1], [0, 10, 0], [0, 0, 1]], name="c", size=(3, 1))
    np.testing.assert_allclose(Silhouette(small, grey).mask, [[0, 0.2, 1]], atol=1e-7)


def test_a_lens_is_undistorted_as_a_session_does():
    bent = camera([-0.25, 0.05, 0.001, -0.001, 0.0])
    mask = 255 * HAND.astype(np.uint8)
    here, there = Silhouette(bent, mask), undistort_silhouette(bent, mask)
    np.testing.assert_array_equal(here.mask, there.mask)
    np.testing.assert_array_equal(here.valid, there.valid)
    assert here.camera is there.camera
    assert not here.camera.is_distorted


@pytest.mark.parametrize(
    ("mask", "words"),
    [
        (3 * HAND.astype(np.uint8), "its highest value is 3.*Labels are no mask"),
        (1000 * HAND.astype(np.uint16), "its highest value is 1000"),
        (HAND - 0.5, r"its lowest value is -0\.5"),
        (HAND.T, r"\(160, 120\), expected \(120, 160\).*give `mask\.T`"),
        (np.zeros((120, 160, 3), np.uint8), r"one channel: `mask\[\.\.\., 0\]`"),
        (HAND[::2, ::2], "Scale the camera to the mask"),
        (HAND.astype(str), "expected booleans or numbers"),
    ],
)
def test_what_is_no_mask_is_refused(mask, words):
    with pytest.raises(HandtrackError, match=f"^mask of camera 'cam0': .*{words}"):
        Silhouette(camera(), mask)
