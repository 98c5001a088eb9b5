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
        eventually(
            lambda: not wide.value and not cloudy.state.display.cloud_wide, "no picture either"
        )
        cloudy.engine.show_frame(1)
        eventually(lambda: cloudy.state.frame == 1, "another frame")
        assert shown() == {False}
        client.set_value(cloudy.layout.session.view, "Hand")
        eventually(lambda: shown() == {True}, "all of it again")
