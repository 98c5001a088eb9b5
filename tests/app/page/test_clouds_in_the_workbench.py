"""Clouds in the workbench: shown only where wanted, filtered live with counts, settings kept and saved."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from handtrack_app import protocol
from tests.app.cloudy_session import cloudy_session
from tests.app.desk import working
from tests.app.waiting import eventually
from tests.app.wire import WireClient


def test_the_energys_parts_are_on_the_timeline(cloudy_desk):
    worker, listener = cloudy_desk
    worker.engine.track(0, 2, 0)
    listener.wait(protocol.Notice, lambda n: n.title == "Tracking finished")
    strip = [s for s in listener.seen if isinstance(s, protocol.TimelineSnapshot)][-1]
    terms = {name for name in strip.lanes if name.startswith(protocol.TERM)}
    assert terms >= {protocol.TERM + name for name in ("cloud→model", "model→cloud", "priors")}
    total = np.sum([np.nan_to_num(strip.lanes[name]) for name in terms], axis=0)
    assert_allclose(total[:2], strip.lanes[protocol.COST][:2], rtol=1e-6)


@pytest.mark.usefixtures("left_open")
def test_the_page_shows_the_cloud_and_a_slider_filters_it(cloudy):
    points, panel, undo = (
        cloudy.stage.cloud.points,
        cloudy.layout.cloud,
        cloudy.layout.pose.edit_buttons,
    )
    before, voxel = len(points.points), panel.known["voxel_m"].widget
    save = panel.saved.save
    assert len(points.colors) == before and not save.visible
    with WireClient(cloudy.url) as client:
        client.set_value(voxel, 8.0)
        eventually(lambda: len(points.points) < before)
        eventually(lambda: "cells" in panel.counts.content)
        eventually(lambda: "voxel_m" in panel.saved.words.content)
        client.set_value(undo, "Undo")
        eventually(lambda: len(points.points) == before and voxel.value == 3.0)
        client.set_value(undo, "Redo")
        eventually(lambda: save.visible)
        client.set_value(save, True)
        eventually(lambda: not save.visible)
        assert "voxel_m = 0.008  # fine" in (cloudy.folder / "session.toml").read_text()
        client.set_value(panel.on, False)
        eventually(lambda: not points.visible)


def test_another_model_takes_the_hands_place(cloudy):
    layout, state = cloudy.layout, cloudy.state
    coupling = layout.settings.controls["model.coupling"].widget
    with WireClient(cloudy.url) as client:
        for place, (name, bones) in enumerate((("glove9", 3), ("hand26", 25))):
            cloudy.engine.set_setting("model.name", name)
            eventually(lambda bones=bones: len(cloudy.stage.hand.bone_length) == bones, name)
            eventually(lambda: set(layout.pose.sliders) == set(state.names))
            eventually(lambda: len(state.values) == len(state.names))
            shown = bones > 3
            eventually(lambda shown=shown: layout.pose.library.visible == coupling.visible == shown)
            version = state.version
            client.set_value(layout.pose.sliders["root_tx"], 5.0 + place)
            eventually(lambda version=version: state.version > version)


def test_without_a_first_pose_the_hand_stands_in_the_cloud_and_crops_nothing(tmp_path):
    folder = cloudy_session(tmp_path)
    (folder / "init.json").unlink()
    worker, listener = working(folder)
    worker.engine.want_cloud(protocol.CloudSelection(points=True))
    cloud = listener.wait(protocol.CloudSnapshot)
    assert all(c.name != "crop" for c in cloud.counts)
    place = worker.document.start[:3] + [0.0, 0.09, 0.0]
    assert np.linalg.norm(place - np.median(cloud.points, axis=0)) < 0.01
    worker.stop()


def test_nothing_stands_before_the_image_while_a_box_is_dragged(cloudy):
    stage, skin, wide = cloudy.stage, cloudy.layout.cloud.skin, cloudy.layout.cloud.wide
    hand, root, points = stage.hand.ellipsoids, stage.root.control, stage.cloud.points

    def shown():
        return {bool(thing.visible) for thing in (hand, root, points)}

    with WireClient(cloudy.url) as client:
        client.set_value(wide, True)
        eventually(lambda: cloudy.state.display.cloud_wide)
        client.set_value(skin.drag, True)
        eventually(lambda: shown() == {False}, "the bare image")
        told = lambda: any("Drag a box over" in str(message) for _, message in client.messages)  # noqa: E731
        eventually(told)
        eventually(lambda: not wide.value and not cloudy.state.display.cloud_wide)
        cloudy.engine.show_frame(1)
        eventually(lambda: cloudy.state.frame == 1)
        assert shown() == {False}
        client.set_value(cloudy.layout.session.view, "Hand")
        eventually(lambda: shown() == {True})
