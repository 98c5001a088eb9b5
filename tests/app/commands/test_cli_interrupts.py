"""`handtrack` interrupted, and as a program of its own: what is saved, what is told, exit codes."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from handtrack import bundled_session, read_npz
from handtrack_app.commands import track
from handtrack_app.commands import track as track_command
from tests.app.command_line import PROGRAM
from tests.session.small_session import edit


def program(*words, **options):
    """Start `handtrack` as a program of its own."""
    command = [sys.executable, "-m", "handtrack_app.cli", *map(str, words)]
    return subprocess.Popen(
        command,
        env=PROGRAM,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        **options,
    )


class Interrupter:
    """A progress bar that sends this program a signal after some frames, Ctrl-C by default."""

    def __init__(self, after, presses=1, number=signal.SIGINT):
        self.left, self.presses, self.number = after, presses, number

    def __enter__(self):
        return self

    def __exit__(self, *_): ...

    def update(self, frames=1):
        before, self.left = self.left, self.left - frames
        if before > 0 >= self.left:  # frames that were solved ahead come at once
            for _ in range(self.presses):
                os.kill(os.getpid(), self.number)
                time.sleep(0.01)  # handlers run between two instructions


@pytest.mark.parametrize("presses", [1, 2])
def test_interrupted_tracking_is_saved_and_named(handtrack, session, monkeypatch, presses):
    """Fault C65."""
    monkeypatch.setattr(track, "progress_bar", lambda *_: Interrupter(2, presses))
    handler = signal.getsignal(signal.SIGINT)
    ended = handtrack("track", session)
    assert signal.getsignal(signal.SIGINT) is handler
    poses = session / "tracks/poses.npz"
    assert ended.code == 130
    assert "2 of 5 frames" in ended.out
    assert str(poses) in ended.err
    assert read_npz(poses).frame.tolist() == [0, 1]


def test_interrupted_size_fit_saves_nothing(handtrack, session, monkeypatch):
    seen = track_command.TrackingRun.fit_size

    def fit(run, should_stop, on_progress):
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.01)
        return seen(run, should_stop)

    monkeypatch.setattr(track_command.TrackingRun, "fit_size", fit)
    edit(session / "session.toml", "scale = 1.0", 'scale = "fit"')
    ended = handtrack("track", session)
    assert ended.code == 130
    assert ended.out == ""
    assert not (session / "tracks").exists()


def test_ctrl_c_in_the_real_program(handtrack, tmp_path):
    without = shutil.ignore_patterns("tracks")
    source = bundled_session("open_fist_open")
    session = Path(shutil.copytree(source, tmp_path / "bundled", ignore=without))
    out = tmp_path / "warm.npz"
    assert handtrack("track", session, "--frames", ":1", "--out", out).code == 0  # kernels compile
    process = program("track", session)
    begun = ""
    while "tracking" not in begun:
        begun += process.stderr.read(1)
        assert process.poll() is None
    time.sleep(1.0)
    process.send_signal(signal.SIGINT)
    shown, told = process.communicate(timeout=120)
    assert process.returncode == 130, told
    assert "Traceback" not in told
    poses = session / "tracks/poses.npz"
    if not poses.exists():  # a slow machine, still at its first frame
        return
    saved = read_npz(poses).frame
    assert f"{len(saved)} of 100 frames" in shown
    assert saved.tolist() == list(range(len(saved)))


def test_an_interrupted_simulation_leaves_nothing(handtrack, tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("handtrack.simulation.simulate.render", stop)
    ended = handtrack("simulate", "--out", tmp_path / "deep" / "new")
    assert ended.code == 130
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_goes_away_is_no_error(session):
    process = program("doctor", session)
    process.stdout.close()
    process.wait(120)
    assert process.stderr is not None
    with process.stderr as told:
        assert told.read() == ""
    assert process.returncode == 0
