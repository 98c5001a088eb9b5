"""Masks made again by tracked poses: better than by joints, where joints are poor, and never over files of others."""

import cv2
import numpy as np
import pytest

from handtrack import Status, load_model
from handtrack.capture.masks.mask_correction import UNKNOWN_LEVEL
from handtrack.session.layout import MASKS_FOLDER
from handtrack.session.refined_masks import MaskRefinement
from tests.capture.seeded_scenes import recording
from tests.sample_track import labels_of, posed_frame
from tests.session.test_seeded_session import images_in, opened

OFF_M = 0.003
LOST = 5


def track_of(drawn, rng):
    """Return the true poses, the whole hand some millimetres aside; one frame is lost."""
    model = load_model("hand26")
    frames = []
    for frame, params in enumerate(drawn.params):
        moved = params + np.r_[rng.normal(scale=OFF_M, size=3), np.zeros(len(params) - 3)]
        status = Status.LOST if frame == LOST else Status.TRACKED
        frames.append(posed_frame(model, frame, model.joint_params(moved), 10.0, status=status))
    return labels_of(model).track(frames)


@pytest.fixture(scope="module")
def drawn():
    return recording("wood", np.random.default_rng(7), 16)


@pytest.fixture
def session(tmp_path, drawn):
    images_in(tmp_path, drawn)
    return opened(tmp_path, '{ method = "skin_ycrcb" }')


def test_masks_by_poses_are_right(session, drawn, rng):
    """Before wood of skin's colour, where masks by joints know half of the hand: test_seeded_masks."""
    refinement = MaskRefinement(session, track_of(drawn, rng))
    (view,) = refinement.views
    masks = refinement.learn(view)
    for frame in (2, 9, LOST):
        told = refinement.write(view, masks, frame)
        path = session.folder / MASKS_FOLDER / "cam0" / f"{frame:06d}.png"
        assert path.exists() == (told is not None) == (frame != LOST)
        if told is None:
            continue
        mask = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        known, truth = mask != UNKNOWN_LEVEL, drawn.truth[frame]
        assert (truth & known).sum() / truth.sum() > 0.7
        assert ((mask == 255) != truth)[known].sum() / truth.sum() < 0.04
        assert told[1] > 0.9
    assert refinement.changes() == {
        "camera.0.masks": "masks_refined/cam0/*.png",
        "camera.0.mask_unknown": UNKNOWN_LEVEL,
    }
