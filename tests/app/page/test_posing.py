"""Correcting a pose: the palm dragged and turned, a joint pulled freely or pinned in a camera's picture, flipped,
copied, tuned; what is told of it."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from handtrack import load_model
from handtrack.geometry.rotation import rotation_matrix
from handtrack_app import protocol
from handtrack_app.engine import tuning_service
from handtrack_app.engine.document_snapshots import pose_snapshot, session_snapshot
from handtrack_app.page.scene.grips import dragged_root, hold_at
from tests.app.fake_run import fake_document
from tests.app.waiting import eventually


def _pose(bench):
    return bench.stage.pose


def test_the_palm_takes_the_hand_along_and_shift_turns_it(bench, page):
    """It comes under the pointer as deep as it was, and turns about the line of sight to its middle."""
    page.press("Camera view: front")
    eventually(lambda: page.client.grip)
    before, session, card = _pose(bench), bench.stage.session, page.view.card
    palm = before.centre[_ellipsoid(session, "ring_metacarpal")]
    aim = palm + card.rotation.T @ (0.02, 0.01, 0.05)
    page.drag("/grips/flesh", palm, aim)
    way, ahead = aim - card.centre, card.rotation[2]
    place = card.centre + way * ((palm - card.centre) @ ahead) / (way @ ahead)
    eventually(lambda: np.allclose(_pose(bench).values[:3] - before.values[:3], place - palm, atol=1e-6))  # fmt: skip
    assert_allclose(_pose(bench).values[3:], before.values[3:], atol=1e-9)
    moved = _pose(bench)
    eventually(lambda: bench.stage.grips._pose is moved, "what is held next is the moved hand")
    assert not moved.pins
    tip = moved.joints[session.joint_names.index("index_tip")]
    axis = moved.middle - card.centre
    quarter = rotation_matrix(axis / np.linalg.norm(axis) * np.pi / 2)
    page.drag("/grips/flesh", tip, moved.middle + quarter @ (tip - moved.middle), "shift")
    turned = moved.middle + (moved.joints - moved.middle) @ quarter.T
    eventually(lambda: np.allclose(_pose(bench).joints, turned, atol=2e-3))
    assert_allclose(_pose(bench).values[6:], before.values[6:], atol=1e-9)
    page.press("Undo")
    eventually(lambda: np.allclose(_pose(bench).values, moved.values, atol=1e-9), "a drag is a step")  # fmt: skip


def test_seen_freely_shift_pulls_a_middle_joint_parallel_to_the_screen(bench, page):
    before, session = _pose(bench), bench.stage.session
    bench.layout.page.draw("handle", False)  # it stands before the hand, and takes the pointer
    bench.stage.apply()
    at = session.joint_names.index("index_pip")
    pip = before.joints[at]
    aim = pip + (0.0, -0.006, -0.012)
    page.drag("/grips/free", pip, aim, "shift")
    eventually(lambda: np.linalg.norm(_pose(bench).joints[at] - aim) < 0.008)
    assert _pose(bench).origin == "set" and not _pose(bench).pins
    others = [i for i, n in enumerate(session.parameter_names) if not n.startswith("index")]
    assert_allclose(_pose(bench).values[others], before.values[others], atol=1e-9)


def test_space_flips_and_all_of_the_page_says_so(bench, page):
    before, panel = _pose(bench), bench.layout.pose
    bench.engine.take_pose(3, "fist", bench.state.begin_edit())
    eventually(lambda: _pose(bench).origin == "set" and panel.sliders["index_pip_flex"].value > 90)
    fist = _pose(bench)
    page.press("Before/after: the pose before the last step")
    eventually(lambda: bench.layout.aside.visible)
    assert _pose(bench).origin == protocol.BEFORE
    assert_allclose(_pose(bench).values, before.values, atol=1e-9)
    assert panel.sliders["index_pip_flex"].value < 30
    assert not bench.stage.root.control.visible  # type: ignore[union-attr]
    assert bench.state.values == tuple(fist.values.tolist()), "edits go on from what is"
    page.press("Before/after: the pose before the last step")
    eventually(lambda: not bench.layout.aside.visible)
    assert_array_equal(_pose(bench).values, fist.values)
    assert bench.stage.root.control.visible  # type: ignore[union-attr]


def test_a_pose_is_copied_and_pasted_by_keys(bench, page):
    bench.engine.take_pose(3, "point", bench.state.begin_edit())
    panel = bench.layout.pose  # what it shows is copied
    eventually(lambda: panel.pose and panel.pose.origin == "set")
    point = _pose(bench)
    page.press("Copy the pose")
    eventually(lambda: "frame 3" in panel.copied_from.content)
    bench.go_to(9)
    bench.engine.take_pose(9, "fist", bench.state.begin_edit())
    eventually(lambda: _pose(bench).frame == 9 and _pose(bench).origin == "set")
    page.press("Paste the pose that was copied")
    eventually(lambda: np.allclose(_pose(bench).values[6:], point.values[6:], atol=1e-9))
    assert _pose(bench).frame == 9
    page.press("Undo")
    eventually(lambda: not np.allclose(_pose(bench).values[6:], point.values[6:]))
    before, panel.copied = _pose(bench), dict.fromkeys(load_model("body34").parameter_names, 0.01)
    page.press("Paste the pose that was copied")
    eventually(lambda: "copied" in bench.layout.messages.note.content)
    assert_array_equal(_pose(bench).values, before.values, "a body's is not pasted into a hand")


def test_the_switch_refits_the_frame_that_is_shown(bench, monkeypatch, page):
    monkeypatch.setattr(
        tuning_service, "fitted_again", lambda _m, _s, _seen, params, _stop: params + 0.01
    )
    page.press("Refit while tuning: on, off")
    boxes = bench.layout.settings.refits.boxes
    eventually(lambda: [box.value for box in boxes] == [True, True])
    bench.engine.set_setting("cloud.balance", 0.8)
    eventually(lambda: _pose(bench).origin == "refitted")
    eventually(lambda: "refitted" in bench.layout.pose.card.content)


@pytest.fixture
def shown(tmp_path):
    document = fake_document(tmp_path)
    session, pose = session_snapshot(document), pose_snapshot(document)
    return session, pose, document.session.rig["front"].without_distortion()


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
    behind = card.centre - card.rotation[2]
    assert hold_at(session, pose, card, 0, behind) is None
    for middle in (None, pose.middle):
        root_at = partial(dragged_root, card, pose.values[:6], pose.joints[0], middle)
        assert root_at(behind) is None
    assert root_at(pose.middle) is None, "on the axis itself"


def test_a_drag_in_a_camera_s_picture_pins_a_joint_there_and_the_hand_follows(bench, page):
    page.press("Camera view: front")
    eventually(lambda: page.client.grip)
    pose, session = bench.stage.pose, bench.stage.session
    tip = pose.joints[session.joint_names.index("index_tip")]
    aim = tip + 0.02 * page.view.card.rotation[0]
    page.drag("/grips/flesh", tip, aim, part=_ellipsoid(session, "index_distal"))

    def follows():
        now = bench.stage.pose
        if not now.pins or now.pins[0].off_px >= 0.5:
            return False
        moved = now.joints[session.joint_names.index("index_tip")] - tip
        return np.linalg.norm(moved) > 0.015

    eventually(follows)
    eventually(lambda: bench.layout.pose.pins.pins == bench.stage.pose.pins)
    (pin,) = bench.stage.pose.pins
    assert (pin.camera, pin.words) == ("front", "index tip")
    page.press("Remove the last pin")
    eventually(lambda: not bench.stage.pose.pins)
    page.press("Orbit view")
    eventually(lambda: not page.client.grip, "free views turn by a drag")
