"""Undo takes back settings, limits and filters, in one history with poses; what is changed is marked."""

from typing import Any

from handtrack_app.workbench import Workbench
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def test_a_setting_is_marked_undone_and_brought_back_to_session_toml(bench, wire):
    panel, undo = bench.layout.settings, bench.layout.pose.edit_buttons
    control = panel.controls["cloud.weight"].widget
    iterations = panel.controls["solver.iterations"].widget
    usual = iterations.value
    wire.set_value(control, 2.0)
    eventually(
        lambda: "--set cloud.weight=2" in panel.saved.words.content, "what is changed is told"
    )
    eventually(lambda: control.label == "Cloud •" and bool(panel.saved.back.visible), "marked")
    wire.set_value(iterations, 7)
    eventually(lambda: iterations.label == "Iterations •", "marked")
    wire.set_value(undo, "Undo")
    eventually(lambda: iterations.value == usual, "the last change is taken back")
    assert control.value == 2.0
    wire.set_value(panel.saved.back, True)
    eventually(lambda: control.value == 1.0 and not panel.saved.back.visible, "as session.toml")
    eventually(lambda: control.label == "Cloud", "no longer marked")
    wire.set_value(undo, "Undo")
    eventually(lambda: control.value == 2.0, "that can be undone, too")


def test_a_number_of_the_shape_is_set_shown_and_undone(bench, wire):
    panel = bench.layout.settings.shape
    before = panel.list.content
    usual = panel.slider.max
    wire.set_value(panel.chosen, "palm breadth")
    eventually(lambda: panel.slider.max != usual, "its range")
    wire.set_value(panel.slider, 6.0)
    eventually(lambda: "+6.0 %" in panel.list.content, "shown")
    wire.set_value(panel.chosen, "thumb base along")
    eventually(lambda: panel.slider.label == "mm", "another number")
    assert panel.slider.value == 0.0
    wire.set_value(panel.slider, -3.0)
    eventually(lambda: "−3.0 mm" in panel.list.content, "shown")
    assert "+6.0 %" in panel.list.content
    wire.set_value(bench.layout.pose.edit_buttons, "Undo")
    eventually(lambda: "−3.0 mm" not in panel.list.content and panel.slider.value == 0.0, "back")
    wire.set_value(bench.layout.pose.edit_buttons, "Undo")
    eventually(lambda: panel.list.content == before, "the first is undone, too")


def test_a_filter_is_undone_and_made_again(cloudy):
    slider: Any = cloudy.layout.cloud.known["voxel_m"].widget
    undo = cloudy.layout.pose.edit_buttons
    assert slider.value == 3.0
    with WireClient(cloudy.url) as client:
        client.set_value(slider, 6.0)
        eventually(lambda: _clouds(cloudy).filters.voxel_m == 0.006, "coarser")
        client.set_value(undo, "Undo")
        eventually(
            lambda: _clouds(cloudy).filters.voxel_m == 0.003 and slider.value == 3.0, "undone"
        )
        client.set_value(undo, "Redo")
        eventually(
            lambda: _clouds(cloudy).filters.voxel_m == 0.006 and slider.value == 6.0, "redone"
        )


def _clouds(bench: Workbench) -> Any:
    document = bench.worker.document
    return None if document is None else document.clouds
