"""Correcting a pose: the palm dragged and turned, a joint pulled freely or pinned in a camera's picture, nudged along the view, flipped,
copied, mirrored, tuned, taken from the library; what is told of it."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import load_model
from handtrack.files.user_folder import user_data_folder
from handtrack.geometry.rotation import rotation_matrix
from handtrack_app.engine import tuning_service
from handtrack_app.engine.document_snapshots import pose_snapshot, session_snapshot
from handtrack_app.page.panels.copying import ALL, CopiedPose, mirrored, read_copied, save_copied
from handtrack_app.page.panels.pose import NUDGES, nudged
from handtrack_app.page.pins.grips import ROOT, WholeDrag, hold_at
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.snapshots import CameraCard
from tests.app.fake_run import fake_document
from tests.app.waiting import eventually


@pytest.fixture(autouse=True)
def home(tmp_path, monkeypatch):
    monkeypatch.setenv("HANDTRACK_HOME", str(tmp_path / "home"))


def _pose(bench):
    assert bench.stage.pose is not None
    return bench.stage.pose


def test_the_palm_takes_the_hand_along_and_shift_turns_it(bench, page):
    """It comes under the pointer as deep as it was, and turns about the line of sight to its middle."""
    page.press("Camera view: front")
    eventually(lambda: page.number in bench.stage.grips._grips, "it can be taken hold of")
    before, session, card = _pose(bench), bench.stage.session, page.view.card
    bone = session.bone_names.index("ring_metacarpal")
    palm = before.centre[list(session.ellipsoid_bone).index(bone)]
    aim = palm + card.rotation @ (0.02, 0.01, 0.05)
    page.drag("/grips/flesh", palm, aim)
    way, ahead = aim - card.centre, card.rotation[:, 2]
    place = card.centre + way * ((palm - card.centre) @ ahead) / (way @ ahead)
    eventually(lambda: np.allclose(_pose(bench).values[:3] - before.values[:3], place - palm, atol=1e-6), "moved")  # fmt: skip
    assert_allclose(_pose(bench).values[3:], before.values[3:], atol=1e-9)
    moved = _pose(bench)
    eventually(lambda: bench.stage.grips._pose is moved, "what is held next is the moved hand")
    assert not moved.pins
    tip = moved.joints[session.joint_names.index("index_tip")]
    axis = (moved.middle - card.centre) / np.linalg.norm(moved.middle - card.centre)
    quarter = rotation_matrix(axis * np.pi / 2)
    page.drag("/grips/flesh", tip, moved.middle + quarter @ (tip - moved.middle), "shift")
    turned = moved.middle + (moved.joints - moved.middle) @ quarter.T
    eventually(lambda: np.allclose(_pose(bench).joints, turned, atol=2e-3), "by a quarter")
    assert_allclose(_pose(bench).values[6:], before.values[6:], atol=1e-9)
    page.press("Undo")
    eventually(lambda: np.allclose(_pose(bench).values, moved.values, atol=1e-9), "a drag is a step")  # fmt: skip


def test_seen_freely_shift_pulls_a_middle_joint_parallel_to_the_screen(bench, page):
    before, session = _pose(bench), bench.stage.session
    bench.layout.page.draw("handle", False)  # it stands before the hand, and takes the pointer
    bench.stage.apply()
    pip = before.joints[session.joint_names.index("index_pip")]
    aim = pip + (0.0, -0.006, -0.012)
    page.drag("/hand/flesh", pip, aim, "shift")

    def reached():
        there = _pose(bench).joints[session.joint_names.index("index_pip")]
        return bool(np.linalg.norm(there - aim) < 0.008)

    eventually(reached, "the joint comes along")
    assert _pose(bench).origin == "set" and not _pose(bench).pins
    others = [i for i, n in enumerate(session.parameter_names) if not n.startswith("index")]
    assert_allclose(_pose(bench).values[others], before.values[others], atol=1e-9)


def test_space_flips_and_all_of_the_page_says_so(bench, page):
    before, panel = _pose(bench), bench.layout.pose
    bench.engine.take_pose(3, "fist", bench.state.begin_edit())
    eventually(lambda: _pose(bench).origin == "set" and panel.sliders["index_pip_flex"].value > 90, "a fist")  # fmt: skip
    fist = _pose(bench)
    page.press("Before/after: the pose before the last step")
    eventually(lambda: bench.layout.aside.visible, "told")
    assert _pose(bench).origin == snapshots.BEFORE
    assert_allclose(_pose(bench).values, before.values, atol=1e-9)
    assert "before the last step" in panel.card.content
    assert panel.sliders["index_pip_flex"].value < 30
    assert not bench.stage.root.control.visible  # type: ignore[union-attr]
    assert bench.state.values == tuple(fist.values.tolist()), "edits go on from what is"
    page.press("Before/after: the pose before the last step")
    eventually(lambda: not bench.layout.aside.visible, "back")
    assert_array_equal(_pose(bench).values, fist.values)
    assert bench.stage.root.control.visible  # type: ignore[union-attr]


def test_a_pose_is_copied_pasted_and_mirrored_by_keys(bench, page):
    bench.engine.take_pose(3, "point", bench.state.begin_edit())
    panel = bench.layout.pose  # what it shows is copied
    eventually(lambda: panel.pose is not None and panel.pose.origin == "set", "pointing")
    point = _pose(bench)
    page.press("Copy the pose")
    eventually(lambda: "frame 3" in panel.copies.line.content, "told")
    bench.go_to(9)
    eventually(lambda: _pose(bench).frame == 9, "another frame")
    bench.engine.take_pose(9, "fist", bench.state.begin_edit())
    eventually(lambda: _pose(bench).frame == 9 and _pose(bench).origin == "set", "a fist there")
    page.press("Paste the pose that was copied")
    eventually(lambda: np.allclose(_pose(bench).values, point.values, atol=1e-9), "pasted")
    assert _pose(bench).frame == 9
    root = _pose(bench).values[:6]
    page.press("Camera view: front")
    page.press("Mirror the pose: left and right change places")
    eventually(lambda: not np.allclose(_pose(bench).values[:6], root, atol=1e-9), "mirrored")
    assert_allclose(_pose(bench).values[6:], point.values[6:], atol=1e-9)
    page.press("Undo")
    eventually(lambda: np.allclose(_pose(bench).values[:6], root, atol=1e-9), "undone")


def test_the_switch_refits_the_frame_that_is_shown(bench, monkeypatch, page):
    monkeypatch.setattr(
        tuning_service, "fitted_again", lambda _m, _s, _seen, params, _stop: params + 0.01
    )
    page.press("Refit while tuning: on, off")
    boxes = bench.layout.settings.refits.boxes
    eventually(lambda: [box.value for box in boxes] == [True, True], "both tabs show it")
    bench.engine.set_setting("cloud.balance", 0.8)
    eventually(lambda: _pose(bench).origin == "refitted", "refitted")
    eventually(lambda: "refitted" in bench.layout.pose.card.content, "and the card says so")


@pytest.fixture
def shown(tmp_path):
    document = fake_document(tmp_path)
    session, pose = session_snapshot(document), pose_snapshot(document)
    return session, pose, CameraCard.of(document.run.session.rig["front"])


def _ellipsoid(session, bone):
    return int(np.flatnonzero(session.ellipsoid_bone == session.bone_names.index(bone))[0])


def test_away_from_joints_it_is_the_point_of_the_segment_under_the_pointer(shown):
    session, pose, card = shown
    ends = [pose.joints[session.joint_names.index(f"middle_{part}")] for part in ("mcp", "pip")]
    middle = 0.5 * (ends[0] + ends[1])
    ellipsoid = _ellipsoid(session, "middle_proximal")
    held = hold_at(session, pose, card, ellipsoid, middle)
    assert held.bone == "middle_proximal"
    bone = session.bone_names.index(held.bone)
    point = pose.bone_position[bone] + pose.bone_rotation[bone] @ held.point
    way, at = middle - card.centre, point - card.centre
    assert np.linalg.norm(np.cross(way, at)) / np.linalg.norm(way) < 1e-9, "on the same ray"
    assert np.linalg.norm(point - middle) < 0.015, "on the skin"


def test_what_is_not_of_this_hand_is_not_held_and_a_drag_that_tells_nothing_changes_nothing(shown):
    session, pose, card = shown
    behind = card.centre - card.rotation[:, 2]
    assert hold_at(session, pose, card, 10_000, pose.middle) is None
    assert hold_at(session, pose, card, 0, np.full(3, np.nan)) is None
    assert hold_at(session, pose, card, 0, behind) is None
    for turns in (False, True):
        drag = WholeDrag(card, pose.values[:6], pose.middle, pose.joints[0], turns)
        assert drag.to(behind) is None
    assert drag.to(pose.middle) is None, "on the axis itself"


def test_a_drag_in_a_camera_s_picture_pins_a_joint_there_and_the_hand_follows(bench, page):
    page.press("Camera view: front")
    grips = bench.stage.grips
    eventually(lambda: page.number in grips._grips, "the hand can be taken hold of")
    pose, session = bench.stage.pose, bench.stage.session
    tip = pose.joints[session.joint_names.index("index_tip")]
    aim = tip + 0.02 * page.view.card.rotation[:, 0]
    page.drag("/grips/flesh", tip, aim, part=_ellipsoid(session, "index_distal"))
    eventually(lambda: bool(bench.stage.pose and bench.stage.pose.pins), "pinned")

    def follows():
        now = bench.stage.pose
        if now is None or not now.pins or now.pins[0].off_px >= 0.5:
            return False
        moved = now.joints[session.joint_names.index("index_tip")] - tip
        return bool(np.linalg.norm(moved) > 0.015)

    eventually(follows, "the tip is there")
    eventually(lambda: bench.layout.pose.pins.pins == bench.stage.pose.pins, "listed")
    (pin,) = bench.stage.pose.pins
    assert (pin.camera, pin.words) == ("front", "index tip")
    page.press("Drop the last pin")
    eventually(lambda: bench.stage.pose is not None and not bench.stage.pose.pins, "dropped")
    page.press("Orbit view")
    eventually(lambda: page.number not in grips._grips, "free views turn by a drag")


VIEW = rotation_matrix(np.array([0.4, -1.1, 0.7]))
STEP_M, STEP_RAD = 0.003, 0.05


def applied(name, root, pivot):
    edit = nudged(root, NUDGES[name], VIEW, pivot, STEP_M, STEP_RAD)
    return np.array([edit[key] for key in ROOT])


@pytest.mark.parametrize(
    ("name", "way"),
    [("left", (-1, 0, 0)), ("right", (1, 0, 0)), ("up", (0, -1, 0)), ("down", (0, 1, 0)),
     ("nearer", (0, 0, -1)), ("farther", (0, 0, 1))],
)  # fmt: skip
def test_a_move_goes_along_the_view(name, way, rng):
    root = rng.normal(size=6)
    after = applied(name, root, rng.normal(size=3))
    assert_allclose(VIEW.T @ (after[:3] - root[:3]), STEP_M * np.array(way), atol=1e-12)
    assert_allclose(after[3:], root[3:], atol=1e-9)


@pytest.mark.parametrize("name", [name for name in NUDGES if any(NUDGES[name][3:])])
def test_a_turn_leaves_the_middle_and_its_opposite_undoes_it(name, rng):
    root, pivot = rng.normal(size=6), rng.normal(size=3)
    after = applied(name, root, pivot)
    inside = rotation_matrix(root[3:]).T @ (pivot - root[:3])  # the middle, as the hand carries it
    assert_allclose(after[:3] + rotation_matrix(after[3:]) @ inside, pivot, atol=1e-9)
    opposite = next(n for n, nudge in NUDGES.items() if nudge[3:] == tuple(-v for v in NUDGES[name][3:]) and n != name)  # fmt: skip
    assert_allclose(applied(opposite, after, pivot), root, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "axis", "sign"), [("tilt up", 1, -1), ("turn left", 0, -1), ("turn right", 0, 1)]
)
def test_the_side_that_faces_the_viewer_goes_where_the_name_says(name, axis, sign):
    edit = nudged(np.zeros(6), NUDGES[name], np.eye(3), np.zeros(3), STEP_M, STEP_RAD)
    front = rotation_matrix(np.array([edit[key] for key in ROOT[3:]])) @ (0.0, 0.0, -0.1)
    assert sign * front[axis] > 0.004


HAND = load_model().parameter_names
BODY = load_model("body34").parameter_names


def copied_of(names, part=ALL):
    whole = CopiedPose(ALL, "a", 7, {name: 0.01 * i for i, name in enumerate(names)})
    return whole if part == ALL else CopiedPose(part, "a", 7, whole.pasted(names, part))


def test_a_pose_is_pasted_where_the_hand_is_or_with_its_place():
    copied = copied_of(HAND)
    joints = copied.pasted(HAND, ALL)
    assert set(joints) == set(HAND[6:])
    assert copied.pasted(HAND, ALL, with_place=True) == copied.parameters


def test_a_finger_is_pasted_into_itself_and_into_another():
    finger = copied_of(HAND, "Index")
    assert set(finger.parameters) == {n for n in HAND if n.startswith("index_")}
    given = finger.pasted(HAND, "Ring")
    assert given["ring_pip_flex"] == finger.parameters["index_pip_flex"]
    assert set(given) == {n for n in HAND if n.startswith("ring_")}
    assert copied_of(HAND).pasted(HAND, "Ring")["ring_pip_flex"] != given["ring_pip_flex"]
    thumb = finger.pasted(HAND, "Thumb")
    assert set(thumb) == {"thumb_mcp_flex"}, "what both have"


def test_an_arm_is_pasted_to_the_other_side_and_to_no_leg():
    arm = copied_of(BODY, "Left arm")
    given = arm.pasted(BODY, "Right arm")
    assert given["right_elbow_flex"] == arm.parameters["left_elbow_flex"]
    assert all(name.startswith("right_") for name in given)
    assert arm.pasted(BODY, "Left leg") == {}


def test_a_model_takes_what_it_has():
    simple = load_model("glove9").parameter_names
    assert set(copied_of(HAND).pasted(simple, ALL)) <= set(simple)
    assert copied_of(BODY, "Left arm").pasted(HAND, "Index") == {}


def test_it_is_kept_for_the_page_of_another_recording():
    assert read_copied() is None
    save_copied(copied_of(HAND, "Index"))
    assert read_copied() == copied_of(HAND, "Index")


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"part": "all", "session": "", "frame": 1, "parameters": [1]}',
     '{"part": "all", "session": "", "frame": 1, "parameters": {"index_mcp_flex": 1e999}}',
     '{"part": "all", "session": "", "frame": 1, "parameters": {"index_mcp_flex": "much"}}'],
)  # fmt: skip
def test_a_file_that_is_none_is_passed_over(text):
    save_copied(copied_of(HAND))
    (user_data_folder() / "copied_pose.json").write_text(text)
    assert read_copied() is None


RIGHT = np.array([1.0, 2.0, 0.5]) / np.linalg.norm([1.0, 2.0, 0.5])
MIDDLE = np.array([0.3, -0.1, 0.2])


def _image(places):
    return MIDDLE + (places - MIDDLE) @ (np.eye(3) - 2 * np.outer(RIGHT, RIGHT))


def _random(model, rng):
    values = model.joint_params(model.clipped(rng.normal(0.0, 0.4, len(model.transform.names))))
    values[:6] = rng.normal(0.0, 0.4, 6)
    found = mirrored(model.parameter_names, values, RIGHT, MIDDLE)
    return values, np.array([found[name] for name in model.parameter_names])


def _joints(model, values):
    return model.joint_positions(model.bones(model.transform.solver_params(values)))


def test_a_body_s_image_has_its_limbs_on_the_other_side(rng):
    model = load_model("body34")
    values, image = _random(model, rng)
    swap = {"left": "right", "right": "left"}
    other = ["_".join(swap.get(part, part) for part in n.split("_")) for n in model.joint_names]
    order = [model.joint_names.index(name) for name in other]
    assert_allclose(_joints(model, image)[order], _image(_joints(model, values)), atol=1e-12)


def test_a_right_hand_s_image_is_a_left_hand_s_pose(rng):
    right, left = load_model(side="right"), load_model(side="left")
    values, image = _random(right, rng)
    assert_allclose(_joints(left, image), _image(_joints(right, values)), atol=1e-12)


def test_a_pose_is_taken_from_the_pictures_for_the_fingers_alone(bench, wire, page):
    flex = bench.state.names.index("index_pip_flex")
    bench.page.edit_pose({"root_tx": 0.02}, "Move")
    page.press("Poses in pictures")
    eventually(lambda: wire.button("Z"), "the window is open")
    wire.press("Fist")
    eventually(lambda: _pose(bench).values[flex] > 1.5, "taken")
    assert _pose(bench).values[0] == pytest.approx(0.02)
