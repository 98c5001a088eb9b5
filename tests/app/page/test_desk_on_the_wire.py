"""Correcting a pose on the wire: the palm dragged and turned, a joint pulled freely, flipped, copied, tuned; what is told of it."""

import numpy as np
import pytest

from handtrack.geometry.rotation import rotation_matrix
from handtrack_app.engine import tuning_service
from handtrack_app.protocol import snapshots
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
    np.testing.assert_allclose(_pose(bench).values[3:], before.values[3:], atol=1e-9)
    moved = _pose(bench)
    assert not moved.pins
    tip = moved.joints[session.joint_names.index("index_tip")]
    axis = (moved.middle - card.centre) / np.linalg.norm(moved.middle - card.centre)
    quarter = rotation_matrix(axis * np.pi / 2)
    page.drag("/grips/flesh", tip, moved.middle + quarter @ (tip - moved.middle), "shift")
    turned = moved.middle + (moved.joints - moved.middle) @ quarter.T
    eventually(lambda: np.allclose(_pose(bench).joints, turned, atol=2e-3), "by a quarter")
    np.testing.assert_allclose(_pose(bench).values[6:], before.values[6:], atol=1e-9)
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
    np.testing.assert_allclose(_pose(bench).values[others], before.values[others], atol=1e-9)


def test_space_flips_and_all_of_the_page_says_so(bench, page):
    before, panel = _pose(bench), bench.layout.pose
    bench.engine.take_pose(3, "fist", bench.state.begin_edit())
    eventually(lambda: _pose(bench).origin == "set" and panel.sliders["index_pip_flex"].value > 90, "a fist")  # fmt: skip
    fist = _pose(bench)
    page.press("Before/after: the pose before the last step")
    eventually(lambda: bench.layout.aside.visible, "told")
    assert _pose(bench).origin == snapshots.BEFORE
    np.testing.assert_allclose(_pose(bench).values, before.values, atol=1e-9)
    assert "before the last step" in panel.card.content
    assert panel.sliders["index_pip_flex"].value < 30
    assert not bench.stage.root.control.visible  # type: ignore[union-attr]
    assert bench.state.values == tuple(fist.values.tolist()), "edits go on from what is"
    page.press("Before/after: the pose before the last step")
    eventually(lambda: not bench.layout.aside.visible, "back")
    np.testing.assert_array_equal(_pose(bench).values, fist.values)
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
    np.testing.assert_allclose(_pose(bench).values[6:], point.values[6:], atol=1e-9)
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
