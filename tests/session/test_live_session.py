"""A live session is another source of what a recording gives: the same masks, the same tracking; and it becomes a recording."""

import numpy as np
import pytest

import handtrack.session.live.live_session as live_session
from handtrack import Session, TrackingRun, read_npz
from handtrack.arrays import Array
from handtrack.session.live.live_recording import LiveRecording
from handtrack.session.live.live_session import LIVE_SETTINGS, open_live
from tests.live_cameras import ScriptedDevice

SKIN = (105, 135, 205)  # BGR


def hand_image(x: int = 17) -> Array:
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
        self.session = open_live(folder, {}, tolerance_s=10.0)
        for device in self.devices.values():
            device.begin()

    def show(self, image=None):
        """Let both cameras show an image; return the frame made of it."""
        feed = self.session.live
        for device in self.devices.values():
            device.show(hand_image() if image is None else image)
        made = feed.make_next(10.0)
        return made.number

    def close(self):
        feed = self.session.live
        for device in self.devices.values():
            device.fail(9)
        feed.close()


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
    assert "The masks of cam0, cam1 are files of the recording" in session.warnings[0]
    frame = studio.show()
    seen = session.observation(frame)
    assert [one.camera.name for one in seen.silhouettes] == ["cam0", "cam1"]
    mask = session.mask("cam1", frame)
    assert (mask[10:40, 20:44] == 255).all() and not mask[:, :10].any()
    assert session.known_frames == range(frame + 1)


def test_a_recording_opens_as_a_session_with_its_poses(studio, tmp_path):
    run = TrackingRun.open(
        studio.session,
        {
            "model.fit_size": False,
            "solver.iterations": 2,
            "tracker.recovery": False,
            **LIVE_SETTINGS,
        },
        use_init=False,
    )
    studio.show()  # before recording began
    recording = LiveRecording(tmp_path / "new", studio.session)
    studio.session.live.on_frame = recording.add
    frames = [studio.show(hand_image(x)) for x in (10, 14, 18)]
    results = run.track(range(frames[0], frames[-1] + 1), frames[0], run.model.rest_params())
    for result in results:
        recording.note(result)
    words = recording.close(run)
    assert f"3 frames with 3 poses are in {tmp_path / 'new'}" in words
    again = Session.open(tmp_path / "new")
    assert again.frame_count == 3
    assert again.warnings == []
    assert again.time_s(0) == 0.0 < again.time_s(1) < again.time_s(2)
    for x, frame in ((10, 0), (18, 2)):
        image = again.image("cam1", frame)
        assert np.abs(image[20, x + 4].astype(int) - SKIN).max() < 12  # the codec's
    assert len(again.observation(1).silhouettes) == 2
    assert TrackingRun.open(again).settings.solver.iterations == 2
    track = read_npz(tmp_path / "new" / "tracks" / "poses.npz")
    assert track.frame.tolist() == [0, 1, 2]


def test_a_calibration_alone_will_do(folder, monkeypatch):
    for path in ("session.toml", "init.json", "truth.npz"):
        (folder / path).unlink()
    studio = Studio(folder, monkeypatch)
    assert studio.session.rig.names == ("cam0", "cam1")
    assert studio.session.fps == 30.0
    assert len(studio.session.observation(studio.show()).silhouettes) == 2
    studio.close()
