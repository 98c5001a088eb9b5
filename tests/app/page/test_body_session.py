"""A session of a body in the workbench: its parts are drawn, its sliders stand by limb, wrists and ankles are pulled."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from handtrack.model.model_file import load_model
from handtrack.simulation.simulate import Simulation, simulate
from handtrack_app.engine.document_snapshots import part_cards, pose_snapshot, truth_at
from handtrack_app.engine.posing.inverse_kinematics import reach, stem_bones
from handtrack_app.engine.store import edits
from handtrack_app.page.panels.pose_words import group_of, label_of
from handtrack_app.protocol.palette import colour_of, limb_of
from handtrack_app.workbench import Workbench
from tests.app.waiting import eventually
from tests.app.wire import WireClient

BODY = load_model("body34")


@pytest.fixture(scope="module")
def opened(tmp_path_factory) -> Iterator[Workbench]:
    folder = tmp_path_factory.mktemp("body") / "new"
    what = Simulation(
        cameras=2, frames=2, size=(96, 72), motion="still", model="body34", distance_m=3.5, images=False
    )  # fmt: skip
    workbench = Workbench(simulate(folder, what), port=0).start()
    assert workbench.wait_ready()
    yield workbench
    workbench.stop()


def test_its_parts_stand_on_their_bones(opened):
    hand = opened.stage.hand
    document = opened.worker.document
    assert hand is not None
    bones = document.model.bones(document.model.transform.solver_params(document.start))
    assert len(hand.parts) == len(document.model.superquadrics) == 19
    for part, bone in zip(hand.parts, hand.part_bone, strict=True):
        np.testing.assert_allclose(part.position, bones.position[bone], atol=1e-6)
        assert part.visible
    assert not hand.flesh.visible


def test_every_parameter_has_a_slider_in_its_limbs_folder(opened):
    panel = opened.layout.pose
    assert tuple(panel.sliders) == BODY.parameter_names
    labels = [folder.label for folder in panel.folders.values()]
    assert labels == ["Place", "Trunk", "Head", "Left arm", "Right arm", "Left leg", "Right leg"]
    knee = panel.sliders["left_knee_flex"]
    assert (knee.min, knee.max) == (-8, 155)


def test_what_is_for_hands_alone_is_not_offered(opened):
    layout = opened.layout
    assert not layout.guesses.find.visible  # no detector saw its joints
    assert "model.coupling" not in layout.settings.controls
    assert "silhouettes.weight" in layout.settings.controls
    assert layout.session.view.options == ("Body", "Everything")


def test_the_page_speaks_of_a_body_in_its_measures(opened):
    layout, words = opened.layout, opened.page.words
    assert layout.pose.copies.whole.label == "Body"
    assert words.of("the {kind}, its {middle}, a {part}") == "the body, its trunk, a limb"
    panel = layout.pose
    assert panel.sliders["root_tx"].label == "x cm"
    assert panel.nudges.step.options == ("0.5 cm, 0.5°", "2 cm, 2°", "10 cm, 10°", "50 cm, 10°")
    assert panel.nudges.steps[str(panel.nudges.step.value)] == (0.02, 2.0)
    assert [row.options for row in panel.rows] == [
        ("Place", "Trunk", "Head"), ("Left arm", "Right arm"), ("Left leg", "Right leg"),
    ]  # fmt: skip
    known = {key: words.of(text) for key, text in layout.keys.known}
    assert known["B"] == "See the body in all cameras"
    offered = (layout.session.paint.hint, layout.plots.note.content, layout.help.table())
    assert [re.findall(r"(?<!by )\b(hands?|fingers?|palm|thumb)\b", text) for text in offered] == [
        [],
        [],
        [],
    ]


def test_a_part_is_drawn_in_its_limbs_colour(opened):
    hand = opened.stage.hand
    foot = hand.part_bone.index(BODY.skeleton.bone("left_foot"))
    assert hand.parts[foot].color == colour_of("left_foot")


def test_a_slider_moves_the_limb(opened):
    hand = opened.stage.hand
    foot = hand.part_bone.index(BODY.skeleton.bone("left_foot"))
    before = np.array(hand.parts[foot].position)
    with WireClient(opened.url) as client:
        client.set_value(opened.layout.pose.sliders["left_knee_flex"], 90.0)
        eventually(
            lambda: np.linalg.norm(np.array(hand.parts[foot].position) - before) > 0.3,
            "the foot moved",
        )


def test_the_error_against_true_joints_is_told(opened):
    document = opened.worker.document
    assert truth_at(document, 0).shape == (len(BODY.joint_names), 3)
    document.apply(edits.pose(document, 0, document.start.tolist()))
    document.show(0)
    assert pose_snapshot(document).error_mm < 1.0  # it started from the exact pose
    moved = document.start.copy()
    moved[0] += 0.05
    document.apply(edits.pose(document, 0, moved.tolist()))
    document.show(0)
    assert pose_snapshot(document).error_mm == pytest.approx(50.0, abs=1.0)
    document.apply(edits.forgotten_pose(0))


def test_names_are_grouped_and_worded_by_limb():
    assert group_of("left_shoulder_abd") == "Left arm"
    assert label_of("left_shoulder_abd") == "shoulder aside\u00a0°"
    assert group_of("right_ankle_flex") == "Right leg"
    assert group_of("spine_twist") == "Trunk"
    assert label_of("spine_twist") == "spine twist\u00a0°"
    assert group_of("neck_lean") == "Head"
    assert group_of("root_tx") == "Place"
    assert group_of("index_mcp_flex") == "Index"
    assert label_of("index_mcp_flex") == "MCP flex °"
    arms = {name: colour_of(name) for name in BODY.skeleton.bone_names if "arm" in name}
    assert len(set(arms.values())) == 2
    assert all(limb_of(name) is None for name in load_model(forearm=True).skeleton.bone_names)


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
    changed = {
        name
        for name, a, b in zip(body.parameter_names, params, moved, strict=True)
        if abs(a - b) > 1e-9
    }
    limb = limb_of(body.skeleton.bone_names[body.joint_bone[joint]])
    assert {limb_of(name) for name in changed} == {limb}
    assert ("left_wrist_flex" in changed) == (name == "body38")


@pytest.mark.parametrize("coupling", ["26", "21", "18"])
def test_a_finger_is_pulled_alone_whatever_is_coupled(coupling):
    hand = load_model(coupling=coupling)
    params = hand.rest_params()
    joint = hand.joint_names.index("index_tip")
    target = hand.joint_positions(hand.bones(params))[joint] + [0.0, -0.01, -0.01]
    moved = hand.joint_params(pulled(hand, params, "index_tip", target))
    still = hand.joint_params(params)
    for name, a, b in zip(hand.parameter_names, still, moved, strict=True):
        assert math.isclose(a, b, abs_tol=1e-12) or name.startswith("index"), name
    assert np.abs(moved - still).max() > 0.02


def test_hands_have_no_parts():
    assert part_cards(load_model()) == ()
    cards = part_cards(BODY)
    assert all(card.faces.max() == len(card.vertices) - 1 for card in cards)


def test_the_command_line_simulates_and_tracks_a_body(handtrack, tmp_path: Path):
    folder = tmp_path / "dance"
    made = handtrack(
        "simulate", "--model", "body34", "--motion", "still", "--frames", "2", "--cameras", "2",
        "--size", "96", "72", "--no-images", "--out", str(folder),
    )  # fmt: skip
    assert made.code == 0, made.err
    assert handtrack("track", str(folder)).code == 0
    poses = folder / "tracks" / "poses.npz"
    ended = handtrack("export", poses, "--to", "csv")
    assert ended.code == 0, ended.err
    assert "left_knee_flex" in next(folder.rglob("*.csv")).read_text()
    ended = handtrack("evaluate", poses, "--truth", folder / "truth.npz")
    assert ended.code == 0, ended.err
