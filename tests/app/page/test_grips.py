"""What a pointer takes hold of in a camera's picture, and the hand that follows it: pure, and on the wire."""

import numpy as np
import pytest

from handtrack_app.engine.document_snapshots import pose_snapshot, session_snapshot
from handtrack_app.page.pins.grips import WholeDrag, hold_at
from handtrack_app.protocol.snapshots import CameraCard
from tests.app.fake_run import fake_document
from tests.app.waiting import eventually


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
