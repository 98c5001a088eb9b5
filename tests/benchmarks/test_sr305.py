"""Real depth frames of a hand: found without a first pose, the hand's size fitted, cloud and model close."""

from __future__ import annotations

import numpy as np
import pytest

from handtrack.capture.clouds.depth import depth_cloud
from handtrack.model.model_file import load_model
from handtrack.model.pose_library import named_pose
from handtrack.simulation.render import pixel_rays, render
from handtrack.tracking.frame.result import Status
from tests.experiments.clouds.sr305 import fitted
from tests.experiments.scenes.depth_hand import AROUND_TIP_M, CAMERA, UNIT_M, hand_points


@pytest.fixture(scope="module")
def fits(request: pytest.FixtureRequest):
    """Three of the eight frames, differently turned, one with a long bare arm; all: `handtrack bench sr305`."""
    data = request.getfixturevalue("data_dir")
    if not (data / "sr305_depth_hand").is_dir():
        pytest.skip("no sr305_depth_hand among the shared data")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HANDTRACK_DATA", str(data))
        return fitted([90, 130, 150])


def test_the_bars(fits) -> None:
    """In each frame, cloud to model at most 4 mm in the mean, visible model to cloud at most 6 mm."""
    assert [fit.frame for fit in fits.own_hand] == [90, 130, 150]
    for fit in fits.own_hand:
        assert fit.result.status == Status.TRACKED
        assert len(fit.hand) > 6000
        assert fit.cloud_to_model_mm.mean() < 3.0  # the bar is 4; measured 2.3 to 2.5
        assert fit.model_to_cloud_mm.mean() < 3.0  # the bar is 6; measured 2.2 to 2.3


def test_the_fitted_size_fits_better_than_the_mean_adults(fits) -> None:
    for own, mean in zip(fits.own_hand, fits.mean_hand, strict=True):
        assert own.cloud_to_model_mm.mean() < mean.cloud_to_model_mm.mean()
    assert 0.85 < fits.scale.overall < 1.15


def test_the_thumb_is_where_the_photograph_shows_it(fits) -> None:
    """Palm to the camera, fingers up (90), to the right (130) or down (150): looked at; no fit is upside down or mirrored."""
    for fit, up in zip(fits.own_hand, ((0.0, -1.0), (1.0, 0.0), (0.0, 1.0)), strict=True):
        points = CAMERA.project(fit.result.keypoints21)
        fingers = points[12] - points[0]
        thumb = points[4] - points[0]
        assert fingers @ up > 0.8 * np.linalg.norm(fingers)
        assert fingers[0] * thumb[1] - fingers[1] * thumb[0] > 0  # a right hand's palm


def test_hand_points_are_told_from_depth_alone() -> None:
    """A rendered hand with its forearm: five fingertips, the hand's points, hardly any of the arm's."""
    model = load_model(forearm=True)
    joint = named_pose(model, "open")
    joint[2], joint[4] = 0.55, np.pi  # palm to the camera
    bones = model.bones(model.transform.solver_params(joint))
    flesh = model.flesh["fine"].posed(bones)
    front, depth, _ = render(CAMERA, flesh, pixel_rays(CAMERA))
    steps = np.round(np.where(front >= 0, depth, 0.0) / UNIT_M) * UNIT_M
    found = hand_points(depth_cloud(CAMERA, steps).points)
    tips = model.keypoints21(bones)[4::4]
    apart = np.linalg.norm(found.tips[:, None] - tips, axis=2)
    assert apart.shape == (5, 5)
    assert apart.min(axis=0).max() < 0.02
    arm = flesh.bone[np.maximum(front, 0)] == model.skeleton.bone("forearm")
    hand = (front >= 0) & ~arm
    assert 0.8 * hand.sum() < len(found.points) < 1.1 * hand.sum()  # the wrist covers the arm's end
    assert (
        np.linalg.norm(found.points[:, None] - found.tips, axis=2).min(axis=1).max() <= AROUND_TIP_M
    )
