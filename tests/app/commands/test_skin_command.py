"""`handtrack skin`, and the same on the page: one ellipse of skin colour from several images segmented by hand."""

import tomllib

import cv2
import numpy as np
import pytest

from handtrack import HandtrackError, Session
from handtrack.capture.clouds.skin_ellipse import SkinEllipse, chromaticity
from handtrack.capture.masks.mask_correction import AS_IT_IS
from handtrack.session.sources.corrected_masks import encoded
from handtrack_app.cli import main
from handtrack_app.engine import opening
from handtrack_app.engine.pictures.cloud_service import skin_in_force
from tests.app.cloudy_session import BOX, SKIN, cloudy_session

OTHER_LIGHT = (170, 70, 60)
"""skin in the second image"""


@pytest.fixture
def folder(tmp_path):
    """A session with an image of other light, whose skin lies elsewhere in it."""
    session = tmp_path / "cloudy"
    session.mkdir()
    cloudy_session(session)
    image = np.full((72, 96, 3), 90, np.uint8)
    image[5:25, 60:80] = OTHER_LIGHT[::-1]
    cv2.imwrite(str(session / "cam1" / "002.png"), image)
    return session


def painted(folder, camera, frame, box):
    x, y, width, height = box
    layer = np.full((72, 96), AS_IT_IS, np.uint8)
    layer[y : y + height, x : x + width] = 255
    view = Session.open(folder).view(camera)
    view.corrections.write(frame, encoded(layer), None)


def ellipse(folder):
    table = tomllib.loads((folder / "session.toml").read_text())["clouds"]["skin"]
    return SkinEllipse(tuple(table["mean"]), tuple(table["covariance"]), table["size"])


def holds(found, colour):
    return bool(found.distance(np.array([colour], np.uint8))[0] <= found.size)


def test_masks_of_several_images_give_one_ellipse(folder, tmp_path, capsys):
    pairs = []
    for n, (camera, frame, box) in enumerate((("cam0", 0, BOX), ("cam1", 2, (60, 5, 20, 20)))):
        mask = np.zeros((72, 96), np.uint8)
        x, y, width, height = box
        mask[y : y + height, x : x + width] = 255
        path = tmp_path / f"mask{n}.png"
        cv2.imwrite(str(path), mask)
        pairs += ["--segmented", str(folder / camera / f"{frame:03d}.png"), str(path)]
    assert main(["skin", str(folder), *pairs[:3]]) == 0
    one = ellipse(folder)
    assert holds(one, SKIN)
    assert not holds(one, OTHER_LIGHT)
    assert main(["skin", str(folder), *pairs, "--size", "3"]) == 0
    both = ellipse(folder)
    assert holds(both, SKIN)
    assert holds(both, OTHER_LIGHT)
    assert both.size == 3.0
    assert not holds(both, (120, 120, 120))
    assert "pixels of 2 images" in capsys.readouterr().out
    assert "# a comment that stays" in (folder / "session.toml").read_text()


def test_what_was_painted_is_enough(folder, capsys):
    assert main(["skin", str(folder)]) == 2
    painted(folder, "cam0", 0, BOX)
    painted(folder, "cam1", 2, (60, 5, 20, 20))
    assert main(["skin", str(folder)]) == 0
    assert "pixels of 2 images" in capsys.readouterr().out
    assert holds(ellipse(folder), OTHER_LIGHT)
    document = opening.document(opening.opened(folder))
    settings, words = skin_in_force(document, 0, "cam0", None, 2.5)
    assert settings.filters.skin == ellipse(folder)
    assert "of 2 painted images" in words


def test_a_box_is_taken_as_before(folder):
    settings, _ = skin_in_force(opening.document(opening.opened(folder)), 0, "cam0", BOX, 2.5)
    found = settings.filters.skin
    np.testing.assert_allclose(found.mean, chromaticity(np.array([SKIN]))[0][0], atol=0.02)
    with pytest.raises(HandtrackError, match="no camera 'cam9'"):
        skin_in_force(opening.document(opening.opened(folder)), 0, "cam9", BOX, 2.5)
