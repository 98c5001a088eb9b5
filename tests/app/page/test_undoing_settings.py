"""Undo takes back settings and numbers of the shape, in one history with poses; what is changed is marked."""

from tests.app.engine.test_saving_settings import TEXT
from tests.app.waiting import eventually


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
    eventually(lambda: "--set cloud.weight=2" in saved.words.content, "what is changed is told")
    eventually(lambda: control.label == "Cloud •" and bool(saved.back.visible), "marked")
    wire.set_value(iterations, 7)
    eventually(lambda: iterations.label == "Iterations •", "marked")
    wire.set_value(undo, "Undo")
    eventually(lambda: iterations.value == usual, "the last change is taken back")
    assert control.value == 2.0
    wire.set_value(saved.back, True)
    eventually(lambda: control.value == 1.0 and not saved.back.visible, "as session.toml")
    eventually(lambda: control.label == "Cloud", "no longer marked")
    wire.set_value(undo, "Undo")
    eventually(lambda: control.value == 2.0 and bool(saved.save.visible), "that is undone, too")
    wire.set_value(saved.save, True)
    eventually(lambda: not saved.save.visible and not saved.back.visible, "nothing to save")
    assert path.read_text() == TEXT + "\n[tracking]\ncloud.weight = 2.0\n"
    assert (control.label, control.value) == ("Cloud", 2.0)
    bench.engine.set_setting("cloud.weight", 1.0)
    eventually(lambda: control.label == "Cloud •", "now the usual value is a change")


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
