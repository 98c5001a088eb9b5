"""The workbench opens by what a video announces, and goes by its true frames as soon as they are counted."""

import threading

import handtrack.session.sources.video_audits as video_audits
from handtrack_app.process.child import EnginePlan
from handtrack_app.protocol import snapshots
from tests.app.desk import EngineInThreads, Listener
from tests.session.small_session import edit, make_session
from tests.session.test_times import FRAMES, cut, write_video


def opened(folder, monkeypatch):
    """Return a worker that shows a session whose cut video is counted once the event is set."""
    make_session(folder)
    edit(folder / "session.toml", 'images = "cam0/*.png"', 'images = "cam0.avi"')
    write_video(folder / "cam0.avi")
    cut(folder / "cam0.avi")
    may_count, audited = threading.Event(), video_audits.VideoFile.audited

    def waiting(video):
        may_count.wait(600.0)
        return audited(video)

    monkeypatch.setattr(video_audits.VideoFile, "audited", waiting)
    return (
        EngineInThreads(EnginePlan(folder, preview=False), (listener := Listener()).publish),
        listener,
        may_count,
    )


def test_the_true_frames_follow_and_damage_is_told(tmp_path, monkeypatch):
    worker, listener, may_count = opened(tmp_path, monkeypatch)
    worker.start()
    assert listener.wait(snapshots.SessionSnapshot, timeout=60.0).stop == FRAMES
    may_count.set()
    told = listener.told("can be decoded")
    assert f"announces {FRAMES} frames" in told.text
    counted = listener.wait(snapshots.SessionSnapshot, lambda s: s.stop < FRAMES)
    strip = listener.wait(snapshots.TimelineSnapshot, lambda s: len(s.status) == counted.stop)
    assert strip.start == 0
    worker.stop()
    assert (tmp_path / "tracks" / "videos.json").is_file()
