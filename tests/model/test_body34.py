"""The definition body34: a body of 34 joint parameters, left and right mirrored, that turns the way its names say."""

import numpy as np
import pytest

from handtrack.model.articulated import HandScale
from handtrack.model.model_file import load_model

SIDE = ("left", "right")


@pytest.fixture(scope="module")
def body():
    return load_model("body34")


def placed(model, joint, **degrees):
    angles = {name: np.deg2rad(value) for name, value in degrees.items()}
    points = model.joint_positions(model.bones(model.params_from(angles)))
    return points[model.joint_names.index(joint)]


def test_left_and_right_are_mirror_images(body, rng):
    """The same angles left and right, and opposite leans and twists of the trunk, give the mirrored pose."""
    low, high = body.limits.interval[6:].T
    joint = np.zeros(34)
    joint[6:] = rng.uniform(low, high)
    mirrored = joint.copy()
    for i, name in enumerate(body.parameter_names):
        if name.startswith("left_"):
            j = body.skeleton.parameter(name.replace("left_", "right_"))
            mirrored[i], mirrored[j] = joint[j], joint[i]
        elif name.startswith(("spine", "neck")) and not name.endswith("flex"):
            mirrored[i] = -joint[i]
    a, b = body.bones(joint), body.bones(mirrored)
    swapped = [
        body.joint_names.index(
            n.replace("left_", "R_").replace("right_", "left_").replace("R_", "right_")
        )
        for n in body.joint_names
    ]
    flip = np.array([-1.0, 1.0, 1.0])
    np.testing.assert_allclose(
        body.joint_positions(a) * flip, body.joint_positions(b)[swapped], atol=1e-12
    )


@pytest.mark.parametrize("side", SIDE)
def test_signs_of_limbs(body, side):
    out = 1.0 if side == "left" else -1.0

    def turned(parameter, joint):
        bend = {f"{side}_elbow_flex": 60.0, f"{side}_knee_flex": 60.0}
        bend = {} if "twist" not in parameter else bend
        before = placed(body, f"{side}_{joint}", **bend)
        return placed(body, f"{side}_{joint}", **{f"{side}_{parameter}": 30.0, **bend}) - before

    assert turned("hip_flex", "knee")[2] > 0.1
    assert turned("hip_abd", "knee")[0] * out > 0.1
    assert turned("knee_flex", "ankle")[2] < -0.1
    assert turned("ankle_flex", "toe")[1] > 0.02
    assert turned("hip_twist", "ankle")[0] * out < -0.05  # the knee out, the bent shin in
    assert turned("elbow_flex", "wrist")[2] > 0.05
    assert turned("shoulder_twist", "wrist")[0] * out > 0.05
    assert turned("clavicle_elevate", "shoulder")[1] > 0.05
    assert turned("clavicle_protract", "shoulder")[2] > 0.05


def test_signs_of_trunk_and_head(body):
    for bone, tip in (("spine", "neck"), ("neck", "head_top")):
        start = placed(body, tip)
        assert placed(body, tip, **{f"{bone}_flex": 30})[2] > start[2] + 0.05
        assert placed(body, tip, **{f"{bone}_lean": 30})[0] > start[0] + 0.05
        assert placed(body, "nose", **{f"{bone}_twist": 30})[0] > 0.03


def test_eight_proportions_move_hips_clavicles_and_skull(body):
    assert len(body.proportion_names) == 8
    for name in body.proportion_names:
        changed = load_model("body34", scale=HandScale(1.0, {}, {name: 2.0}))
        bones, other = body.bones(np.zeros(34)), changed.bones(np.zeros(34))
        moved = np.abs(body.joint_positions(bones) - changed.joint_positions(other)).max(axis=1)
        part = {"hip": "hip", "clavicle": "shoulder", "skull": "head_top"}[name.split("_")[0]]
        for joint, by in zip(body.joint_names, moved, strict=True):
            assert (by > 0.005) == (by > 0), joint
            if joint.endswith(part):
                assert by > 0.005, (name, joint)
    wide = load_model("body34", scale=HandScale(1.0, {}, {"hip_width": 1.0}))
    assert placed(wide, "left_hip")[0] - placed(body, "left_hip")[0] == pytest.approx(0.007)
    assert placed(wide, "right_hip")[0] == pytest.approx(-placed(wide, "left_hip")[0])
