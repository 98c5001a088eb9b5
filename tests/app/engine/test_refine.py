"""Refining: a take of its own over what was tracked, only what has changed, told in the end. Neither it nor tracking changes accepted frames.
Pins: a joint is pulled to a pixel, the hand follows; undone, dropped, copied, kept, tracked and refined by."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import HandScale
from handtrack.store.store import Store
from handtrack.tracking.whole.refinement import Refinement
from handtrack_app import protocol
from handtrack_app.engine import edits
from handtrack_app.engine.persistence import whole_track
from handtrack_app.protocol import Hold
from tests.app.desk import a_desk, pose_with
from tests.app.fake_run import FRAMES
from tests.app.opened import opened, tracked
from tests.app.waiting import eventually

BY = 0.3


DESK = {"refined_by": BY}


def bends(worker):
    at = worker.document.model.parameter_names.index("index_mcp_flex")
    return {f: float(r.parameters[at]) for f, r in worker.document.results.items()}


def _tracked(desk):
    worker, listener = desk
    worker.engine.track(0, FRAMES, 3, anew=True)
    listener.told("Tracking finished")


def test_what_was_tracked_is_refined_as_a_take_of_its_own_with_the_size_that_it_found(tmp_path):
    for worker, listener in a_desk(tmp_path, step_s=0.0, refined_by=BY, refined_size=1.07):
        document, store = worker.document, Store(tmp_path / "tracks")
        live = document.run.scale
        _tracked((worker, listener))
        refined = bends(worker)
        assert document.run.scale.overall == 1.07
        takes = store.takes()
        assert [take.about.by for take in takes] == ["handtrack open", "handtrack open, refined"]
        assert all(take.is_finished for take in takes)
        scales = [json.loads(take.about.labels.scale)["overall"] for take in takes]
        assert scales == [live.overall, 1.07]
        assert document.size.live == live
        told = whole_track(document).refinement
        assert told is not None and Refinement.read(told).scale == HandScale(1.07)
        assert takes[1].about.labels.refinement == told
        worker.engine.undo(1)
        eventually(lambda: document.run.scale == live)  # noqa: B023
        eventually(lambda: whole_track(document).refinement is None)  # noqa: B023
        assert [refined[f] - b for f, b in bends(worker).items()] == pytest.approx([BY] * FRAMES)


def test_only_what_a_new_keyframe_touches_is_refined_again(desk, worker, listener):
    _tracked(desk)
    before = bends(worker)
    worker.engine.set_pose(8, pose_with(listener, index_mcp_flex=0.3), 1)
    worker.engine.refine()
    listener.told("Refined: ")
    after = bends(worker)
    assert {f for f in before if after[f] != before[f]} == {7, 9}
    worker.engine.set_setting("tracker.smoothing", 0.5)
    said = len(listener.seen)
    worker.engine.refine()
    listener.told("Refined: ", said)
    last = bends(worker)
    assert {f for f in before if last[f] != after[f]} == set(before) - {8}, "another setting"


def _accept(worker, first, last, on=True):
    worker.engine.accept(((first, last),), on)
    wanted = set(range(first, last + 1))
    eventually(lambda: wanted <= worker.document.accepted or not on)


def test_tracking_again_and_refining_leave_accepted_frames(desk, worker, listener):
    _tracked(desk)
    before = bends(worker)
    _accept(worker, 5, 6)
    worker.engine.set_pose(9, pose_with(listener, index_mcp_flex=0.3), 1)
    said = len(listener.seen)
    worker.engine.track(0, FRAMES, 9)
    listener.told("Tracking finished", said)
    after = bends(worker)
    assert {f for f in before if after[f] == before[f]} == {5, 6, 9}, "9 is a keyframe"
    worker.engine.refine()
    listener.told("Refined: ")
    last = bends(worker)
    assert {f for f in before if last[f] == after[f]} == {5, 6, 9}
    worker.engine.restore_take(1)
    listener.told("Take 1 is the track again")
    restored = bends(worker)
    assert restored[5] == before[5] and restored[7] != last[7]


def test_an_accepted_frame_is_not_fitted_until_it_is_let_go(desk, worker, listener):
    _tracked(desk)
    _accept(worker, 4, 4)
    worker.engine.track(4, 5, 4)
    listener.told("Frame 4 is accepted")
    _accept(worker, 4, 4, on=False)
    worker.engine.track(4, 5, 4)
    listener.told("Frame 4 is fitted")


def test_frames_without_a_pose_cannot_be_accepted(tmp_path, left_open):
    store = tracked(opened(tmp_path), range(3, 6))
    edit = edits.accepted(store.document, range(FRAMES), on=True)
    assert edit(store.document.state).accepted == ((3, 6),)


def test_a_frame_accepted_while_tracking_runs_stays(tmp_path, left_open):
    store = tracked(opened(tmp_path))
    document, before = store.document, store.document.results[6]
    params = document.start_params(3) + 0.01
    store.begin_take(document.frames, 3, params)
    store.do("Accepted", edits.accepted(document, range(6, 7), on=True))
    for result in document.run.track(document.frames, 3, params):  # type: ignore[attr-defined]
        store.add(result)
    store.end_take(finished=True)
    assert document.results[6] is before
    assert document.results[7].parameters[0] != before.parameters[0]


def _tip(pose, document):
    return pose.joints[document.model.joint_names.index("index_tip")]


def _pull(worker, listener, version, by=(0.0, -0.02, 0.01), frame=3):
    """Pull the index finger's tip by so much in both cameras; return where to."""
    pose = listener.wait(protocol.PoseSnapshot, lambda p: p.frame == frame)
    target = _tip(pose, worker.document) + by
    for n, camera in enumerate(("front", "side")):
        view = worker.document.session.rig[camera].without_distortion()
        pixel = tuple(map(float, view.project(target)))
        worker.engine.set_pin(
            frame, camera, pixel, version + n, Hold("index_tip"), tag=f"drag {version}"
        )
    return target


def test_a_joint_that_is_pulled_in_two_pictures_comes_to_the_point_until_pins_are_dropped(
    worker, listener
):
    _pull(worker, listener, 1, by=(0.0, 0.0, 0.01))
    first = listener.pose(2)
    target = _pull(worker, listener, 3)
    pose = listener.pose(4)
    assert pose.origin == "pinned"
    assert np.linalg.norm(_tip(pose, worker.document) - target) < 1e-3
    pins = [(pin.camera, pin.words) for pin in pose.pins]
    assert pins == [("front", "index tip"), ("side", "index tip")], "the ones before are replaced"
    assert max(pin.off_px for pin in pose.pins) < 0.3
    worker.engine.undo(5)
    assert_allclose(listener.pose(5).values, first.values, err_msg="one drag is one step")
    worker.engine.drop_pins(3, 0, 6)
    assert [pin.camera for pin in listener.pose(6).pins] == ["side"]
    worker.engine.drop_pins(3, None, 7)
    assert (listener.pose(7).pins, listener.pose(7).origin) == ((), "carried")


def test_what_is_no_pin_is_refused_in_words(worker, listener):
    pins = (
        ("front", (float("nan"), 1.0), "index_tip"),
        ("front", (1e9, 1.0), "index_tip"),
        ("nowhere", (1.0, 1.0), "index_tip"),
        ("front", (1.0, 1.0), "wing"),
    )
    for version, (camera, pixel, joint) in enumerate(pins, 1):
        worker.engine.set_pin(3, camera, pixel, version, Hold(joint))
        eventually(lambda n=version: len(_errors(listener)) == n)
    assert not any("internal" in text.lower() for text in _errors(listener))
    assert worker.document.session.pins.frames == []


def _errors(listener):
    return [f"{n.title} {n.text}" for n in listener.notices if n.level == "error"]


def test_a_frame_with_pins_is_tracked_and_refined_from_where_they_led(desk, worker, listener):
    _tracked(desk)
    worker.engine.show_frame(8)
    _pull(worker, listener, 1, frame=8)
    listener.wait(protocol.PoseSnapshot, lambda p: p.version == 2 and p.origin == "pinned")
    pinned, before = worker.document.pose_at(8), bends(worker)
    assert worker.document.by_hand.keys() == {8} and worker.document.decided_pose(8).is_led
    worker.engine.refine()
    listener.told("Refined: ")
    after = bends(worker)
    assert {f for f in before if after[f] != before[f]} == {7, 8, 9}, "only what pins touch"
    assert worker.document.pose_at(8).tolist() != pinned.tolist(), "what was refined shows"
    worker.engine.undo(3)
    eventually(lambda: worker.document.pose_at(8).tolist() == pinned.tolist())


def test_pins_come_back_with_the_session_unless_their_file_was_changed_elsewhere(
    worker, listener, tmp_path, left_open
):
    _pull(worker, listener, 1)
    pulled = listener.pose(2)
    worker.stop()
    path = tmp_path / "pins.json"
    rows = json.loads(path.read_text())["pins"]
    assert [(row["frame"], row["joint"]) for row in rows] == [(3, "index_tip")] * 2
    again = opened(tmp_path)
    for back, pin in zip(again.document.session.pins.of(3), pulled.pins, strict=True):
        assert_allclose(back.pixel, pin.pixel, atol=2e-3)
    assert again.document.decided_pose(3).pinned
    other = {"frame": 6, "camera": "side", "joint": "wrist", "pixel": [40.0, 30.0]}
    path.write_text(json.dumps({"format": 1, "pins": [other]}))
    elsewhere = opened(tmp_path)
    assert elsewhere.document.session.pins.frames == [6]
    assert 3 not in elsewhere.document.state.pins
