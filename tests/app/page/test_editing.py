"""Two pages on one workbench: both edit, each looks through a camera of its own."""

import numpy as np

from tests.app.waiting import eventually
from tests.app.wire import WireClient


def value_of(client, handle):
    told = [
        m["updates"]
        for _, m in list(client.messages)
        if m.get("uuid") == handle._impl.uuid and "updates" in m
    ]
    return told[-1].get("value") if told else None


def test_c42_two_pages_edit_and_the_last_edit_stands(bench):
    slider = bench.layout.pose.sliders["index_mcp_flex"]
    places = lambda: np.array(bench.stage.hand.flesh.batched_positions)  # noqa: E731
    before, value = places(), slider.value
    with WireClient(bench.url) as first, WireClient(bench.url) as second:
        eventually(lambda: len(bench.server.get_clients()) == 2, "both are there")
        for one, other, angle in ((first, second, 50.0), (second, first, 60.0)):
            one.set_value(slider, angle)
            eventually(lambda: value_of(other, slider) == angle, "the other sees it")  # noqa: B023
        joint = bench.state.names.index("index_mcp_flex")
        shown = lambda: round(np.rad2deg(bench.stage.pose.values[joint]))  # noqa: E731
        eventually(lambda: shown() == 60 and not np.allclose(places(), before, atol=1e-3), "the hand follows")  # fmt: skip
        for _ in range(2):
            first.set_value(bench.layout.pose.edit_buttons, "Undo")
        eventually(lambda: np.allclose(places(), before, atol=1e-4), "undone, whoever did it")
        eventually(lambda: abs(slider.value - value) < 0.06, "the slider, too")
    assert bench.door.messages.refused == 0


def test_each_page_looks_through_a_camera_of_its_own(bench):
    view = bench.layout.session
    with WireClient(bench.url) as one, WireClient(bench.url) as other:
        eventually(lambda: len(bench.server.get_clients()) == 2, "both are there")
        other.set_value(view.through, "side")
        eventually(lambda: _shown(other, "/screen"), "the camera's picture")
        assert not _shown(other, "/cameras"), "its frustum would be in the way"
        assert _shown(one, "/screen") is None and _shown(one, "/cameras") is not False
        one.set_value(view.through, "front")
        other.set_value(view.paint, "nothing")
        eventually(lambda: _shown(one, "/screen"), "its own picture")
        wanted = (("front", "outline"), ("side", "plain"))
        eventually(lambda: bench.stage.looking.pictures(None) == wanted, "each its own")
        assert bench.state.display.paint == "plain", "of the small pictures: the last choice"
        other.set_value(view.view, "Everything")
        eventually(lambda: _shown(other, "/cameras"), "free again")
        eventually(lambda: _shown(other, "/screen") is False, "without the picture")
        assert value_of(other, view.through) == "orbit view" and _shown(one, "/screen")
        other.set_value(view.through, "side")
        eventually(lambda: len(wished(bench)) == 2, "two pictures")
    eventually(lambda: wished(bench) == (), "of pages that went none is painted")
    assert bench.door.messages.refused == 0


def wished(bench):
    return bench.stage.looking.pictures(None)


def _shown(client, node):
    """Return whether a node was last shown or hidden; None if neither was said."""
    said = [
        m["visible"]
        for _, m in list(client.messages)
        if m.get("type") == "SetSceneNodeVisibilityMessage" and m["name"] == node
    ]
    return said[-1] if said else None
