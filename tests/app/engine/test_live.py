"""Running cameras in the workbench's engine: watched, tracked, recorded; nothing is written into the session's own folder."""

import numpy as np
import pytest

from handtrack import Session, TrackingRun, read_npz
from handtrack.session import live_session
from handtrack_app import protocol
from handtrack_app.engine.live_control import open_live_document
from handtrack_app.process.child import LiveOptions
from tests.app.desk import working
from tests.app.waiting import eventually
from tests.live_cameras import ScriptedDevice
from tests.session.small_session import make_session
from tests.session.test_live_session import SKIN, hand_image

FAST = {"solver.iterations": 2, "tracker.recovery": False}


class Studio:
    """A worker with two scripted cameras."""

    def __init__(self, folder, monkeypatch):
        self.folder, self.devices = folder, [ScriptedDevice(hand_image()) for _ in range(2)]
        waiting = list(self.devices)
        monkeypatch.setattr(live_session, "open_device", lambda *_: waiting.pop(0))
        options = LiveOptions({}, 10.0)
        opener = lambda f: open_live_document(options, f, FAST)  # noqa: E731
        self.worker, self.listener = working(folder, opener)

    def show(self, x=17):
        for device in self.devices:
            device.show(hand_image(x))

    def wait_for_pose(self, test):
        return self.listener.wait(protocol.PoseSnapshot, test)

    def stop(self):
        for device in self.devices:
            device.fail(9)
        self.worker.stop()
        return self.worker.last_words


@pytest.fixture
def studio(tmp_path, monkeypatch):
    (tmp_path / "desk").mkdir()
    made = Studio(make_session(tmp_path / "desk"), monkeypatch)
    yield made
    made.stop()


def test_the_newest_images_are_watched_until_the_hand_is_posed(studio):
    assert studio.listener.wait(protocol.SessionSnapshot).live
    studio.show()
    pose = studio.wait_for_pose(lambda p: p.frame >= 1)
    values = tuple(float(v) for v in pose.values)
    studio.worker.engine.set_pose(pose.frame, values, 1)
    posed = studio.wait_for_pose(lambda p: p.version == 1)
    studio.show()
    studio.worker.engine.take_pose(posed.frame, "previous", 2)
    later = studio.wait_for_pose(lambda p: p.version == 2)
    assert later.frame == posed.frame  # the picture stands still
    studio.worker.engine.follow(True)
    studio.wait_for_pose(lambda p: p.frame > posed.frame)


def test_tracked_live_recorded_and_opened_again(studio, tmp_path):
    new = tmp_path / "new"
    before = sorted(path.name for path in studio.folder.iterdir())
    studio.worker.engine.record(True, str(new))
    studio.listener.wait(protocol.LiveSnapshot, lambda s: s.recording == str(new))
    studio.worker.engine.track_live()
    eventually(lambda: studio.worker.busy)
    feed = studio.worker.document.session.live
    for count, x in enumerate((10, 14, 18), 1):
        studio.show(x)
        eventually(lambda count=count: feed.counts["cam0"]["used"] >= count)
    eventually(lambda: len(studio.worker.document.results) >= 3)
    studio.worker.engine.cancel()
    ended = studio.listener.wait(protocol.Notice, lambda n: n.title == "Tracking ended")
    assert "cam0: " in ended.text
    results = studio.worker.document.results
    assert sorted(results) == list(range(min(results), max(results) + 1))
    studio.worker.engine.record(False)
    told = studio.listener.told("Recorded")
    assert f"are in {new}" in told.text
    again = Session.open(new)
    assert again.frame_count >= 3
    assert again.init is not None or not any(result.fits for result in results.values())
    assert again.warnings == []
    image = again.image("cam1", again.frame_count - 1)
    assert np.abs(image[20, [22, 44]].astype(int) - SKIN).max() < 12, "the last one shown, coded"
    assert TrackingRun.open(again).settings.solver.iterations == FAST["solver.iterations"]
    track = read_npz(new / "tracks" / "poses.npz")
    assert len(track) >= 3 and (np.diff(track.time_s) > 0).all()
    assert [again.time_s(frame) for frame in track.frame] == pytest.approx(track.time_s, abs=1e-6)
    assert sorted(path.name for path in studio.folder.iterdir()) == before
    words = studio.stop()
    assert [text.partition(":")[0] for text in words] == ["cam0", "cam1"]


def test_a_camera_that_goes_is_told_once_and_all_of_them_end_tracking(studio):
    studio.devices[0].fail(3)
    studio.listener.told("disconnected")
    studio.worker.engine.track_live()
    studio.devices[1].fail(3)
    stopped = studio.listener.wait(protocol.Notice, lambda n: n.title == "Tracking stopped")
    assert "camera 'cam0'" in stopped.text and "camera 'cam1'" in stopped.text


def test_nothing_is_saved_into_the_folder_of_a_live_session(studio):
    studio.worker.engine.save_pose()
    studio.listener.refused()
    assert not (studio.folder / "tracks").exists()
