"""Files of corrections: they win over methods and files, also headless; what was there before is kept; odd ones are refused."""

import cv2
import numpy as np
import pytest

from handtrack import Session
from handtrack.capture.masks.mask_correction import (
    AS_IT_IS,
    HAND,
    UNKNOWN_LEVEL,
    empty_layer,
    painted,
)
from tests.capture.seeded_scenes import SIZE
from tests.session.test_seeded_session import JOINTS, folder, opened

__all__ = ["folder"]


def stroke(level=HAND):
    return painted(empty_layer(SIZE), np.array([[30.0, 30], [60, 30]]), 8.0, level)


def write(folder, image, frame=2):
    path = folder / "masks_corrected" / "cam0" / f"{frame:06d}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), image)
    return path


@pytest.mark.parametrize("method", ['{ method = "seeded" }', '"masks/*.png"'])
def test_a_correction_wins_where_it_says_something(folder, method):
    (folder / "masks").mkdir()
    for frame in range(3):
        cv2.imwrite(str(folder / "masks" / f"{frame}.png"), np.zeros((SIZE[1], SIZE[0]), np.uint8))
    layer = stroke()
    layer[200:, :] = UNKNOWN_LEVEL
    write(folder, layer)
    session = opened(folder, method, JOINTS)
    view = session.view("cam0")
    own, (seen,) = view.uncorrected_mask(2), session.observation(2).silhouettes
    assert own is not None
    assert (seen.mask[layer == HAND] == 1).all()
    assert (seen.mask[layer == UNKNOWN_LEVEL] == -1).all()
    stays = layer == AS_IT_IS
    assert (((own == 255) == (seen.mask == 1))[stays]).all()
    np.testing.assert_array_equal(view.mask(1), view.uncorrected_mask(1))
    assert view.corrections.frames == [2]


def test_a_camera_without_masks_has_what_was_painted(folder):
    write(folder, stroke())
    (folder / "session.toml").write_text(
        "[session]\nformat = 1\nfps = 10\n[[camera]]\nname = 'cam0'\nimages = 'cam0/*.png'\n"
    )
    session = Session.open(folder)
    (seen,) = session.observation(2).silhouettes
    assert {-1.0, 1.0} == set(np.unique(seen.mask).tolist())
    assert session.observation(1).silhouettes == ()
