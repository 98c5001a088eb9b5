"""Running cameras: the newest images make a frame, what comes too fast is counted, a camera may fail. By events, not by seconds."""

from collections import Counter

import pytest

from handtrack.capture.images.live_feed import LiveCamera, LiveFeed, LiveImages
from tests.live_cameras import SIZE, ScriptedDevice


class Desk:
    """Two scripted cameras with a clock that the test sets."""

    def __init__(self):
        self.now = 0.0
        self.devices = {"left": ScriptedDevice(), "right": ScriptedDevice()}
        cameras = [
            LiveCamera(name, device, SIZE, clock=lambda: self.now)
            for name, device in self.devices.items()
        ]
        self.feed = LiveFeed(cameras, tolerance_s=0.05)
        self.feed.start()
        for device in self.devices.values():
            device.begin()

    def show(self, value, *names):
        for name in names or tuple(self.devices):
            self.devices[name].show(value)

    def values(self, frame):
        sources = {camera.name: LiveImages(self.feed, camera) for camera in self.feed.cameras}
        seen = {name: source.read(frame) for name, source in sources.items()}
        return {name: int(one[0, 0, 0]) for name, one in seen.items() if one is not None}


@pytest.fixture
def desk():
    made = Desk()
    yield made
    for device in made.devices.values():
        device.fail(9)
    made.feed.close()


def test_a_frame_is_made_of_the_newest_images_and_older_ones_are_dropped(desk):
    desk.feed.begin_counting()
    for value in (1, 2, 3):
        desk.show(value)
    desk.feed.reach(0)
    desk.show(4)
    desk.feed.reach(1)
    assert desk.values(0) == {"left": 3, "right": 3}
    assert desk.values(1) == {"left": 4, "right": 4}
    assert desk.feed.counts["left"] == Counter(used=2, dropped=2)
    assert desk.feed.known == range(2)


def test_an_image_that_is_too_old_for_the_others_is_missing(desk):
    desk.feed.begin_counting()
    desk.show(1, "left")
    desk.now = 0.06
    desk.show(2, "right")
    desk.feed.reach(0)
    assert desk.values(0) == {"right": 2}
    assert desk.feed.counts["left"] == Counter(missing=1)
    desk.now = 0.10
    desk.show(3, "right")
    desk.feed.reach(1)  # the other camera is waited for, as long as the tolerance
    assert desk.values(1) == {"right": 3}
    assert desk.feed.time_s(1) == pytest.approx(0.04)
