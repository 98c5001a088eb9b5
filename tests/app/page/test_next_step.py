"""The button over the timeline leads a newcomer from the first pose to the end, and goes on after a cancelled tracking."""

import numpy as np

from tests.app.desk import shown, value_of
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def _status(bench):
    strip = bench.layout.timeline.strip
    return strip.status


def test_it_leads_from_the_pose_over_tracking_to_the_review(bench, wire):
    layout = bench.layout
    eventually(lambda: layout.next.button.visible, "a step is offered")
    wire.set_value(layout.next.button, True)
    eventually(lambda: all(_status(bench) >= 0) and layout.next.button.visible, "tracked")
    wire.set_value(layout.next.button, True)
    eventually(lambda: bench.state.frame == 7, "the doubtful frame")
    eventually(lambda: not layout.next.button.visible, "it has done its work")
    wire.set_value(layout.review.accept_next, True)
    eventually(lambda: layout.review.done == 1, "accepted")
    eventually(lambda: layout.next.button.visible, "and what comes after")
    wire.set_value(layout.pose.edit_buttons, "Undo")
    eventually(lambda: layout.review.done == 0, "it is to be looked at again")


def test_a_cancelled_tracking_is_gone_on_with(tmp_path):
    opener = lambda f: fake_document(f, step_s=0.05)  # noqa: E731
    with shown(tmp_path, opener=opener) as bench, WireClient(bench.url) as client:
        button = bench.layout.next.button
        bench.engine.track(3, FRAMES, 3)
        eventually(lambda: (_status(bench) >= 0).sum() > 2, "some frames")
        assert not button.visible, "it is under way"
        bench.engine.cancel()
        eventually(lambda: bench.layout.progress.state == "idle", "cancelled")
        assert np.flatnonzero(_status(bench) >= 0)[-1] < FRAMES - 1
        eventually(lambda: button.visible, "it can go on")
        client.set_value(button, True)
        eventually(lambda: all(_status(bench)[3:] >= 0), "to the end")
        assert (_status(bench)[:3] < 0).all(), "only from where it ended"


def test_a_step_of_the_list_is_gone_back_to_and_made_again(bench, wire):
    state, history = bench.state, bench.layout.pose.history
    for name, angle in (
        ("index_mcp_flex", 20.0),
        ("ring_mcp_flex", 30.0),
        ("thumb_ip_flex", 15.0),
    ):
        wire.set_value(bench.layout.pose.sliders[name], angle)
        eventually(lambda name=name: abs(np.rad2deg(value_of(state, name)) - angle) < 0.1, name)  # noqa: B023
    eventually(lambda: len(history.options) == 4, "three steps, and now")
    second = next(one for one in history.options if "Ring" in one)
    wire.set_value(history, second)
    eventually(lambda: abs(np.rad2deg(value_of(state, "ring_mcp_flex")) - 30.0) > 1, "before it")
    assert abs(np.rad2deg(value_of(state, "index_mcp_flex")) - 20.0) < 0.1, "the first one holds"
    eventually(lambda: len(history.options) == 4 and history.options[2] == "now", "two undone")
    wire.set_value(history, history.options[0])
    eventually(lambda: abs(np.rad2deg(value_of(state, "thumb_ip_flex")) - 15.0) < 0.1, "again")
