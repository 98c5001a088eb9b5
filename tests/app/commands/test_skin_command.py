"""`handtrack skin`, and the same on the page: one ellipse of skin colour from several images segmented by hand."""

import cv2
import numpy as np
import pytest

from handtrack import Session
from handtrack.capture.masks.mask_correction import AS_IT_IS
from handtrack.session.sources.corrections import encoded
from handtrack_app.engine import opening
from handtrack_app.engine.cloud_service import skin_in_force
from tests.app.cloudy_session import BOX, SKIN, cloudy_session

OTHER_LIGHT = (170, 70, 60)
"""skin in the second image"""


@pytest.fixture
def folder(tmp_path):
    """A session with an image of other light, whose skin lies elsewhere in it."""
    session = cloudy_session(tmp_path)
    image = np.full((72, 96, 3), 90, np.uint8)
    image[5:25, 60:80] = OTHER_LIGHT[::-1]
    cv2.imwrite(str(session / "cam1" / "002.png"), image)
    return session


SEGMENTED = (("cam0", 0, BOX), ("cam1", 2, (60, 5, 20, 20)))
"""camera, frame, and where its skin is"""


def filled(box, outside):
    x, y, width, height = box
    layer = np.full((72, 96), outside, np.uint8)
    layer[y : y + height, x : x + width] = 255
    return layer


def ellipse(folder):
    return Session.open(folder).file.clouds.filters.skin


def holds(found, colour):
    return bool(found.distance(np.array([colour], np.uint8))[0] <= found.size)


def test_masks_of_several_images_give_one_ellipse(handtrack, folder, tmp_path):
    pairs = []
    for camera, frame, box in SEGMENTED:
        path = tmp_path / f"{camera}.png"
        cv2.imwrite(str(path), filled(box, 0))
        pairs += ["--segmented", folder / camera / f"{frame:03d}.png", path]
    handtrack.does("skin", folder, *pairs[:3])
    one = ellipse(folder)
    assert holds(one, SKIN) and not holds(one, OTHER_LIGHT)
    handtrack.does("skin", folder, *pairs, "--size", 3)
    both = ellipse(folder)
    assert holds(both, SKIN) and holds(both, OTHER_LIGHT) and both.size == 3.0
    assert not holds(both, (120, 120, 120))
    assert "# a comment that stays" in (folder / "session.toml").read_text()


def test_what_was_painted_is_enough(handtrack, folder):
    assert handtrack("skin", folder).code == 2
    for camera, frame, box in SEGMENTED:
        corrections = Session.open(folder).view(camera).corrections
        corrections.write(frame, encoded(filled(box, AS_IT_IS)), None)
    handtrack.does("skin", folder)
    assert holds(ellipse(folder), OTHER_LIGHT)
    document = opening.document(opening.opened(folder))
    settings, _ = skin_in_force(document, 0, "cam0", None, 2.5)
    assert settings.filters.skin == ellipse(folder)
