"""The cloud tab offers what there is, and nothing stands before an image over which a box is to be dragged."""

import pytest

from tests.app.waiting import eventually
from tests.app.wire import WireClient

pytestmark = pytest.mark.usefixtures("left_open")


def test_saving_is_offered_where_something_is_not_saved(cloudy):
    panel = cloudy.layout.cloud
    save, back = panel.saved.save, panel.saved.back
    assert not save.visible
    with WireClient(cloudy.url) as client:
        client.set_value(panel.known["voxel_m"].widget, 8.0)
        eventually(lambda: bool(save.visible and back.visible), "offered")
        client.set_value(save, True)
        eventually(lambda: not save.visible and not back.visible, "saved")
    text = (cloudy.folder / "session.toml").read_text(encoding="utf-8")
    assert "voxel_m = 0.008  # fine" in text


def test_the_difference_to_the_background_is_set_in_halves_from_1_to_40(cloudy):
    panel = cloudy.layout.masks
    masks = lambda: cloudy.worker.document.run.session.view("cam0").settings.masks  # noqa: E731
    eventually(lambda: panel.built, "built")
    with WireClient(cloudy.url) as client:
        client.set_value(panel.method, "before the usual image")
        eventually(lambda: getattr(masks(), "threshold", None) == 8.0, "in force")
        for chosen, taken in ((1.5, 1.5), (50.0, 40.0), (0.5, 1.0)):
            client.set_value(panel.settings["background_median"]["threshold"].widget, chosen)
            eventually(lambda taken=taken: masks().threshold == taken, "within its limits")


def test_nothing_stands_before_the_image_while_a_box_is_dragged(cloudy):
    stage, skin, wide = cloudy.stage, cloudy.layout.cloud.skin, cloudy.layout.cloud.wide
    hand, root, points = stage.hand.flesh, stage.root.control, stage.cloud.points

    def shown():
        return {bool(thing.visible) for thing in (hand, root, points)}

    with WireClient(cloudy.url) as client:
        client.set_value(wide, True)
        eventually(lambda: cloudy.state.display.cloud_wide, "a large picture")
        client.set_value(skin.drag, True)
        eventually(lambda: shown() == {False}, "the bare image")
        told = lambda: any("Drag a box over" in str(message) for _, message in client.messages)  # noqa: E731
        eventually(told, "what to do stands beside the view")
        eventually(
            lambda: not wide.value and not cloudy.state.display.cloud_wide, "no picture either"
        )
        cloudy.engine.show_frame(1)
        eventually(lambda: cloudy.state.frame == 1, "another frame")
        assert shown() == {False}
        client.set_value(cloudy.layout.session.view, "Hand")
        eventually(lambda: shown() == {True}, "all of it again")
