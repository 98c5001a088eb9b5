"""A live session is another source of what a recording gives: the same masks; tests of the engine track and record it."""

import numpy as np
import pytest

from handtrack.session import live_session
from tests.live_cameras import ScriptedDevice

SKIN = (105, 135, 205)  # BGR


def hand_image(x=17):
    """A block of skin before grey."""
    image = np.full((48, 64, 3), 90, np.uint8)
    image[5:43, x : x + 30] = SKIN
    return image


class Studio:
    """A live session of two scripted cameras."""

    def __init__(self, folder, monkeypatch):
        self.devices = {}

        def opened(device, *_):
            self.devices[device] = ScriptedDevice(hand_image())
            return self.devices[device]

        monkeypatch.setattr(live_session, "open_device", opened)
        self.session = live_session.open_live(folder, {}, tolerance_s=600.0)
        for device in self.devices.values():
            device.begin()

    def show(self):
        """Let both cameras show an image; return the frame made of it."""
        for device in self.devices.values():
            device.show(hand_image())
        return self.session.live.make_next(600.0).number

    def close(self):
        for device in self.devices.values():
            device.fail(9)
        self.session.live.close()


@pytest.fixture
def studio(folder, monkeypatch):
    made = Studio(folder, monkeypatch)
    yield made
    made.close()


def test_cameras_are_numbered_in_the_sessions_order_and_masks_are_computed(studio):
    session = studio.session
    assert list(studio.devices) == ["0", "1"]
    assert session.rig.names == ("cam0", "cam1")
    assert session.truth is None
    assert "cam0, cam1" in session.warnings[0]
    frame = studio.show()
    seen = session.observation(frame)
    assert [one.camera.name for one in seen.silhouettes] == ["cam0", "cam1"]
    mask = session.mask("cam1", frame)
    assert (mask[10:40, 20:44] == 255).all() and not mask[:, :10].any()
    assert session.known_frames == range(frame + 1)


def test_a_calibration_alone_will_do(folder, monkeypatch):
    for path in ("session.toml", "init.json", "truth.npz"):
        (folder / path).unlink()
    studio = Studio(folder, monkeypatch)
    assert studio.session.rig.names == ("cam0", "cam1")
    assert studio.session.fps == 30.0
    assert len(studio.session.observation(studio.show()).silhouettes) == 2
    studio.close()
