"""Two pages on one workbench: one edits, the other looks on and can take over."""

import dataclasses
import time
from typing import Any

from handtrack_app.workbench import Workbench
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def said(client: WireClient, title: str) -> bool:
    return any(m.get("props", {}).get("title") == title for _, m in list(client.messages))


def take_over_button(client: WireClient) -> str | None:
    return client.button("Take over editing")


def first_and_second(bench: Workbench, first: WireClient) -> WireClient:
    eventually(lambda: bench.state.editor is not None, "the first edits")
    second = WireClient(bench.url)
    eventually(lambda: take_over_button(second) is not None, "the second may take over")
    assert take_over_button(first) is None
    return second


def value_of(client: WireClient, handle: Any) -> object:
    told = [
        m["updates"]
        for _, m in list(client.messages)
        if m.get("uuid") == handle._impl.uuid and "updates" in m
    ]
    return told[-1].get("value") if told else None


def test_c42_the_second_page_looks_on(bench):
    slider = bench.layout.pose.sliders["index_mcp_flex"]
    before, frame = slider.value, bench.state.frame
    with WireClient(bench.url) as first, first_and_second(bench, first) as second:
        eventually(lambda: said(second, "Another page edits"), "it is told")
        second.set_value(slider, 60.0)
        second.set_value(bench.layout.timeline.slider, frame + 2)
        second.set_value(bench.layout.pose.edit_buttons, "Undo")
        second.send({
            "type": "TransformControlsUpdateMessage", "name": "/root", "wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.05, 0.0, 0.0],
        })  # fmt: skip
        eventually(lambda: value_of(second, slider) == before, "its page is put back")
        time.sleep(0.1)
        assert (slider.value, bench.state.frame, bench.state.version) == (before, frame, 0)
        assert bench.door.messages.sent_value(slider) == before
        first.set_value(slider, 50.0)
        eventually(lambda: bench.state.version == 1, "the first one edits")
        eventually(lambda: value_of(second, slider) == 50.0, "and the second one sees it")
    assert bench.door.messages.refused == 0


def test_c42_the_second_page_takes_over(bench):
    slider = bench.layout.pose.sliders["index_mcp_flex"]
    with WireClient(bench.url) as first, first_and_second(bench, first) as second:
        second.set_value(take_over_button(second), True)
        eventually(lambda: said(first, "Another page took over"), "the first is told")
        eventually(lambda: take_over_button(first) is not None, "and may take it back")
        eventually(lambda: take_over_button(second) is None, "the button goes")
        first.set_value(slider, 30.0)
        second.set_value(slider, 60.0)
        eventually(lambda: slider.value == 60.0 and bench.state.version == 1, "the second edits")
        first.set_value(take_over_button(first), True)
        eventually(lambda: take_over_button(second) is not None, "taken back")
        first.set_value(slider, 30.0)
        eventually(lambda: slider.value == 30.0, "the first edits again")


def test_c42_editing_is_passed_on_when_its_page_goes(bench):
    slider = bench.layout.pose.sliders["index_mcp_flex"]
    with WireClient(bench.url) as first:
        second = first_and_second(bench, first)
    with second:
        eventually(lambda: said(second, "You edit now"), "told")
        second.set_value(slider, 60.0)
        eventually(lambda: bench.state.version == 1, "the second edits")
    eventually(lambda: bench.state.editor is None, "nobody is there")
    with WireClient(bench.url) as third:
        eventually(lambda: bench.state.editor is not None, "the next to come edits")
        assert take_over_button(third) is None


def test_each_page_looks_through_a_camera_of_its_own(bench):
    view = bench.layout.session
    with WireClient(bench.url) as editor, WireClient(bench.url) as other:
        eventually(lambda: other.button("Take over editing"), "it looks on")
        other.set_value(view.through, "side")
        eventually(lambda: _shown(other, "/screen"), "the camera's picture")
        assert not _shown(other, "/cameras"), "its frustum would be in the way"
        assert _shown(editor, "/screen") is None and _shown(editor, "/cameras") is not False
        editor.set_value(view.through, "front")
        other.set_value(view.paint, "nothing")
        eventually(lambda: _shown(editor, "/screen"), "its own picture")
        wanted = (("front", "outline"), ("side", "plain"))
        eventually(lambda: bench.stage.looking.pictures(None) == wanted, "each its own")
        assert bench.state.display.paint == "outline", "of the small pictures: the editor's"
        other.set_value(view.view, "Everything")
        eventually(lambda: _shown(other, "/cameras"), "free again")
        eventually(lambda: _shown(other, "/screen") is False, "without the picture")
        assert value_of(other, view.through) == "orbit view" and _shown(editor, "/screen")
        other.set_value(view.through, "side")
        eventually(lambda: len(wished(bench)) == 2, "two pictures")
    eventually(lambda: wished(bench) == (), "of pages that went none is painted")
    assert bench.door.messages.refused == 0


def wished(bench: Workbench) -> tuple[tuple[str, str], ...]:
    return bench.stage.looking.pictures(None)


def _shown(client: WireClient, node: str) -> bool | None:
    """Return whether a node was last shown or hidden; None if neither was said."""
    said = [
        m["visible"]
        for _, m in list(client.messages)
        if m.get("type") == "SetSceneNodeVisibilityMessage" and m["name"] == node
    ]
    return said[-1] if said else None


def test_a_slider_stays_while_a_session_has_its_parameter(bench):
    """Viser's page would be told the update of a slider after its removal."""
    panel, session = bench.layout.pose, bench.stage.session
    before, gone = dict(panel.sliders), session.parameter_names[-1]
    shorter = session.parameter_names[:-1]
    panel.fit(dataclasses.replace(session, parameter_names=shorter, interval=session.interval[:-1]))
    assert panel.sliders == {name: before[name] for name in shorter}
    panel.fit(session)
    assert panel.sliders[gone] is not before[gone]
    assert {**panel.sliders, gone: before[gone]} == before
    choices = max(row.order for row in panel.rows)
    assert all(choices < folder.order for folder in panel.folders.values()), "above the sliders"
