"""All that the page shows is of one pose, whatever comes late: played, edited and tracked at the same time, with delays put in."""

import re
import time
from functools import partial
from itertools import groupby
from operator import itemgetter

import numpy as np
import pytest
from viser._messages import LocalStorageGetItemRequestMessage

from handtrack_app import protocol
from handtrack_app.engine.camera_pictures import CameraPictures
from handtrack_app.page.panels.pose import unit_of
from handtrack_app.page.scene import looking
from handtrack_app.page.timeline import cursor_picture
from tests.app.desk import shown
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually

CARD = re.compile(r">Frame (\d+)</b>")


class Witness:
    """Notes what the program shows, and looks at what each window of messages, which a page draws at once, leaves on the page."""

    def __init__(self, bench, wire):
        self.bench, self.wire = bench, wire
        self.poses = [bench.stage.pose]
        self.pictures, self.wrong = 0, list[str]()
        shown = bench.page.show

        def noted(snapshot):
            if isinstance(snapshot, protocol.PoseSnapshot):
                self.poses.append(snapshot)
            shown(snapshot)
            self._look_at_pictures()

        object.__setattr__(bench.page, "show", noted)

    def frames_of_the_page(self):
        """Return what frame the card said after each window; note where the hand was of another pose."""
        last = LocalStorageGetItemRequestMessage("witness", "last")
        self.bench.server._websock_server.queue_message(last)
        came = self.wire.messages  # each with the time of its window
        eventually(lambda: any(one.get("key") == "witness" for _, one in list(came)))
        card, hand, frames = "", None, []
        for _, window in groupby(came, key=itemgetter(0)):
            for _, message in window:
                told = message.get("updates") or message.get("props") or {}
                if message.get("uuid") == self.bench.layout.pose.card._impl.uuid:
                    card = told.get("content", card)
                if message.get("name") == "/hand/flesh":
                    hand = told.get("batched_positions", hand)
            frames.append(int(CARD.search(card)[1]))
            ours = (pose.centre for pose in self.poses if pose.frame == frames[-1])
            if not any(np.allclose(centre.ravel(), hand, atol=1e-6) for centre in ours):
                self.wrong.append(f"the card says frame {frames[-1]}; the hand is of another pose")
        return frames

    def _look_at_pictures(self):
        """Look, once a snapshot is shown, at what each kind of picture is of."""
        stage = self.bench.stage
        if stage.pose is None or stage.cameras is None:
            return
        frame = stage.pose.frame
        for screen in stage.looking._screens:
            if screen.image.visible:
                grey = round(float(np.median(screen.image.image)) / 10)  # as the fake camera has it
                self.wrong += [f"behind the hand of {frame}: {grey}"] * (grey != frame)
                self.pictures += 1
        small = stage.cameras.frusta["front"].image
        if small is not None and stage.cameras.frame != frame:
            self.wrong.append(f"small, beside {frame}: {stage.cameras.frame}")

    def at_rest(self):
        """Sliders, gizmo, numbers beside the lanes, and what is said of the frame are those of the pose on the card."""
        bench, panel = self.bench, self.bench.layout.pose
        pose = bench.stage.pose
        assert pose is self.poses[-1]
        for name, value in zip(panel.names, pose.values, strict=True):
            shown = float(value) / unit_of(name)
            slider = panel.sliders[name]
            if slider.min <= shown <= slider.max:
                assert slider.value == pytest.approx(shown, abs=0.11), name
        np.testing.assert_allclose(bench.stage.root.control.position, pose.values[:3], atol=1e-6)
        timeline = bench.layout.timeline
        assert timeline.slider.value == pose.frame
        assert timeline.cursor.content == cursor_picture(timeline._lanes, pose.frame, pose)


@pytest.fixture
def bench(tmp_path, monkeypatch):
    """Frames and pictures take a while, nothing of another frame is shown, not for a moment, and windows are too small for a pose."""
    monkeypatch.setattr(looking, "_MOMENT_S", 0.0)
    painted = CameraPictures.painted

    def late(*given, **small):
        time.sleep(0.0 if small else 0.05)
        return painted(*given, **small)

    monkeypatch.setattr(CameraPictures, "painted", late)
    with shown(tmp_path, opener=partial(fake_document, step_s=0.05)) as slow:
        slow.server._websock_server.get_message_buffer().max_window_size = 3
        yield slow


def test_played_edited_and_tracked_at_once_all_that_shows_is_of_one_pose(bench, wire, page):
    sees = Witness(bench, wire)
    bench.stage.looking.set_paint(page.client, "plain")
    page.press("Camera view: front")
    eventually(lambda: bench.stage.looking.anyone)
    bench.engine.track(0, FRAMES, 3)
    slider = bench.layout.pose.sliders["index_mcp_flex"]
    turn = 0
    while turn < 30 or len({pose.frame for pose in sees.poses}) < 6 or not sees.pictures:
        if turn % 10 == 0:
            bench.page.play(True)
        if turn % 10 == 5:
            bench.page.play(False)
            wire.set_value(slider, 10.0 + turn)
        if turn % 3 == 0:
            bench.page.go_to(turn % FRAMES)
        time.sleep(0.03)
        turn += 1
    bench.page.play(False)
    bench.engine.cancel()
    eventually(lambda: bench.state.progress.state == "idle")
    bench.page.go_to(4)
    eventually(lambda: bench.stage.pose.frame == 4)
    screen = page.client.screen
    eventually(lambda: screen.image.visible and screen.frame == 4)
    assert len(set(sees.frames_of_the_page())) > 3
    assert not sees.wrong
    sees.at_rest()


def test_a_picture_of_a_frame_that_was_left_is_not_shown(bench, page):
    page.press("Camera view: front")
    screen = eventually(lambda: page.client.screen)
    eventually(lambda: screen.image.visible)
    bench.stage.moments.show(screen.frame + 1)
    black = np.zeros((72, 96, 3), np.uint8)
    late = protocol.PictureSnapshot(screen.frame, screens={screen.picture: black})
    bench.stage.show_pictures(late)
    assert screen.image.image.any()
    side = bench.worker.document.session.view("side")
    assert CameraPictures().plain(side, 0).max() > 100  # it says that there is no image
