"""The definition body34: a body of 34 joint parameters, left and right mirrored, that turns the way its names say."""

from __future__ import annotations

import json

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.articulated import HandScale
from handtrack.model.model_file import load_model, read_scale, write_scale

SIDE = ("left", "right")
LIMB = [
    "shoulder_abd",
    "shoulder_flex",
    "shoulder_twist",
    "elbow_flex",
    "hip_flex",
    "hip_abd",
    "hip_twist",
    "knee_flex",
    "ankle_flex",
]


@pytest.fixture(scope="module")
def body():
    return load_model("body34")


def placed(model, joint, **degrees):
    angles = {name: np.deg2rad(value) for name, value in degrees.items()}
    points = model.joint_positions(model.bones(model.params_from(angles)))
    return points[model.joint_names.index(joint)]


def direction(model, start, end, **degrees):
    along = placed(model, end, **degrees) - placed(model, start, **degrees)
    return along / np.linalg.norm(along)


def test_it_has_34_parameters_with_the_agreed_names(body):
    names = ["root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz"]
    names += [f"{bone}_{turn}" for bone in ("spine", "neck") for turn in ("flex", "lean", "twist")]
    names += [f"{s}_clavicle_{turn}" for s in SIDE for turn in ("elevate", "protract")]
    names += [f"{s}_{name}" for s in SIDE for name in LIMB]
    assert len(body.parameter_names) == 34
    assert set(body.parameter_names) == set(names)
    assert body.kind == "body"


def test_it_stands_upright_1_75_m_tall_with_its_left_at_plus_x(body):
    assert placed(body, "left_hip")[0] > 0 > placed(body, "right_hip")[0]
    assert placed(body, "nose")[2] > placed(body, "head_top")[2] + 0.05
    feet = body.flesh["fine"].posed(body.bones(np.zeros(34)))
    half = np.sqrt(((feet.rotation * feet.radii[:, None, :]) ** 2).sum(axis=2))[:, 1]
    lowest, highest = (feet.centre[:, 1] - half).min(), (feet.centre[:, 1] + half).max()
    assert highest - lowest == pytest.approx(1.75, abs=0.03)


def test_a_body_is_the_same_for_either_side(body):
    other = load_model("body34", side="left")
    assert other.side == body.side
    np.testing.assert_array_equal(other.skeleton.offset, body.skeleton.offset)


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


@pytest.mark.parametrize(
    ("abd", "flex", "expected"),
    [(0, 0, (0, -1, 0)), (90, -45, (1, 0, 0)), (90, 45, (0, 0, 1)), (180, 0, (0, 1, 0))],
)
def test_the_shoulder_reaches_side_front_and_top_far_from_its_lock(body, abd, flex, expected):
    """The second of the three hinges is the one whose 90° would lock the joint."""
    along = direction(
        body, "left_shoulder", "left_elbow", left_shoulder_abd=abd, left_shoulder_flex=flex
    )
    np.testing.assert_allclose(along, expected, atol=1e-9)
    assert abs(flex) < 60


def test_ball_joints_end_with_the_twist_about_the_bone(body):
    for bone in ("spine", "neck", "left_upper_arm", "right_upper_arm", "left_thigh", "right_thigh"):
        hinges = np.flatnonzero(body.skeleton.hinge_bone == body.skeleton.bone(bone))
        assert len(hinges) == 3
        np.testing.assert_allclose(np.abs(body.skeleton.hinge_axis[hinges[2]]), [0, 1, 0])
        axes = body.skeleton.hinge_axis[hinges]
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        second = body.limits.interval[6 + hinges[1]]
        assert np.abs(second).max() < np.deg2rad(85), bone


def test_zero_and_rest_are_within_limits(body):
    low, high = body.limits.interval.T
    assert ((low <= 0) & (high >= 0)).all()
    assert ((body.rest >= low) & (body.rest <= high)).all()


def test_only_the_clavicles_are_stabilised(body):
    held = [
        name for name, s in zip(body.parameter_names, body.stabilise, strict=True) if s < np.inf
    ]
    assert held == [f"{s}_clavicle_{t}" for s in SIDE for t in ("elevate", "protract")]
    assert load_model().stabilise is None


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


def test_parts_scale_what_they_name(body):
    long = load_model("body34", scale=HandScale(1.0, {"thighs": 1.1}))
    for side in SIDE:
        a = np.linalg.norm(placed(body, f"{side}_knee") - placed(body, f"{side}_hip"))
        b = np.linalg.norm(placed(long, f"{side}_knee") - placed(long, f"{side}_hip"))
        assert b == pytest.approx(1.1 * a)
    np.testing.assert_allclose(placed(long, "left_wrist"), placed(body, "left_wrist"))


def test_a_persons_body_is_saved_and_read(tmp_path):
    scale = HandScale(0.93, {"thighs": 1.04}, {"hip_width": -1.5})
    write_scale(tmp_path / "me.json", scale)
    assert read_scale(tmp_path / "me.json") == scale
    (tmp_path / "odd.json").write_text(json.dumps({"overall": 1, "parts": {"tail": 1}}))
    with pytest.raises(
        HandtrackError, match="no part of a hand or body 'tail' in .*; known: thumb"
    ):
        read_scale(tmp_path / "odd.json")


def test_errors_speak_of_bodies():
    with pytest.raises(HandtrackError, match="body scale 175: expected a factor on a body of 1750"):
        load_model("body34", scale=175.0)
    with pytest.raises(
        HandtrackError,
        match="no proportion 'hip' in the model body34; known: hip_width, hip_height",
    ):
        load_model("body34", scale=HandScale(1.0, {}, {"hip": 1.0}))
