"""A session of a body in the workbench: a slider moves a limb, wrists and ankles are pulled."""

import numpy as np
import pytest

from handtrack import load_model
from handtrack.simulation.simulate import simulate
from handtrack_app.engine.inverse_kinematics import reach, stem_bones
from handtrack_app.palette import limb_of
from tests.app.desk import shown
from tests.app.page.test_recorded_pages import BODY
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def test_a_slider_moves_a_limb(tmp_path):
    with shown(simulate(tmp_path / "new", BODY)) as bench, WireClient(bench.url) as client:
        hand, document = bench.stage.hand, bench.worker.document
        foot = hand.parts[hand.part_bone.index(document.model.skeleton.bone("left_foot"))]
        before = np.array(foot.position)
        client.set_value(bench.layout.pose.sliders["left_knee_flex"], 90.0)
        eventually(lambda: np.linalg.norm(foot.position - before) > 0.3)


def pulled(model, params, name, target):
    joint = model.joint_names.index(name)
    return reach(model, params, model.joint_bone[joint], model.joint_point[joint], target)


@pytest.mark.parametrize(
    ("name", "tip"), [("body34", "left_wrist"), ("body34", "right_ankle"), ("body38", "left_pinky")]
)
def test_a_limbs_end_is_pulled_by_its_own_limb(name, tip):
    body = load_model(name)
    assert stem_bones(body) == ("pelvis", "spine")
    params = body.rest_params()
    joint = body.joint_names.index(tip)
    target = body.joint_positions(body.bones(params))[joint] + [0.05, 0.12, 0.15]
    moved = pulled(body, params, tip, target)
    found = body.joint_positions(body.bones(moved))[joint]
    assert np.linalg.norm(found - target) < 0.005
    changed = np.array(body.parameter_names)[np.abs(moved - params) > 1e-9]
    limb = limb_of(body.skeleton.bone_names[body.joint_bone[joint]])
    assert {limb_of(name) for name in changed} == {limb}
    assert ("left_wrist_flex" in changed) == (name == "body38")


@pytest.mark.parametrize("coupling", ["26", "18"])
def test_a_finger_is_pulled_alone_whatever_is_coupled(coupling):
    hand = load_model(coupling=coupling)
    params = hand.rest_params()
    joint = hand.joint_names.index("index_tip")
    target = hand.joint_positions(hand.bones(params))[joint] + [0.0, -0.01, -0.01]
    moved = hand.joint_params(pulled(hand, params, "index_tip", target))
    still = hand.joint_params(params)
    changed = np.array(hand.parameter_names)[np.abs(moved - still) > 1e-12]
    assert all(name.startswith("index") for name in changed), changed
    assert np.abs(moved - still).max() > 0.02
