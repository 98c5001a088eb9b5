"""All that the page shows is of one pose, whatever comes late: played, edited and tracked at the same time, with delays put in."""

import re
import time
from uuid import uuid4

import numpy as np
import pytest
from viser._messages import LocalStorageGetItemRequestMessage

from handtrack_app.engine.pictures.camera_pictures import CameraPictures
from handtrack_app.page.panels.pose import unit_of
from handtrack_app.page.scene import camera_view
from handtrack_app.page.time.lanes import cursor_picture
from handtrack_app.protocol import snapshots
from tests.app.desk import shown
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.app.wire import Browser, WireClient

CARD = re.compile(r">Frame (\d+)</b>")


class Witness:
    """Puts together what a page shows, message by message, and looks at it whenever all has come of a pose that the program shows."""

    def __init__(self, bench, wire):
        self.bench, self.wire = bench, wire
        first = bench.stage.pose
        self.poses = [] if first is None else [first]
        self.shown = {}
        self.read, self.looks, self.moving = 0, 0, 0
        self.pictures, self.wrong = 0, list[str]()
        shown = bench.page.show

        def noted(snapshot):
            if isinstance(snapshot, snapshots.PoseSnapshot):
                self.poses.append(snapshot)
            shown(snapshot)
            self._look_at_pictures()
            if isinstance(snapshot, snapshots.PoseSnapshot):
                self._look()

        object.__setattr__(bench.page, "show", noted)

    def _look(self):
        """Look at what the page has, once all that it was told until now has come."""
        last = LocalStorageGetItemRequestMessage("witness", str(uuid4()))
        self.bench.server._websock_server.queue_message(last)

        def came():
            found = list(self.wire.messages)
            for _, message in found[self.read :]:
                self._take(message)
            self.read = len(found)
            return self.shown.get("witness") == last.request_uuid

        eventually(came, "the last message")
        self._judge()

    def _take(self, message):
        if message.get("key") == "witness":
            self.shown["witness"] = message["request_uuid"]
        key = message.get("name") or message.get("uuid") or ""
        told = message.get("updates") or message.get("props") or {}
        for name, value in told.items():
            self.shown[f"{key}.{name}"] = value

    def of(self, handle, name):
        return self.shown.get(f"{handle._impl.uuid}.{name}")

    def _judge(self):
        panel = self.bench.layout.pose
        card, hand = self.of(panel.card, "content"), self.shown.get("/hand/flesh.batched_positions")
        found = CARD.search(card or "")
        if found is None or hand is None or not self.poses:
            return
        frame, centre = int(found[1]), np.asarray(hand).reshape(-1, 3)
        ours = [
            p for p in self.poses if p.frame == frame and np.allclose(p.centre, centre, atol=1e-6)
        ]
        self.wrong += [f"the card says frame {frame}; the hand is of another pose"] * (not ours)
        self.looks += 1
        self.moving += frame != self.poses[0].frame

    def _look_at_pictures(self):
        """Look, once a snapshot is shown, at what each kind of picture is of."""
        stage = self.bench.stage
        if stage.pose is None or stage.cameras is None:
            return
        frame = stage.pose.frame
        for screen in stage.looking._screens.values():
            if screen.image.visible:
                grey = round(float(np.median(screen.image.image)) / 10)  # as the fake camera has it
                self.wrong += [f"behind the hand of {frame}: {grey}"] * (grey != frame)
                self.pictures += 1
        for frustum in (stage.cameras.frusta["front"],):
            if frustum.image is not None and stage.cameras.frame != frame:
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
        assert timeline.slider is not None and timeline.slider.value == pose.frame
        assert timeline.cursor.content == cursor_picture(timeline._lanes, pose.frame, pose)
        assert f"Frame {pose.frame}<" in panel.card.content


@pytest.fixture
def witness(tmp_path, monkeypatch):
    monkeypatch.setattr(camera_view, "_MOMENT_S", 0.0)  # nothing of another frame, not for a moment
    painted = CameraPictures.screen

    def late(self, *given):
        time.sleep(0.05)
        return painted(self, *given)

    monkeypatch.setattr(CameraPictures, "screen", late)
    opener = lambda f: fake_document(f, step_s=0.05)  # noqa: E731
    with shown(tmp_path, opener=opener) as bench, WireClient(bench.url) as wire:
        page = Browser(bench, wire)
        show = bench.page.show
        yield bench, Witness(bench, wire), page
        object.__setattr__(bench.page, "show", show)


def test_played_edited_and_tracked_at_once_all_that_shows_is_of_one_pose(
    witness,
):
    bench, sees, page = witness
    bench.stage.looking.set_paint(page.number, "plain")
    page.press("Camera view: front")
    eventually(lambda: bench.stage.looking.anyone, "it looks through a camera")
    bench.engine.track(0, FRAMES, 3)
    slider = bench.layout.pose.sliders["index_mcp_flex"]
    for turn in range(30):
        if turn % 10 == 0:
            bench.page.play(True)
        if turn % 10 == 5:
            bench.page.play(False)
            sees.wire.set_value(slider, 10.0 + turn)
        if turn % 3 == 0:
            bench.page.go_to(turn % FRAMES)
        time.sleep(0.03)
    bench.page.play(False)
    bench.engine.cancel()
    eventually(lambda: bench.layout.tracking.progress.state == "idle", "it rests")
    bench.page.go_to(4)
    eventually(lambda: bench.stage.pose is not None and bench.stage.pose.frame == 4, "frame 4")

    def pictured():
        screen = bench.stage.looking._screens.get(page.number)
        return screen is not None and bool(screen.image.visible) and screen.frame == 4

    eventually(pictured, "its picture")
    assert not sees.wrong
    assert sees.looks > 3 and sees.moving and sees.pictures
    sees.at_rest()


def test_a_picture_of_a_frame_that_was_left_is_not_shown(witness):
    bench, _, page = witness
    page.press("Camera view: front")
    of_page = lambda: bench.stage.looking._screens.get(page.number)  # noqa: E731
    eventually(lambda: of_page() is not None and of_page().image.visible, "a picture")
    screen = of_page()
    bench.stage.moments.show(screen.frame + 1)
    black = np.zeros((72, 96, 3), np.uint8)
    late = snapshots.PictureSnapshot(screen.frame, screens={screen.picture: black})
    bench.stage.show_pictures(late)
    assert screen.image.image.any()
