"""The engine in a process of its own: it may die, and what was accepted is there; it ends with whoever started it."""

import operator
import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

from handtrack.store.lease import holder_of
from handtrack.store.store import Store
from handtrack_app import protocol
from handtrack_app.process import child, engine_process
from handtrack_app.process.child import GB, EnginePlan, LiveOptions
from handtrack_app.process.engine_process import EngineProcess
from handtrack_app.protocol import Hold
from tests.app.command_line import PROGRAM
from tests.app.desk import Listener
from tests.app.fake_run import FRAMES, fake_document
from tests.app.waiting import eventually
from tests.live_cameras import clip
from tests.session.small_session import make_session

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="signals"),
    pytest.mark.usefixtures("quick_engines"),
]


class Page(Listener):
    """An engine in a process, and all that it said."""

    def __init__(self, folder, opener=fake_document, **plan):
        super().__init__()
        self.folder = folder
        self.engine = EngineProcess(EnginePlan(folder, opener=opener, **plan), self.publish)

    def idle(self, after=0):
        self.wait(protocol.ProgressSnapshot, lambda p: p.state == "idle", after)

    def kill(self, number=signal.SIGKILL):
        """Kill the engine's process; return how much had been said before."""
        pid, said = self.engine.pid, len(self.seen)
        assert pid is not None
        os.kill(pid, number)
        return said

    @property
    def saved(self):
        """What the page's head says."""
        return ([""] + [s.saved for s in self.seen if isinstance(s, protocol.WorkSnapshot)])[-1]


@pytest.fixture
def start():
    pages = []

    def started(*args, **plan):
        pages.append(Page(*args, **plan))
        pages[-1].engine.start()
        assert pages[-1].engine.wait_opened(600.0) is None
        return pages[-1]

    yield started
    for page in pages:
        pid = page.engine.pid
        page.engine.stop(60.0)
        assert pid is None or not _works(pid)
        assert not any((page.folder / "tracks").glob("lease-*.json")), "the session is given back"


def values_with(bend):
    model = fake_document(Path()).model
    values = model.rest.copy()
    values[model.parameter_names.index("index_pip_flex")] = bend
    return tuple(values.tolist())


def test_c40_a_killed_engine_is_told_and_what_was_accepted_is_back(tmp_path, start):
    page = start(tmp_path, partial(fake_document, stuck=partial(operator.le, 8)))
    engine = page.engine
    first = engine.pid
    engine.engine.want_pictures(True, "plain", (("front", "plain"),))
    engine.engine.set_pose(9, values_with(0.75), 1)
    page.wait(protocol.TimelineSnapshot, lambda t: t.by_hand == (9,))
    engine.engine.track(3, FRAMES, 3)
    page.wait(protocol.ProgressSnapshot, lambda p: p.state == "tracking" and p.frame == 7)
    engine.engine.set_pose(10, values_with(0.6), 2)  # perhaps not on disk yet
    page.wait(protocol.PoseSnapshot, lambda p: p.version == 2)
    said = page.kill()
    notice = page.wait(protocol.Notice, after=said)
    assert notice.level == "error"
    opening = page.wait(protocol.ProgressSnapshot, lambda p: p.state == "opening", said)
    said = page.seen.index(opening)
    page.idle(said)
    assert engine.pid not in (first, None)
    page.told("Welcome back", said)
    strip = page.wait(protocol.TimelineSnapshot, after=said)
    assert (strip.status[3:7] >= 0).all(), "all but the last one"
    assert page.wait(protocol.TimelineSnapshot, lambda t: t.by_hand == (9, 10), said)
    poses = [s for s in page.seen[said:] if isinstance(s, protocol.PoseSnapshot)]
    assert all(pose.version == 2 for pose in poses), "the page takes them for news"
    page.wait(
        protocol.PictureSnapshot, lambda p: p.frame == 10 and ("front", "plain") in p.screens, said
    )
    states = {s.state for s in page.seen[said:] if isinstance(s, protocol.ProgressSnapshot)}
    assert "tracking" not in states, "it does not track on by itself"
    engine.engine.track(7, FRAMES, 7)
    page.wait(protocol.ProgressSnapshot, lambda p: p.state == "tracking", said)


def state_on_disk(folder):
    return Store(folder / "tracks").history().state


def test_c40_what_a_busy_engine_had_not_done_is_done_by_the_next_and_not_called_saved(
    tmp_path, start
):
    """A pose, frames accepted, a pin, a setting, and an undo in between, while the engine does not answer; a pose while there is none.
    The next one takes the lease of the dead.
    """
    page = start(tmp_path)
    engine, tracks = page.engine, tmp_path / "tracks"
    assert holder_of(tracks).pid == engine.pid
    engine.engine.set_pose(2, values_with(0.3), 1)
    engine.engine.set_pose(4, values_with(0.4), 2)
    eventually(lambda: page.saved == "saved" and not engine._outbox.edits)
    os.kill(engine.pid, signal.SIGSTOP)
    engine.engine.undo(3)  # of frame 4
    engine.engine.set_pose(5, values_with(0.5), 4)
    engine.engine.accept(((5, 5),))
    engine.engine.set_pin(5, "front", (40.0, 30.0), 5, Hold("index_tip"), tag="drag")
    engine.engine.set_setting("cloud.weight", 7.0)
    assert page.saved == "saving"
    said = page.kill()
    notice = page.wait(protocol.Notice, after=said)
    assert "frame 5" in notice.text and "cloud.weight" in notice.text
    engine.engine.set_pose(7, values_with(0.7), 6)
    told = page.seen[said : page.seen.index(notice)]
    assert not [s for s in told if isinstance(s, protocol.WorkSnapshot) and s.saved == "saved"]
    eventually(lambda: page.saved == "saved")
    state = state_on_disk(tmp_path)
    assert {
        "pose/2",
        "pose/5",
        "accepted",
        "pins/5",
        "setting/cloud.weight",
        "pose/7",
    } <= state.keys()
    assert state["pose/4"] is None or state["pose/4"].get("carried"), "undone once"
    assert state["accepted"] == [[5, 6]] and state["setting/cloud.weight"] == 7.0
    assert holder_of(tracks).pid == engine.pid
    assert not any("read-only" in notice.text for notice in page.notices)


def deadly_document(folder):
    """A document that ends the engine where a setting is changed, and whose frames take 100 GB each to track."""
    document = fake_document(folder, hungry=True)
    become = document.become

    def became(state):
        if "cloud.weight" in state.setting:
            os.kill(os.getpid(), signal.SIGKILL)
        become(state)

    document.become = became  # type: ignore[method-assign]
    return document


def test_c40_what_takes_too_much_memory_or_ends_every_engine_is_given_up_by_name_and_no_other(
    tmp_path, start
):
    page = start(tmp_path, deadly_document, memory=2 * GB)
    engine, first = page.engine.engine, page.engine.pid
    if sys.platform == "linux":  # elsewhere memory is not limited
        engine.track(3, FRAMES, 3)
        notice = page.told("Tracking stopped")
        assert "2.0 GB" in notice.text
        said = len(page.seen)
        engine.show_frame(8)
        page.wait(protocol.PoseSnapshot, lambda p: p.frame == 8, said)
        assert page.engine.pid == first, "it goes on"
    engine.set_pose(3, values_with(0.3), 1)
    engine.set_setting("cloud.weight", 7.0)
    engine.set_pose(6, values_with(0.6), 2)
    page.told("Given up: set setting cloud.weight.")
    eventually(lambda: page.saved == "saved")
    assert {"pose/3", "pose/6"} <= state_on_disk(tmp_path).keys()


def test_c40_what_an_ended_program_could_not_save_is_named(tmp_path):
    page = Page(tmp_path)
    page.engine.start()
    assert page.engine.wait_opened(600.0) is None
    assert page.engine.pid is not None
    os.kill(page.engine.pid, signal.SIGSTOP)
    page.engine.engine.set_pose(3, values_with(0.3), 1)
    page.engine.stop(0.5)
    assert "frame 3" in " ".join(page.engine.last_words)


def crashing_document(folder):
    """A document that crashes whoever opens it while a file is there."""
    if (folder / "crash").exists():
        os.kill(os.getpid(), signal.SIGSEGV)
    return fake_document(folder)


def test_c40_what_ends_again_and_again_stays_ended_until_it_is_asked_for(
    tmp_path, start, monkeypatch
):
    monkeypatch.setattr(engine_process, "_MOST_AGAIN", 1)
    monkeypatch.setattr(engine_process, "_WITHIN_S", 1e6)  # however slow the machine
    page = start(tmp_path, crashing_document)
    (tmp_path / "crash").touch()
    said = page.kill()
    page.told("The engine stays ended", said)
    assert page.wait(protocol.ProgressSnapshot, lambda p: p.state == "failed", said)
    page.engine.engine.show_frame(8)
    assert page.engine.pid is None
    page.engine.engine.set_pose(6, values_with(0.4), 1)
    assert page.saved == "unsaved"
    asked = len(page.seen)
    page.engine.engine.track(3, FRAMES, 3)
    notice = page.wait(protocol.Notice, after=asked)
    assert "track, frames 3 to" in notice.text, "nobody is there to serve it"
    (tmp_path / "crash").unlink()
    said = len(page.seen)
    page.engine.start_again()
    page.idle(said)
    page.wait(protocol.TimelineSnapshot, lambda t: t.by_hand == (6,), said)
    eventually(lambda: page.saved == "saved", "kept while nobody was there")
    said = page.kill(signal.SIGTERM)
    page.told("The engine stays ended", said)
    assert not any((tmp_path / "tracks").glob("lease-*.json"))


def test_running_cameras_are_opened_over_there(tmp_path, start):
    desk = tmp_path / "desk"
    desk.mkdir()
    make_session(desk)
    devices = {name: str(clip(tmp_path / f"{name}.avi")) for name in ("cam0", "cam1")}
    page = start(desk, None, live=LiveOptions(devices, 10.0))
    assert page.wait(protocol.SessionSnapshot).live
    folder = tmp_path / "recorded"
    page.engine.engine.record(True, str(folder))
    page.wait(protocol.LiveSnapshot, lambda told: told.recording == str(folder))
    said = page.kill()
    assert str(folder) in page.wait(protocol.Notice, after=said).text


# ---- ending

slow_document = partial(fake_document, stuck=partial(operator.le, 5))
PARENT = """
import sys, time
from pathlib import Path
from handtrack_app.process.child import LiveOptions
from handtrack_app.process import engine_process
from handtrack_app.process.engine_process import EngineProcess
from handtrack_app.process.child import EnginePlan
from tests.app.process.test_engine_process import slow_document

engine = EngineProcess(EnginePlan(Path(sys.argv[1]), opener=slow_document), lambda _: None)
engine.start()
assert engine.wait_opened(600.0) is None
engine.engine.track(3, 12, 3)
print(engine.pid, flush=True)
time.sleep(600)
"""


def test_c40_an_engine_whose_page_was_killed_ends_and_frees_the_session(tmp_path):
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(tmp_path)], env=PROGRAM, stdout=subprocess.PIPE
    )
    engine = int(parent.stdout.readline())
    tracks = tmp_path / "tracks"
    eventually(lambda: holder_of(tracks))
    assert next(tracks.glob("lease-*.json")).is_file()
    parent.kill()
    parent.wait()
    parent.stdout.close()
    eventually(lambda: not any(tracks.glob("lease-*.json")))
    eventually(lambda: not _works(engine))


def _works(pid):
    """Return whether a process runs; one that nobody waited for does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_c40_a_container_has_what_its_groups_allow(tmp_path, monkeypatch):
    own, groups = tmp_path / "cgroup", tmp_path / "groups"
    monkeypatch.setattr(child, "_OWN_GROUPS", own)
    monkeypatch.setattr(child, "_CONTROL_GROUPS", groups)
    physical = child.machine_memory()
    (groups / "a/b").mkdir(parents=True)
    (groups / "memory/c").mkdir(parents=True)
    (groups / "a/b/memory.max").write_text("max\n")
    (groups / "a/memory.max").write_text(f"{2 * GB}\n")
    (groups / "memory/c/memory.limit_in_bytes").write_text(f"{GB}\n")
    own.write_text("0::/a/b\n")
    assert child.machine_memory() == min(physical, 2 * GB)
    own.write_text("0::/a/b\n4:cpu,memory:/c\n3:pids:/d\n")
    assert child.machine_memory() == min(physical, GB)
    assert child.memory_limit() == GB, "less would be too little to begin with"
    own.write_text("0::/elsewhere\n")
    assert child.machine_memory() == physical
