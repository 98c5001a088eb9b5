"""The cloud tab offers what there is, and nothing stands before an image over which a box is to be dragged."""

from __future__ import annotations

from pathlib import Path

import pytest

from handtrack.errors import HandtrackError
from handtrack_app.engine.opening import open_document
from handtrack_app.engine.store import saving
from handtrack_app.engine.store.persistence import Persistence
from handtrack_app.workbench import Workbench
from tests.app.cloudy_session import cloudy_session
from tests.app.waiting import eventually
from tests.app.wire import WireClient

pytestmark = pytest.mark.usefixtures("left_open")


def test_pictures_are_offered_where_there_are_some(page: Workbench) -> None:
    panel, document = page.layout.cloud, page.worker.document
    assert document is not None
    picture = panel.widgets["picture"]
    assert picture.options == ("cameras and points", "stereo match", "none")
    document.saved_clouds = None
    page.engine.restore_clouds()
    eventually(lambda: picture.options == ("stereo match", "none"), "no points to show")
    eventually(lambda: picture.value == "none", "nothing is shown")
    page.engine.set_clouds(
        {
            "stereo": (("cam0", "cam1"),),
        }
    )
    eventually(lambda: picture.value == "cameras and points", "as it was")


def test_saving_is_offered_where_something_is_not_saved(page: Workbench) -> None:
    panel = page.layout.cloud
    save, back = panel.widgets["save"], panel.widgets["back"]
    assert not save.visible
    with WireClient(page.url) as client:
        client.set_value(panel.filters.sliders.known["voxel_m"][1], 8.0)
        eventually(lambda: bool(save.visible and back.visible), "offered")
        client.set_value(save, True)
        eventually(lambda: not save.visible and not back.visible, "saved")
    text = (page.folder / "session.toml").read_text(encoding="utf-8")
    assert "voxel_m = 0.008  # fine" in text


def test_clouds_are_not_saved_into_a_file_that_is_odd_by_now(tmp_path: Path) -> None:
    folder = cloudy_session(tmp_path)
    store = Persistence.open(open_document(folder, {}))
    (folder / "session.toml").write_text("[session\n", encoding="utf-8")
    store.document.saved_clouds = None
    with pytest.raises(HandtrackError, match="not valid TOML"):
        saving.save_clouds(store)
    assert (folder / "session.toml").read_text(encoding="utf-8") == "[session\n"


def test_nothing_stands_before_the_image_while_a_box_is_dragged(page: Workbench) -> None:
    stage, skin, wide = page.stage, page.layout.cloud.skin, page.layout.cloud.widgets["wide"]
    assert stage.hand is not None and stage.root is not None
    hand, root, points = stage.hand.flesh, stage.root.control, stage.cloud.points

    def shown() -> set[bool]:
        return {bool(thing.visible) for thing in (hand, root, points)}

    with WireClient(page.url) as client:
        client.set_value(wide, True)
        eventually(lambda: page.state.display.cloud_wide, "a large picture")
        client.set_value(skin.drag, True)
        eventually(lambda: shown() == {False}, "the bare image")
        eventually(
            lambda: not wide.value and not page.state.display.cloud_wide, "no picture either"
        )
        page.engine.show_frame(1)
        eventually(lambda: page.state.frame == 1, "another frame")
        assert shown() == {False}
        client.set_value(page.layout.session.view, "Hand")
        eventually(lambda: shown() == {True}, "all of it again")
