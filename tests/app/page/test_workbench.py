"""The workbench on loopback: handles follow the worker, clients' values are checked, the hand moves at once; two pages edit, and each looks
through a camera of its own; the next step is offered; settings are undone; names of files are text."""

import json
import threading
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

import numpy as np
import viser

from handtrack_app import protocol
from tests.app.desk import shown, value_of
from tests.app.engine.test_saving_settings import TEXT
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.app.wire import WireClient, said
from tests.session.small_session import edit


def test_a_root_pose_beyond_reason_does_nothing_and_a_good_one_moves_the_hand(bench, wire):
    control = bench.stage.root.control
    for x in (1e6, 0.05):
        wire.send({
            "type": "TransformControlsUpdateMessage", "name": "/root",
            "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [x, 0.0, 0.0],
        })  # fmt: skip
        eventually(lambda x=x: control.position[0] == x)
    eventually(lambda: abs(bench.layout.pose.sliders["root_tx"].value - 50.0) < 0.1)  # the good one
    assert bench.state.version == 1


def test_tracked_frames_move_what_is_on_the_screen_and_the_hand_follows_a_slider(tmp_path):
    opener = partial(fake_document, step_s=0.1, stuck=lambda frame: frame == 4)
    with shown(tmp_path, opener=opener) as bench:
        layout, sliders = bench.layout, bench.layout.pose.sliders
        slider, hidden = sliders["index_mcp_flex"], sliders["ring_mcp_flex"]
        limit = layout.limits.ranges["ring_mcp_flex"]._impl.props
        before = slider.value, hidden.value, limit._marks
        bench.engine.track(0, FRAMES, 0)
        eventually(lambda: slider.value != before[0])
        assert (hidden.value, limit._marks) == before[1:]
        assert "waits" in layout.certainty.content
        layout.pose.open("Ring")
        assert hidden.value != before[1]
        with WireClient(bench.url) as client:
            eventually(lambda: bench.state.progress.done == 4)  # it is stuck at the next one
            client.set_value(layout.tracking.follow, False)
            angle = np.rad2deg(value_of(bench.state, "index_mcp_flex"))
            eventually(lambda: abs(slider.value - angle) < 0.1)
            assert limit._marks != before[2] and "waits" not in layout.certainty.content
            for k in range(10):
                sent = client.set_value(slider, 10.0 + 0.5 * k)
                assert client.wait_for(sent, "/hand/flesh", "batched_positions") is not None
        assert bench.state.progress.state == "tracking"


def test_a_pose_that_comes_late_leads_nobody_back_to_its_frame(bench, monkeypatch):
    late, state, asked = bench.stage.pose, bench.state, []
    monkeypatch.setattr(bench.worker, "send", asked.append)
    for frame in (5, 6):
        bench.go_to(frame)
    assert [call.arguments["frame"] for call in asked] == [5, 6]
    for frame, stands in ((late.frame, 6), (5, 6), (6, 6), (7, 7)):  # at last the engine leads on
        bench.page.show(replace(late, frame=frame))
        assert state.frame == stands


def test_a_page_that_comes_late_is_told_what_was_said(bench):
    """Fault C41."""
    bench._snapshots.put(protocol.Notice("done", "Welcome back", "Restored: 3 poses."))
    eventually(lambda: "Welcome back" in bench.layout.messages.said.content)  # said to nobody
    with WireClient(bench.url) as wire:
        eventually(lambda: any("Welcome back" in str(one) for _, one in wire.messages))


def told_value(client, handle):
    told = reversed(said(client, "GuiUpdateMessage"))
    uuid = handle._impl.uuid
    return next((one["updates"].get("value") for one in told if one["uuid"] == uuid), None)


def test_c42_two_pages_edit_and_the_last_edit_stands(bench, pages):
    slider = bench.layout.pose.sliders["index_mcp_flex"]
    places = lambda: np.array(bench.stage.hand.ellipsoids.batched_positions)  # noqa: E731
    before, value = places(), slider.value
    first, second = pages
    for one, other, angle in ((first, second, 50.0), (second, first, 60.0)):
        one.set_value(slider, angle)
        eventually(lambda: told_value(other, slider) == angle)  # noqa: B023
    joint = bench.state.names.index("index_mcp_flex")
    eventually(lambda: round(np.rad2deg(bench.stage.pose.values[joint])) == 60)
    eventually(lambda: not np.allclose(places(), before, atol=1e-3))
    for _ in range(2):
        first.set_value(bench.layout.pose.edit_buttons, "Undo")
    eventually(lambda: np.allclose(places(), before, atol=1e-4))  # undone, whoever did it
    eventually(lambda: abs(slider.value - value) < 0.06)
    assert bench.web.messages.refused == 0


def test_each_page_looks_through_a_camera_of_its_own(bench):
    view, painted = bench.layout.session, bench.stage.looking.pictures
    with ExitStack() as pages:
        with bench.server.atomic():  # the scene comes late
            one, other = (pages.enter_context(WireClient(bench.url)) for _ in range(2))
            eventually(lambda: len(bench.server.get_clients()) == 2)
            other.set_value(view.through, "side")
            eventually(lambda: painted(None))
        eventually(lambda: said(other, "ReplayDoneMessage") and _shown(other, "/screen"))
        assert _shown(other, "/cameras") is False  # its frustum would be in the way
        assert _shown(one, "/screen") is None and _shown(one, "/cameras") is not False
        one.set_value(view.through, "front")
        other.set_value(view.paint, "nothing")
        eventually(lambda: _shown(one, "/screen"))
        wanted = (("front", "outline"), ("side", "plain"))
        eventually(lambda: painted(None) == wanted)
        assert bench.state.display.paint == "plain", "of the small pictures: the last choice"
        other.set_value(view.view, "Everything")
        eventually(lambda: _shown(other, "/cameras"))
        eventually(lambda: _shown(other, "/screen") is False)
        assert told_value(other, view.through) == "orbit view" and _shown(one, "/screen")
        other.set_value(view.through, "side")
        eventually(lambda: painted(None) == wanted)
        other.set_value(bench.layout.masks.correcting.paint, True)
        eventually(lambda: told_value(other, view.paint) == "mask")
    eventually(lambda: painted(None) == ())  # of pages that went none is painted
    assert bench.web.messages.refused == 0


def _shown(client, node):
    """Return whether a node was last shown or hidden; None if neither was said."""
    told = said(client, "SetSceneNodeVisibilityMessage")
    return next((one["visible"] for one in reversed(told) if one["name"] == node), None)


def _status(bench):
    return bench.state.strip.status


def test_it_leads_from_the_pose_over_tracking_to_the_review(bench, wire):
    layout, button = bench.layout, bench.layout.next.button
    eventually(lambda: button.visible)
    wire.set_value(button, True)
    eventually(lambda: all(_status(bench) >= 0) and button.visible)
    wire.set_value(button, True)
    eventually(lambda: bench.state.frame == 7)  # the doubtful frame
    eventually(lambda: not button.visible)  # it has done its work
    wire.set_value(layout.review.accept_next, True)
    eventually(lambda: layout.review.done == 1 and button.visible)
    wire.set_value(layout.pose.edit_buttons, "Undo")
    eventually(lambda: layout.review.done == 0)


def test_a_cancelled_tracking_is_gone_on_with(tmp_path):
    go_on = threading.Event()
    opener = partial(fake_document, stuck=lambda frame: frame == 8 and not go_on.is_set())
    with shown(tmp_path, opener=opener) as bench, WireClient(bench.url) as client:
        button = bench.layout.next.button
        bench.engine.track(3, FRAMES, 3)
        eventually(lambda: len(bench.worker.document.results) == 5)
        assert not button.visible  # it is under way
        client.set_value(bench.layout.job, "Pause")
        eventually(lambda: bench.layout.job.options == ("Resume", "Cancel"))
        client.set_value(bench.layout.job, "Cancel")
        eventually(lambda: bench.state.progress.state == "idle")
        eventually(lambda: np.flatnonzero(_status(bench) >= 0)[-1:] == [7])
        go_on.set()
        eventually(lambda: button.visible)
        client.set_value(button, True)
        eventually(lambda: all(_status(bench)[3:] >= 0))
        assert (_status(bench)[:3] < 0).all()  # only from where it ended


def test_a_step_of_the_list_is_gone_back_to_and_made_again(bench, wire):
    history = bench.layout.pose.history
    angle_of = lambda name: np.rad2deg(value_of(bench.state, name))  # noqa: E731
    for name, angle in (("index_mcp_flex", 20.0), ("ring_mcp_flex", 30.0), ("thumb_ip_flex", 15)):
        wire.set_value(bench.layout.pose.sliders[name], angle)
        eventually(lambda: abs(angle_of(name) - angle) < 0.1, name)  # noqa: B023
    eventually(lambda: len(history.options) == 4)  # three steps, and now
    wire.set_value(history, next(one for one in history.options if "Ring" in one))
    eventually(lambda: abs(angle_of("ring_mcp_flex") - 30.0) > 1)
    assert abs(angle_of("index_mcp_flex") - 20.0) < 0.1  # the first one holds
    eventually(lambda: len(history.options) == 4 and history.options[2] == "now")  # two undone
    wire.set_value(history, history.options[0])
    eventually(lambda: abs(angle_of("thumb_ip_flex") - 15.0) < 0.1)


def test_a_setting_is_marked_undone_saved_and_brought_back_to_session_toml(bench, wire):
    panel, undo, path = (
        bench.layout.settings,
        bench.layout.pose.edit_buttons,
        bench.folder / "session.toml",
    )
    path.write_text(TEXT)
    saved, control = panel.saved, panel.controls["cloud.weight"].widget
    iterations = panel.controls["solver.iterations"].widget
    usual = iterations.value
    wire.set_value(control, 2.0)
    eventually(lambda: "cloud.weight" in saved.words.content)
    eventually(lambda: control.label == "Cloud •" and saved.back.visible)
    wire.set_value(iterations, 7)
    eventually(lambda: iterations.label == "Iterations •")
    wire.set_value(undo, "Undo")
    eventually(lambda: iterations.value == usual)
    assert control.value == 2.0
    wire.set_value(saved.back, True)
    eventually(lambda: control.value == 1.0 and not saved.back.visible)
    eventually(lambda: control.label == "Cloud")
    wire.set_value(undo, "Undo")
    eventually(lambda: control.value == 2.0 and saved.save.visible)
    wire.set_value(saved.save, True)
    eventually(lambda: not saved.save.visible and not saved.back.visible)
    assert path.read_text() == TEXT + "\n[tracking]\ncloud.weight = 2.0\n"
    assert (control.label, control.value) == ("Cloud", 2.0)
    bench.engine.set_setting("cloud.weight", 1.0)
    eventually(lambda: control.label == "Cloud •")  # now the usual value is a change


def test_a_number_of_the_shape_is_set_shown_and_undone(bench, wire):
    panel = bench.layout.settings.shape
    before, usual = panel.list.content, panel.slider.max
    wire.set_value(panel.chosen, "palm breadth")
    eventually(lambda: panel.slider.max != usual)
    wire.set_value(panel.slider, 6.0)
    eventually(lambda: "+6.0 %" in panel.list.content)
    wire.trigger("Undo")
    eventually(lambda: panel.list.content == before and panel.slider.value == 0.0)


TAG = "<img src=x onerror=alert(1)>"


def written_in(server):
    """Yield all that the page takes as HTML or Markdown."""
    for container in list(server.gui._container_handle_from_uuid.values()):
        for handle in list(container._children.values()):
            if isinstance(handle, viser.GuiHtmlHandle | viser.GuiMarkdownHandle):
                yield handle.content


def test_c53_names_in_a_sessions_files_are_text(session):
    old = next(x for x in (session / "session.toml").read_text().splitlines() if "name = " in x)
    edit(session / "session.toml", old, f"name = {json.dumps(TAG)}")
    for file in ("session.toml", "calibration.toml"):
        edit(session / file, 'name = "cam0"', f"name = {json.dumps('cam' + TAG)}")
    (session / "masks/cam0/000001.png").write_bytes(b"no image")  # a note names the file
    with shown(session) as bench:
        eventually(lambda: any("&lt;img" in text for text in written_in(bench.server)))
        take = protocol.TakeCard(1, TAG, 1)
        bench.layout.takes.show(protocol.WorkSnapshot("saved", (take,)))
        assert [text for text in written_in(bench.server) if TAG in text] == []
