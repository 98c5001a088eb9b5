"""The engine killed at random moments while somebody edits: in work, while it does not answer, while it opens again.

What the page called saved is on disk at once; in the end all is, in order and once, or it was given up by name. The measure is
`HANDTRACK_KILLS=300 pytest -s tests/app/process/test_engine_kills.py`.
"""

import os
import random
import signal
import time
from contextlib import suppress

import pytest

from handtrack_app.process import engine_process
from handtrack_app.protocol import Hold
from tests.app.fake_run import FRAMES
from tests.app.process.test_engine_process import Page, state_on_disk, values_with
from tests.app.waiting import eventually

KILLS = int(os.environ.get("HANDTRACK_KILLS", "3"))
SEED = int(os.environ.get("HANDTRACK_SEED", "27"))
pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="signals"),
    pytest.mark.usefixtures("quick_engines"),
]


class Editor:
    """Somebody who edits, and knows what must be there."""

    def __init__(self, page, folder, rng):
        self.page, self.folder, self.rng = page, folder, rng
        self.expected = {}
        """by key: what was done last, and by which command"""
        self.sent = self.acknowledged = 0
        self.accepted = set()

    def _send(self, name, *given, **named):
        getattr(self.page.engine.engine, name)(*given, **named)
        self.sent += 1

    def _expect(self, key, value):
        self.expected[key] = (value, self.sent)

    def edit(self):
        """Do one thing."""
        rng = self.rng
        rng.choice((self._pose, self._pose, self._pin, self._setting, self._accept))()

    def _pose(self):
        frame, bend = self.rng.randrange(1, 6), round(self.rng.uniform(0.1, 1.0), 4)
        self._send("set_pose", frame, values_with(bend), self.sent + 1)
        self._expect(f"pose/{frame}", bend)

    def _pin(self):
        frame = self.rng.randrange(6, FRAMES)  # a pin moves its frame's pose
        row = float(self.rng.randrange(20, 40))
        self._send("drop_pins", frame, None, self.sent + 1)
        self._send("set_pin", frame, "front", (40.0, row), self.sent + 1, hold=Hold("index_tip"), tag=str(self.sent))  # fmt: skip
        self._expect(f"pins/{frame}", row)

    def _setting(self):
        name = self.rng.choice(("cloud.weight", "silhouettes.weight"))
        value = round(self.rng.uniform(2.0, 9.0), 3)
        self._send("set_setting", name, value)
        self._expect(f"setting/{name}", value)

    def _accept(self):
        """Accept a frame or let it go; at times that is undone: one step too many or too few would show."""
        frame = self.rng.randrange(1, 6)
        on = frame not in self.accepted
        pose = frame in {int(k.split("/")[1]) for k in self.expected if k.startswith("pose/")}
        if not pose:
            return
        self._send("accept", ((frame, frame),), on)
        if self.rng.random() < 0.5:
            self._send("undo", self.sent + 1)
        else:
            (self.accepted.add if on else self.accepted.discard)(frame)
        self._expect("accepted", frozenset(self.accepted))

    # ---- what must be there

    def look(self):
        """Take note of what the page calls saved."""
        if self.page.saved == "saved":
            self.acknowledged = self.sent

    def missing(self, upto):
        """Return what was done last by one of so many commands, and is not on disk as it was done."""
        state = state_on_disk(self.folder)
        return [
            f"{key}: {value} expected, {found}"
            for key, (value, number) in self.expected.items()
            if number <= upto and (found := plain(key, state.get(key))) != value
        ]


def plain(key, value):
    """Return what is on disk as it was asked for."""
    kind = key.partition("/")[0]
    if kind == "pose":
        return None if value is None else round(value["parameters"]["index_pip_flex"], 4)
    if kind == "pins":
        return value["pins"][0]["pixel"][1] if value and len(value["pins"]) == 1 else value
    if kind == "accepted":
        return frozenset(f for first, stop in value or () for f in range(first, stop))
    return value


def test_no_edit_is_lost_or_done_twice_however_often_the_engine_is_killed(tmp_path, monkeypatch):
    monkeypatch.setattr(engine_process, "_MOST_AGAIN", 10**6)  # it begins again however often
    rng, page = random.Random(SEED), Page(tmp_path)
    page.engine.start()
    assert page.engine.wait_opened(600.0) is None
    editor, kills = Editor(page, tmp_path, rng), 0
    while kills < KILLS:
        way = rng.choice(("at work", "at work", "does not answer", "opening"))
        if way != "opening":
            eventually(lambda: page.engine._outbox._reported is not None and page.saved != "")
            if rng.random() < 0.6:
                eventually(lambda: page.saved == "saved", "saved")
                editor.look()
        pid = page.engine.pid
        if way == "does not answer" and pid is not None:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGSTOP)
        for _ in range(rng.randrange(1, 7)):
            editor.edit()
            time.sleep(rng.uniform(0.0, 0.02))
        time.sleep(rng.choice((0.0, rng.uniform(0.0, 0.1), rng.uniform(0.0, 1.2))))
        editor.look()
        eventually(lambda: page.engine.pid is not None, "an engine")
        pid = page.engine.pid
        with suppress(ProcessLookupError, TypeError):
            os.kill(pid, signal.SIGKILL)  # type: ignore[arg-type]
            kills += 1
        eventually(lambda pid=pid: page.engine.pid != pid, "it ended")
        for _ in range(rng.randrange(0, 3)):
            editor.edit()  # nobody is there
        lost = editor.missing(editor.acknowledged)
        assert not lost, f"acknowledged, and lost after kill {kills}: {lost}"
    eventually(lambda: page.saved == "saved" and not page.engine._outbox.edits, "all saved")
    given_up = [n.text for n in page.notices if "Given up" in n.text]
    missing = editor.missing(editor.sent)
    page.engine.stop(60.0)
    refused = [n.text for n in page.notices if n.title in ("That did not work", "Internal error")]
    print(
        f"{kills} kills, {editor.sent} edits, {len(given_up)} given up by name, {len(missing)} lost"
    )
    assert not missing and not refused and not given_up
