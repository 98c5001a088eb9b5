"""Pins in the workbench: a joint is pulled to a pixel, the hand follows, it is undone, dropped, copied, kept, and tracked by."""

import json
from types import SimpleNamespace
from typing import cast

import numpy as np

from handtrack.observation.pins import Pin
from handtrack_app.engine.open_session import OpenSession
from handtrack_app.engine.posing_service import PosingService
from handtrack_app.protocol import snapshots
from handtrack_app.protocol.snapshots import Hold
from tests.app.calls import call
from tests.app.engine.test_refine import _bends, _told
from tests.app.fake_run import FRAMES
from tests.app.opened import opened, tracked
from tests.app.waiting import eventually

DESK = {"refined_by": 0.3}


def _tip(pose, document):
    return pose.joints[document.model.joint_names.index("index_tip")]


def _pixel(document, place, camera="front"):
    x, y = document.run.session.rig[camera].without_distortion().project(place)
    return float(x), float(y)


def _pull(worker, listener, version, by=(0.0, -0.02, 0.01), frame=3):
    """Pull the index finger's tip by so much in both cameras; return where to."""
    pose = listener.wait(snapshots.PoseSnapshot, lambda p: p.frame == frame)
    target = _tip(pose, worker.document) + by
    for n, camera in enumerate(("front", "side")):
        pixel = _pixel(worker.document, target, camera)
        worker.engine.set_pin(
            frame, camera, pixel, version + n, Hold("index_tip"), tag=f"drag {version}"
        )
    return target


def test_a_joint_that_is_pulled_in_two_pictures_comes_to_the_point(
    worker,
    listener,
):
    target = _pull(worker, listener, 1)
    pose = listener.pose(2)
    assert pose.origin == "pinned"
    assert np.linalg.norm(_tip(pose, worker.document) - target) < 1e-3
    assert [(pin.camera, pin.words) for pin in pose.pins] == [
        ("front", "index tip"), ("side", "index tip"),
    ]  # fmt: skip
    assert max(pin.off_px for pin in pose.pins) < 0.3
    worker.engine.undo(3)
    pose = listener.pose(3)
    assert not pose.pins, "one drag is one step"


def test_a_pin_replaces_the_one_of_its_place_and_camera_and_is_dropped(
    worker,
    listener,
):
    _pull(worker, listener, 1)
    listener.pose(2)
    _pull(worker, listener, 3, by=(0.0, 0.0, 0.01))
    pose = listener.pose(4)
    assert len(pose.pins) == 2
    worker.engine.drop_pins(3, 0, 5)
    pose = listener.pose(5)
    assert [pin.camera for pin in pose.pins] == ["side"]
    worker.engine.drop_pins(3, None, 6)
    pose = listener.pose(6)
    assert (pose.pins, pose.origin) == ((), "carried")


def test_what_is_no_pin_is_refused_in_words(worker, listener):
    for version, pin in enumerate((
        call("set_pin", 3, "front", (float("nan"), 1.0), 1, Hold("index_tip")),
        call("set_pin", 3, "front", (1e9, 1.0), 2, Hold("index_tip")),
        call("set_pin", 3, "nowhere", (1.0, 1.0), 3, Hold("index_tip")),
        call("set_pin", 3, "front", (1.0, 1.0), 4, Hold("wing")),
    )):  # fmt: skip
        worker.send(pin)
        eventually(lambda n=version: len(_errors(listener)) == n + 1, "told")
    assert not any("internal" in text.lower() for text in _errors(listener))
    assert worker.document.run.session.pins.frames == []


def _errors(listener):
    notices = [s for s in listener.seen if isinstance(s, snapshots.Notice)]
    return [f"{n.title} {n.text}" for n in notices if n.level == "error"]


def test_a_frame_with_pins_is_tracked_and_refined_from_where_they_led(
    worker,
    listener,
):
    worker.engine.track(0, FRAMES, 3, anew=True)
    eventually(lambda: len(_told(listener, "Tracking finished")) == 1, "tracked")
    worker.engine.show_frame(8)
    _pull(worker, listener, 1, frame=8)
    listener.wait(snapshots.PoseSnapshot, lambda p: p.version == 2 and p.origin == "pinned")
    pinned, before = worker.document.pose_at(8), _bends(worker)
    assert not worker.document.keyframes(range(FRAMES))
    worker.engine.refine()
    eventually(lambda: len(_told(listener, "Refined")) == 1, "refined")
    after = _bends(worker)
    assert {f for f in before if after[f] != before[f]} == {7, 8, 9}, "only what pins touch"
    assert worker.document.pose_at(8).tolist() != pinned.tolist(), "what was refined shows"
    worker.engine.undo(3)
    eventually(lambda: worker.document.pose_at(8).tolist() == pinned.tolist(), "where pins led")


def _posing(store):
    """Return the service of a session without jobs and pages, whose edits are written at once."""
    edit = lambda _frame, edit, words, *_: store.do(words, edit)  # noqa: E731
    opened_ = SimpleNamespace(
        document=store.document, store=store, jobs=None, publish=None, edit=edit
    )
    return PosingService(cast("OpenSession", opened_))


def _with_pin(store, frame):
    document = store.document
    model = document.model
    bones = model.bones(model.params_within_limits(document.pose_at(frame)))
    at = model.joint_positions(bones)[model.joint_names.index("ring_tip")]
    pin = Pin("front", _pixel(document, at + (0.0, -0.01, 0.0)), "ring_tip")
    _posing(store).set_pin(frame, pin.camera, pin.pixel, 1, Hold("ring_tip"), tag="drag")
    return pin


def test_pins_are_written_and_come_back_with_the_session(tmp_path, left_open):
    store = tracked(opened(tmp_path))
    pin = _with_pin(store, 5)
    (row,) = json.loads((tmp_path / "pins.json").read_text())["pins"]
    assert (row["frame"], row["joint"]) == (5, "ring_tip")
    again = opened(tmp_path)
    (back,) = again.document.run.session.pins.of(5)
    np.testing.assert_allclose(back.pixel, pin.pixel, atol=2e-3)
    assert again.document.decided_pose(5).pinned
    again.undo()
    assert not (tmp_path / "pins.json").exists()


def test_who_changed_the_file_elsewhere_is_right(tmp_path, left_open):
    _with_pin(tracked(opened(tmp_path)), 5)
    other = {"frame": 6, "camera": "side", "joint": "wrist", "pixel": [40.0, 30.0]}
    (tmp_path / "pins.json").write_text(json.dumps({"format": 1, "pins": [other]}))
    again = opened(tmp_path)
    assert again.document.run.session.pins.frames == [6]
    assert 5 not in again.document.state.pins


def test_copied_pins_move_as_what_was_tracked_moves(tmp_path, left_open):
    store = tracked(opened(tmp_path))
    document = store.document
    pin = _with_pin(store, 5)
    _posing(store).copy_pins(5, 1, 2, 2)
    assert document.run.session.pins.frames == [4, 5, 6, 7]
    (copy,) = document.run.session.pins.of(7)
    at = document.model.joint_names.index("ring_tip")
    moves = [
        _pixel(document, document.results[f].joint_positions[at]) for f in (5, 7)
    ]  # fmt: skip
    np.testing.assert_allclose(
        np.subtract(copy.pixel, pin.pixel), np.subtract(moves[1], moves[0]), atol=2e-3
    )
    assert np.linalg.norm(np.subtract(*moves)) > 0.1, "it moves"
