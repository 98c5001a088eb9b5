"""The definition body38: body34, and wrists that bend the way their names say; what else takes a body takes it too."""

from __future__ import annotations

import json

import numpy as np
import pytest

from handtrack.model.model_file import load_model, model_from_definition
from handtrack.terms.priors.body_priors import body_priors

WRISTS = tuple(f"{s}_wrist_{turn}" for s in ("left", "right") for turn in ("flex", "abd"))


@pytest.fixture(scope="module")
def body():
    return load_model("body38")


def placed(model, joint, **degrees):
    angles = {name: np.deg2rad(value) for name, value in degrees.items()}
    points = model.joint_positions(model.bones(model.params_from(angles)))
    return points[model.joint_names.index(joint)]


def test_it_is_body34_and_four_freedoms_more(body):
    plain = load_model("body34")
    assert set(body.parameter_names) - set(plain.parameter_names) == set(WRISTS)
    kept = [body.parameter_names.index(name) for name in plain.parameter_names]
    np.testing.assert_array_equal(body.limits.interval[kept], plain.limits.interval)
    np.testing.assert_array_equal(body.rest[kept], plain.rest)
    np.testing.assert_array_equal(body.skeleton.offset, plain.skeleton.offset)
    assert body.joint_names[: len(plain.joint_names)] == plain.joint_names
    assert body.joint_names[-4:] == ("left_index", "left_pinky", "right_index", "right_pinky")
    for key, flesh in plain.flesh.items():
        np.testing.assert_array_equal(body.flesh[key].centre, flesh.centre)


@pytest.mark.parametrize("side", ["left", "right"])
def test_signs_of_wrists(body, side):
    """Palms face the thighs: flexion brings the knuckles to the body's middle, abduction to the thumb, which points ahead."""
    inwards = -1.0 if side == "left" else 1.0
    still = placed(body, f"{side}_hand")
    flexed = placed(body, f"{side}_hand", **{f"{side}_wrist_flex": 60}) - still
    towards_thumb = placed(body, f"{side}_hand", **{f"{side}_wrist_abd": 20}) - still
    assert flexed[0] * inwards > 0.05 and abs(flexed[2]) < 1e-9
    assert towards_thumb[2] > 0.02 and abs(towards_thumb[0]) < 1e-9
    for knuckle, ahead in (("index", 1), ("pinky", -1)):
        assert (placed(body, f"{side}_{knuckle}") - still)[2] * ahead > 0.02
    # a flexed hand still turns to the thumb: flexion first, abduction about the axis that it carried along
    both = placed(body, f"{side}_hand", **{f"{side}_wrist_flex": 60, f"{side}_wrist_abd": 20})
    assert both[2] - still[2] == pytest.approx(towards_thumb[2], abs=1e-9)


def test_left_and_right_wrists_are_mirror_images(body):
    left = {"left_wrist_flex": 50.0, "left_wrist_abd": -25.0, "left_elbow_flex": 70.0}
    right = {name.replace("left", "right"): value for name, value in left.items()}
    for joint in ("hand", "index", "pinky"):
        mirrored = placed(body, f"left_{joint}", **left) * (-1.0, 1.0, 1.0)
        np.testing.assert_allclose(placed(body, f"right_{joint}", **right), mirrored, atol=1e-12)


def test_limits_are_those_of_a_hands_own_wrist(body):
    """The two definitions have one source."""
    hand = load_model("hand26", forearm=True)
    for turn in ("flex", "abd"):
        limits = hand.limits.interval[hand.skeleton.parameter(f"wrist_{turn}")]
        for side in ("left", "right"):
            own = body.limits.interval[body.skeleton.parameter(f"{side}_wrist_{turn}")]
            np.testing.assert_array_equal(own, limits)


def test_it_is_built_again_from_what_a_result_holds(body):
    assert "extends" not in json.loads(body.definition)
    again = model_from_definition(body.definition, "right", body.scale, False, "poses.npz")
    assert again.parameter_names == body.parameter_names
    np.testing.assert_array_equal(again.skeleton.hinge_axis, body.skeleton.hinge_axis)


def test_priors_pull_its_wrists_to_rest(body):
    joint = body.rest.copy()
    joint[body.skeleton.parameter("left_wrist_flex")] = 1.0
    rest = body_priors(body, collision=False).joints
    assert sum(p.cost(joint) for p in rest) > sum(p.cost(body.rest) for p in rest)
