"""What is found of a camera over all frames, told and corrected."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import load_model
from handtrack.geometry.rotation import rotation_matrix
from handtrack.tracking.frame.settings import PriorSettings
from handtrack.tracking.size.cameras import LATE, CameraChanges
from handtrack.tracking.size.estimate import Shared, WholeEstimate
from handtrack.tracking.size.motion import Motion
from handtrack.tracking.size.person import PersonChange
from handtrack.tracking.whole.refinement import CameraError, Refinement
from tests.cameras import pinhole

HAND = load_model("hand26")


def _camera(name, around, turn=(0.0, 0.0, 0.0)):
    """Return a camera at 0.5 m from the origin, looking at it from an angle `around` the vertical [rad]."""
    away = rotation_matrix(np.array([0.0, around, 0.0]))
    rotation = rotation_matrix(np.array(turn)) @ away
    return pinhole(name, (320, 240), (500, 510), rotation, (0, 0, 0.5), at=(160, 120))


def _changed(rng):
    cameras = (_camera("left", -0.6, (0.1, 0.2, 0.3)), _camera("right", 0.5))
    scale = np.array([0.1] * 3 + [0.02] * 3 + [0.05, 0.4, 0.002])
    return CameraChanges(cameras, scale * rng.normal(size=(2, 9)), (0, 2))


def test_a_camera_is_corrected_from_what_is_told_of_it(rng):
    """`refinement` of poses.npz is in degrees, millimetres and percent, of the camera; the changes are the hand's."""
    changes = _changed(rng)
    found = WholeEstimate(
        np.zeros((1, 26)), np.zeros((1, 26, 26)), Motion.usual(PriorSettings(), 26, 0.04), np.zeros(1), 1, "converged",
        Shared(changes, PersonChange.none(HAND)), np.eye(changes.count),
    )  # fmt: skip
    told = Refinement.read(Refinement.of(found).text)
    for camera, corrected in zip(changes.cameras, changes.corrected(), strict=True):
        again = told.corrected(camera)
        assert_allclose(again.matrix, corrected.matrix, atol=1e-4)
        assert_allclose(again.rotation, corrected.rotation, atol=1e-5)
        assert_allclose(again.centre, corrected.centre, atol=1e-6)
    assert told.corrected(_camera("another", 0.1)).name == "another"


def test_an_error_found_after_a_correction_adds_to_it():
    camera, std = _camera("left", 0.1), (0.01,) * 9
    first = CameraError("left", (1.0, -2.0, 0.5), (3.0, 0.0, -1.0), 0.8, 0.5, std)
    second = CameraError("left", (0.3, 0.4, -1.5), (-1.0, 2.0, 0.5), -0.3, -0.2, std)
    once, twice = second.after(first).corrected(camera), second.corrected(first.corrected(camera))
    assert_allclose(once.matrix, twice.matrix, rtol=1e-5)
    assert_allclose(once.rotation, twice.rotation, atol=1e-5)
    assert_allclose(once.centre, twice.centre, atol=1e-6)
    assert second.after(first).late_frames == pytest.approx(0.3)


def test_a_corrected_camera_sees_the_hand_as_the_changes_say(rng):
    cameras = _changed(rng)
    cameras.values[:, LATE] = 0.0
    bones = HAND.bones(HAND.rest_params())
    pose = HAND.rest_params()[None]
    for k, (camera, corrected) in enumerate(zip(cameras.cameras, cameras.corrected(), strict=True)):
        # a zoom is true to its share of the hand's own depth: 5 % of 0.1 m at 0.5 m, a hundredth of the picture
        seen = HAND.bones(cameras.seen_poses(k, pose, np.zeros_like(pose)).poses[0])
        off = camera.project(seen.position) - corrected.project(bones.position)
        size = np.ptp(corrected.project(bones.position), axis=0).max()
        assert np.abs(off - off.mean(axis=0)).max() < 0.01 * size
        cameras.values[k, 6] = 0.0
        seen = HAND.bones(cameras.seen_poses(k, pose, np.zeros_like(pose)).poses[0])
        assert_allclose(
            camera.project(seen.position), cameras.corrected()[k].project(bones.position), atol=1e-9
        )
