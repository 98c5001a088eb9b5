"""Images that are the calibration's scaled: refused with the line to write, and then seen by a calibration scaled likewise."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from handtrack.session.session import Session
from tests.capture.test_synchrony import camera
from tests.session.small_session import edit, make_session
from tests.session.test_bad_sessions import contains, refusal


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Of the second camera half as large masks as it is calibrated for."""
    folder = make_session(tmp_path)
    mask = np.zeros((24, 32), np.uint8)
    mask[3:22, 9:24] = 255
    for frame in range(4):
        cv2.imwrite(str(folder / f"masks/cam1/{frame:03d}.png"), mask)
    return folder


def test_c11_the_line_to_write_is_said_and_does_it(folder):
    contains(
        refusal(folder), "32 x 24", "calibrated for 64 x 48", "0.5 times", "image_size = [32, 24]"
    )
    edit(folder / "session.toml", 'name = "cam1"', 'name = "cam1"\nimage_size = [32, 24]')
    session = Session.open(folder)
    assert session.rig["cam1"].size == (32, 24)
    assert session.rig["cam1"].matrix.tolist() == [[40, 0, 15.5], [0, 40, 11.5], [0, 0, 1]]
    assert session.rig["cam0"].size == (64, 48)
    assert [s.mask.shape for s in session.observation(0).silhouettes] == [(48, 64), (24, 32)]


def test_c11_pixels_of_a_scaled_camera_are_where_resized_images_have_them(
    rng,
):
    """Averaging blocks of 4 pixels puts what covered them at their middle."""
    large = camera("a", 0.3)
    small = large.scaled((large.size[0] // 4, large.size[1] // 4))
    points = rng.uniform(-0.05, 0.05, (9, 3))
    block = (large.project(points) - 1.5) / 4
    assert np.allclose(small.project(points), block, atol=1e-9)
