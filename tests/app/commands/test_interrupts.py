"""`handtrack` interrupted, killed, stopped and given again: what is saved and told, exit codes; nothing that was tracked is lost, and the
result is the same to the byte."""

import os
import random
import signal
import stat
import subprocess
import sys
import time
from contextlib import contextmanager, nullcontext
from types import SimpleNamespace

import numpy as np
import pytest

from handtrack import read_npz
from handtrack.store.lease import Lease
from handtrack.store.store import Span, Store
from handtrack.store.take import TakeWriter
from handtrack_app.cli import main
from handtrack_app.commands import track
from tests.app.command_line import FRAMES, PROGRAM
from tests.killing import copy_of_a_fresh_process, forked


def test_an_interrupted_simulation_leaves_nothing(handtrack, tmp_path, monkeypatch):
    def stop(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("handtrack.simulation.simulate.render", stop)
    ended = handtrack("simulate", "--out", tmp_path / "deep" / "new")
    assert ended.code == 130
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_goes_away_is_no_error(tracked):
    words = [sys.executable, "-m", "handtrack_app.cli", "takes", tracked]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(words, env=PROGRAM, **pipes) as process:
        process.stdout.close()
        assert (process.stderr.read(), process.wait()) == (b"", 0)


POSES = "tracks/poses.npz"


@pytest.fixture(scope="session")
def whole(tracked):
    """The poses.npz of an undisturbed run."""
    return (tracked / POSES).read_bytes()


@contextmanager
def interrupted(monkeypatch, after, number=signal.SIGINT, presses=1):
    """Let tracking be sent a signal after some frames, by its progress bar."""
    done = 0

    def update(frames=1):
        nonlocal done
        before, done = done, done + frames
        if before < after <= done:  # frames that were solved ahead come at once
            for _ in range(presses):
                os.kill(os.getpid(), number)
                time.sleep(0.01)  # handlers run between two instructions

    with monkeypatch.context() as patch:
        patch.setattr(track, "progress_bar", lambda *_: nullcontext(SimpleNamespace(update=update)))
        yield


def frames_of(session):
    return Store(session / "tracks").take(1).frames


def _track_until_write(number, session):
    """Track; the n-th write to a file of the store is cut in half, and this process is killed there."""
    left, really = number, os.write

    def write(handle, data):
        nonlocal left
        of_file = stat.S_ISREG(os.fstat(handle).st_mode)
        left -= of_file
        if left == 0 and of_file:
            really(handle, bytes(data)[: len(data) // 2])
            os.kill(os.getpid(), signal.SIGKILL)
        return really(handle, data)

    os.write = write
    main(["track", str(session)])


@forked
def test_a1_killed_at_random_moments_the_same_command_ends_with_the_same_bytes(
    handtrack, session, whole
):
    moments = random.Random(11)
    for _ in range(4):
        before = frames_of(session) if (session / "tracks/takes").exists() else ()
        writes = moments.randint(1, 4)
        child = copy_of_a_fresh_process(_track_until_write, writes, session)
        child.join()
        assert child.exitcode == -signal.SIGKILL
        if writes > 2:  # the lease, then what the take is about, then frames
            assert len(frames_of(session)) >= min(len(before) + writes - 3, FRAMES)
        (lease,) = (session / "tracks").glob("lease-*.json")
        assert set(before) <= set(frames_of(session)) if before else lease.exists()
    left, half = frames_of(session), session / "tracks/.poses.npz.0123abcd.part.npz"
    half.write_text("half")
    os.utime(half, (0, 0))
    ended = handtrack.does("track", session)
    assert not half.exists()
    assert f"resuming at frame {len(left)} of {FRAMES} (take 1" in ended.err
    assert (session / POSES).read_bytes() == whole
    assert not list((session / "tracks").glob("lease-*"))
    assert [take.is_finished for take in Store(session / "tracks").takes()] == [True, True]


def test_a1_c65_signals_to_end_are_clean_stops(handtrack, session, whole, monkeypatch):
    signals = ((1, signal.SIGINT, 2), (2, signal.SIGTERM, 1), (3, signal.SIGHUP, 1))
    for frames, number, presses in signals:
        if (handler := signal.getsignal(number)) == signal.SIG_IGN:
            continue  # these tests run under `nohup`, which is respected
        with interrupted(monkeypatch, frames, number, presses):
            ended = handtrack("track", session)
        assert signal.getsignal(number) is handler
        assert ended.code == 130
        assert str(session / POSES) in ended.err
        there = read_npz(session / POSES).frame.tolist()
        assert there == list(range(len(there)))
        assert len(there) >= frames, "and those solved ahead, which nothing could change any more"
    handtrack.does("track", session)
    assert (session / POSES).read_bytes() == whole


def test_an_interrupted_second_tracking_replaces_no_more_than_it_tracked(
    handtrack, done, monkeypatch
):
    before = read_npz(done / POSES)
    with interrupted(monkeypatch, 2):
        ended = handtrack("track", done, "--set", "silhouettes.weight=1.3")
    assert ended.code == 130
    store = Store(done / "tracks")
    for kept in (read_npz(done / POSES), store.track_of(store.current())):
        assert kept.frame.tolist() == before.frame.tolist()
        assert not np.array_equal(kept.parameters[0], before.parameters[0]), "it lies above"
        np.testing.assert_array_equal(kept.parameters[-1], before.parameters[-1])
    assert "resuming" not in handtrack("track", done, "--frames", "1:3").err
    there = read_npz(done / POSES).frame.tolist()
    assert there == [1, 2], "what is asked for and done is the track"


def test_an_interrupted_tracking_of_another_model_leaves_the_track_as_it_was(
    handtrack, done, monkeypatch
):
    before = (done / POSES).read_bytes()
    with interrupted(monkeypatch, 2):
        ended = handtrack("track", done, "--set", "model.forearm=true")
    assert ended.code == 130
    assert (done / POSES).read_bytes() == before
    assert [span.take for span in Store(done / "tracks").current()] == [2]
    handtrack.does("takes", done, "--restore", 3)
    assert "wrist_flex" in read_npz(done / POSES).parameter_names


def test_what_is_finished_or_begun_anew_is_a_new_take(handtrack, session, monkeypatch):
    words = ("track", session, "--frames", "0:2")
    with interrupted(monkeypatch, 1):
        assert handtrack(*words).code == 130
    for more in (["--restart"], []):
        ended = handtrack.does(*words, *more)
        assert "resuming" not in ended.err
    takes = Store(session / "tracks").takes()
    assert [take.is_finished for take in takes] == [False, True, True]
    assert Store(session / "tracks").current() == (Span(3, 0, 2),)


def test_a2_who_was_taken_over_writes_no_result(handtrack, session, monkeypatch):
    add, others = TakeWriter.add, []

    def adding(writer, step):
        if step.result.frame == 2:
            others.append(Lease.acquire(session / "tracks", "the other", take_over=True))
        add(writer, step)

    monkeypatch.setattr(TakeWriter, "add", adding)
    ended = handtrack("track", session)
    others[0].release()
    assert ended.code == 2
    assert not (session / POSES).exists()
    assert frames_of(session) == (0, 1)


def test_a_result_that_goes_elsewhere_leaves_the_session_alone(
    handtrack, session, tmp_path, monkeypatch
):
    out = tmp_path / "results" / "one.npz"
    words = ("track", session, "--frames", "0:2", "--out", out)
    with interrupted(monkeypatch, 1):
        assert handtrack(*words).code == 130
    assert (tmp_path / "results" / "one.npz.unfinished").is_dir()
    ended = handtrack(*words)
    assert "1 of 2" in ended.err
    assert not (session / "tracks").exists()
    assert [path.name for path in (tmp_path / "results").iterdir()] == ["one.npz", "versions"]


def test_damage_in_what_is_resumed_is_told_and_tracked_again(
    handtrack, session, whole, monkeypatch
):
    with interrupted(monkeypatch, 3):
        assert handtrack("track", session).code == 130
    log = session / "tracks/takes/0001/000001.log"
    content = bytearray(log.read_bytes())
    content[content.index(b'"frame":1') + 900] ^= 4
    log.write_bytes(content)
    ended = handtrack.does("track", session)
    assert f"note: {log}: " in ended.err
    assert (session / POSES).read_bytes() == whole
