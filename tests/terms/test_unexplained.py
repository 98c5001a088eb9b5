"""The piece of a silhouette that lies beside the model, and the status of a frame that has nothing to compare with."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.observation.observation import Observation
from handtrack.simulation.scenes.simulated_views import mask_views
from handtrack.simulation.simulate import simulated_rig
from handtrack.tracking.frame.assessment import assess, outline_fit
from handtrack.tracking.frame.constants import DOUBTFUL_PIECE_MM2
from handtrack.tracking.frame.frame_terms import frame_terms
from handtrack.tracking.frame.result import Status
from handtrack.tracking.frame.settings import TrackerSettings

MODEL = load_model("hand26")
POSE = MODEL.rest_params()
POSE[1] = -0.09


def elsewhere(**angles: float) -> np.ndarray:
    pose = POSE.copy()
    for name, angle in angles.items():
        pose[MODEL.skeleton.parameter(name)] += angle
    return MODEL.clipped(pose)


def seen(wider_px: int = 0) -> Observation:
    """Return what three cameras see of the hand at rest, with a rim."""
    rig = simulated_rig(3, (320, 240))
    observation = mask_views(MODEL, POSE, rig.cameras, 0)
    if not wider_px:
        return observation
    kernel = np.ones((2 * wider_px + 1,) * 2, np.uint8)
    masks = [replace(s, mask=cv2.dilate(s.mask, kernel)) for s in observation.silhouettes]
    return replace(observation, silhouettes=tuple(masks))


def looked_at(observation: Observation, pose: np.ndarray):
    bones = MODEL.bones(pose)
    terms = frame_terms(MODEL, TrackerSettings(), observation, bones, None)
    fit = outline_fit(terms, bones)
    assert fit is not None
    return fit, assess(terms, bones, 0.0, ())


@pytest.mark.parametrize("wider_px", [0, 1])
def test_the_right_pose_leaves_no_piece(wider_px):
    fit, (status, reason) = looked_at(seen(wider_px), POSE)
    assert fit.piece_mm2 < 0.2 * DOUBTFUL_PIECE_MM2
    assert (status, reason) == (Status.TRACKED, None)


@pytest.mark.parametrize(
    "angles",
    [
        {"thumb_cmc_abd": -0.7, "thumb_cmc_flex": 0.6, "thumb_ip_flex": 0.9},
        {"index_mcp_flex": 1.2, "index_pip_flex": 1.2, "index_dip_flex": 0.8},
    ],
    ids=["thumb", "index"],
)
def test_a_finger_that_is_elsewhere_is_doubtful_in_a_single_frame(angles):
    pose = elsewhere(**angles)
    moved = MODEL.joint_positions(MODEL.bones(pose)) - MODEL.joint_positions(MODEL.bones(POSE))
    assert np.linalg.norm(moved, axis=1).max() > 0.04
    fit, (status, reason) = looked_at(seen(), pose)
    assert fit.piece_mm2 > DOUBTFUL_PIECE_MM2
    assert status == Status.DOUBTFUL
    assert reason is not None
