"""Chains: which hinges move which links, and what a chain may not be."""

import numpy as np
import pytest

from handtrack.errors import HandtrackError
from handtrack.model.model_file import load_model
from handtrack.sampling.chains import chain_along, chains_of, prepare


def test_a_hand_offers_its_fingers():
    chains = chains_of(load_model("hand26"))
    assert [chain.name for chain in chains] == ["thumb", "index", "middle", "ring", "little"]
    assert chains[1].joints == ("index_mcp", "index_pip", "index_dip", "index_tip")
    assert chains[1].parameters == (
        "index_mcp_flex",
        "index_mcp_abd",
        "index_pip_flex",
        "index_dip_flex",
    )


def test_chains_are_chosen_by_name():
    model = load_model("hand26")
    assert [chain.name for chain in chains_of(model, ("ring", "thumb", "ring"))] == [
        "ring",
        "thumb",
    ]
    assert chains_of(model, ("all",)) == chains_of(model)
    with pytest.raises(HandtrackError, match="left_arm"):
        chains_of(model, ("left_arm",))


def test_what_a_coupling_takes_is_not_a_fingers_own():
    linked = chains_of(load_model("hand26", coupling="18"))[1]
    # all four fingers spread together
    assert linked.parameters == ("index_mcp_flex", "index_pip_flex")
    ready = prepare(load_model("hand26", coupling="18"), linked)
    assert ready.leader.tolist() == [0, -1, 2, 2]
    np.testing.assert_allclose(ready.ratio[3], 2 / 3)


def test_a_body_offers_neck_arms_and_legs():
    model = load_model("body34")
    names = [chain.name for chain in chains_of(model)]
    assert names == ["neck", "left_arm", "left_leg", "right_arm", "right_leg"]
    arm = prepare(model, chains_of(model)[1])
    assert [model.parameter_names[s] for s in arm.columns] == [
        "left_shoulder_abd",
        "left_shoulder_flex",
        "left_shoulder_twist",
        "left_elbow_flex",
    ]
    assert arm.link.tolist() == [0, 0, 1, 1]  # the twist leaves the elbow and moves the wrist


def test_an_arm_with_a_wrist_has_an_end_effector():
    """A ball, a hinge and two freedoms more: the 2003 paper's three-joint limb; a foot's one hinge is no link that flips."""
    model = load_model("body38")
    chains = {chain.name: chain for chain in chains_of(model)}
    arm = prepare(model, chains["left_arm"])
    assert arm.chain.joints == ("left_shoulder", "left_elbow", "left_wrist", "left_hand")
    assert arm.link.tolist() == [0, 0, 1, 1, 2, 2]
    assert chains["left_leg"].joints == ("left_hip", "left_knee", "left_ankle")


def test_the_trunks_twist_is_not_the_necks():
    model = load_model("body34")
    neck = chains_of(model)[0]
    assert neck.parameters == ("neck_flex", "neck_lean", "neck_twist")


def test_simple_models_offer_nothing():
    assert chains_of(load_model("ball6")) == ()


def test_links_keep_their_length_in_every_pose(rng):
    model = load_model("body34")
    for chain in chains_of(model):
        ready = prepare(model, chain)
        joints = [model.joint_names.index(name) for name in chain.joints]
        for _ in range(5):
            params = model.clipped(model.rest_params() + 0.7 * rng.normal(size=34))
            points = model.joint_positions(model.bones(params))[joints]
            lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
            np.testing.assert_allclose(lengths, np.linalg.norm(ready.reach, axis=1), rtol=1e-12)


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (("left_shoulder", "left_knuckle"), "no joint 'left_knuckle' (a chain)"),
        (("left_wrist", "left_elbow"), "no hinge moves its last joint but not its first"),
        (
            ("left_shoulder", "left_wrist"),
            "'left_elbow_flex' changes the distance between left_shoulder",
        ),
    ],
)
def test_what_is_no_chain_is_refused(joints, message):
    model = load_model("body34")
    with pytest.raises(HandtrackError) as error:
        prepare(model, chain_along(model, "odd", joints))
    assert message.replace(" (a chain)", "") in str(error.value)
