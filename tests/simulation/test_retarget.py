"""Somebody's joint positions become our parameters: known bodies and motions are recovered."""

import numpy as np
import pytest

from handtrack import HandScale, load_model
from handtrack.simulation.motion import motion
from handtrack.simulation.motion_files.clip import read_bvh
from handtrack.simulation.motion_files.read_motion import BANDAI_JOINTS, CMU_WRIST_JOINTS
from handtrack.simulation.retarget import fitted_model, retarget, retarget_errors


def build(scale):
    return load_model("body34", scale=scale)


@pytest.fixture(scope="module")
def dancer():
    """Somebody small with long legs and wide hips."""
    return build(HandScale(0.9, {"thighs": 1.08, "forearms": 0.95}, {"hip_width": 1.5}))


def joints_of(model, params, names):
    columns = [model.joint_names.index(name) for name in names]
    return np.stack([model.joint_positions(model.bones(p))[columns] for p in params])


def test_a_motion_of_the_same_body_is_recovered(dancer, rng):
    params = motion(dancer, "dance", 25, rng)
    names = dancer.joint_names
    positions = joints_of(dancer, params, names)
    found = retarget(dancer, names, positions)
    errors = retarget_errors(dancer, names, positions, found)
    assert errors.max() < 0.003  # the weak pull to rest and the held clavicles
    assert np.median(errors) < 0.001
    assert np.linalg.norm(found[:, 3:6], axis=1).max() <= np.pi + 1e-9


def test_a_persons_size_is_found_with_the_poses(dancer, rng):
    params = motion(dancer, "dance", 12, rng)
    names = dancer.joint_names
    positions = joints_of(dancer, params, names)
    positions = positions + rng.normal(scale=0.003, size=positions.shape)
    fitted = fitted_model(build, names, positions)
    for bone in ("left_thigh", "right_forearm", "left_shin", "right_upper_arm"):
        b = fitted.skeleton.bone(bone)
        assert fitted.skeleton.length[b] == pytest.approx(dancer.skeleton.length[b], rel=0.015)
    hips = np.diff(joints_of(fitted, np.zeros((1, 34)), ("left_hip", "right_hip"))[0], axis=0)
    true = np.diff(joints_of(dancer, np.zeros((1, 34)), ("left_hip", "right_hip"))[0], axis=0)
    assert np.linalg.norm(hips) == pytest.approx(np.linalg.norm(true), rel=0.06)


def test_the_dance_is_fitted_to_half_a_centimetre(data_dir):
    """Another skeleton's joints: what is left is mostly where its chest, shoulders and ankles are thought to be."""
    path = data_dir / "bandai_body_motion" / "dance-short_frames_0300-0899.bvh"
    clip = read_bvh(path, "replace").renamed(BANDAI_JOINTS)
    positions = clip.positions[::24]
    model = fitted_model(build, clip.names, positions[::3])
    errors = retarget_errors(model, clip.names, positions, retarget(model, clip.names, positions))
    assert np.median(errors) < 0.007
    assert np.percentile(errors, 95) < 0.03


def test_wrists_follow_captured_hands():
    """A CMU file tells of hands: body38 follows them where body34, whose wrists are stiff, cannot."""
    names = tuple(CMU_WRIST_JOINTS)
    hands = load_model("body38")
    joint = hands.rest.copy()
    for side, flex in (("left", 0.9), ("right", -0.7)):
        joint[hands.skeleton.parameter(f"{side}_wrist_flex")] = flex
        joint[hands.skeleton.parameter(f"{side}_elbow_flex")] = 1.0
    places = joints_of(hands, joint[None], names)
    errors = {}
    for name in ("body34", "body38"):
        model = load_model(name)
        found = retarget(model, names, places)
        errors[name] = retarget_errors(model, names, places, found)[0].max()
    assert errors["body38"] < 0.003
    assert errors["body34"] > 0.01
