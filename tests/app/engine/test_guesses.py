"""Poses a frame may have: the hand found without a first pose, hypotheses as ghosts, one of them taken and undone."""

import threading
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack import HandScale, HandtrackError, load_model
from handtrack.tracking.find_pose import PoseEstimate
from handtrack.tracking.frame.result import Alternative
from handtrack_app.engine import job_control
from handtrack_app.engine.job_control import Guesses
from tests.app.fake_run import fake_document
from tests.app.opened import did, opened
from tests.app.waiting import eventually

WAYS = ((0.03, 0.9, "no forearm in view"), (0.08, 0.06, "turned by 170°"))
"""where the hand is along x [m], how sure, and in words"""


def candidates(run, frame):
    """Return two poses of a frame, the relaxed hand in two places."""
    found = []
    for place, share, words in WAYS:
        params = run.model.rest_params()
        params[0] = place
        found.append(
            PoseEstimate(run.model, params, 1.0, confidence=share, frame=frame, note=words)
        )
    return found


@pytest.fixture
def search(monkeypatch):
    """The search finds two poses once the event is set; it tells how far it is, and stops when asked."""
    go = threading.Event()

    def find(run, frame, should_stop, on_progress):
        on_progress(0.4, "40 of 100 starts")
        while not go.wait(0.01):
            if should_stop():
                return []
        found = candidates(run, 5 if frame is None else frame)
        left = load_model(side="left")
        other = left.keypoints21(left.bones(left.rest_params()))
        return {8: [replace(found[0], points=other)], 9: []}.get(frame, found)

    monkeypatch.setattr(job_control, "find_first_poses", find)
    yield go
    go.set()


def test_the_hand_is_found_taken_and_can_be_undone(bench, wire, search):
    panel, state, ghosts = bench.layout.guesses, bench.state, bench.stage.ghosts
    before = state.values
    wire.set_value(panel.find, "best frame")
    eventually(lambda: panel.cancel.visible and not panel.find.visible)
    shown = bench.state.progress
    eventually(lambda: (shown.text, shown.done, shown.total) == ("40 of 100 starts", 40, 100))
    search.set()
    eventually(lambda: state.frame == 5 and abs(state.values[0] - 0.03) < 1e-9, "the surest taken")
    eventually(lambda: not panel.cancel.visible and panel.find.visible)
    eventually(lambda: panel.takes.options == ("1", "2"))
    eventually(lambda: ghosts.bones.visible)
    assert np.abs(ghosts.bones.vertices).max() < 0.01  # viser's hidden one takes no pointer
    eventually(lambda: ">found<" in bench.layout.pose.card.content)
    wire.set_value(panel.takes, "2")
    eventually(lambda: abs(state.values[0] - 0.08) < 1e-9)
    wire.trigger("Undo")
    eventually(lambda: abs(state.values[0] - 0.03) < 1e-9)
    wire.trigger("Undo")
    eventually(lambda: np.allclose(state.values, before))
    bench.go_to(6)
    eventually(lambda: not ghosts.bones.visible and not panel.folder.visible)
    bench.go_to(5)
    eventually(lambda: ghosts.bones.visible)


def test_a_found_pose_brings_the_size_that_it_was_found_with(tmp_path):
    store = opened(tmp_path, size_pending=True)
    document = store.document
    small = document.run.with_scale(HandScale(0.8))
    guesses = Guesses(document)
    guesses.keep([replace(c, model=small.model) for c in candidates(document.run, 5)])
    did(store, guesses.take(5, 0))
    assert (document.model.scale, document.size.pending) == (HandScale(0.8), True)
    assert document.decided_pose(5).found
    assert guesses.take(5, 1)(document.state).size is document.state.size, "of the same size"
    store.close()
    again = opened(tmp_path, size_pending=True)
    again.close()
    assert (again.document.model.scale, again.document.size.pending) == (HandScale(0.8), True)
    known = fake_document(tmp_path)  # its size is settled
    others = Guesses(known)
    others.keep([replace(c, model=small.model) for c in candidates(known.run, 5)])
    assert others.take(5, 0)(known.state).size is None


def test_a_search_can_be_cancelled_and_may_find_nothing(bench, wire, search, monkeypatch):
    def fetch(should_stop):
        raise HandtrackError("no network")

    monkeypatch.setattr(job_control, "fetch_weights", fetch)
    panel, messages = bench.layout.guesses, bench.layout.messages
    wire.set_value(panel.fetch, True)
    eventually(lambda: "no network" in messages.said.content)
    bench.engine.find_hand(9)
    eventually(lambda: panel.cancel.visible)
    bench.engine.cancel()
    eventually(lambda: not panel.cancel.visible, "cancelled before the search came to its end")
    search.set()
    bench.engine.find_hand(9)
    eventually(lambda: "No hand found" in messages.said.content)
    assert panel.guesses is None
    bench.engine.find_hand(8)
    eventually(lambda: "a left hand" in messages.said.content, "joints of the other hand are told")


def test_hypotheses_that_the_tracker_carries_are_ghosts(bench):
    document = bench.worker.document
    model = document.model
    (result,) = document.run.track(range(4, 5), 4, model.rest_params())
    other = model.clipped(model.transform.solver_params(result.parameters) + 0.1)
    carried = (
        Alternative(result.parameters, 3.0, 0.7, 0, "followed"),
        Alternative(model.joint_params(other), 4.0, 0.3, 0, "index jumped"),
    )
    store = bench.worker.session.store
    store.begin_take(range(4, 5), 4, model.rest_params())
    store.add(replace(result, alternatives=carried))
    store.end_take(finished=True)
    bench.go_to(4)
    panel, ghosts = bench.layout.guesses, bench.stage.ghosts
    eventually(lambda: panel.guesses and ghosts.bones.visible)
    count = len(model.skeleton.bone_names)
    bones = model.bones(other)
    assert_allclose(ghosts.bones.batched_positions[count:], bones.position, atol=1e-6)
    version = bench.state.version
    bench.stage.take_guess(int(panel.guesses.owner[count + 2]))
    eventually(lambda: bench.state.version > version and 4 in document.by_hand)
    assert_allclose(document.by_hand[4], carried[1].parameters, atol=1e-9)
    bench.layout.page.draw("ghosts", False)
    assert not ghosts.bones.visible
