"""The workbench's store killed at random moments, or its disk full: what was acknowledged is there again, unchanged.

A program edits, undoes, tracks, pauses, saves, is looked at by a second one, and begins again; the model of what must be
there is the history itself. `HANDTRACK_KILLS=300 pytest tests/app/engine/test_kills.py` is the nightly measure.
"""

import os
import random
import re
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from handtrack import HandtrackError
from handtrack.session.session_state import SessionState, decide, name_of, written
from handtrack.store.history import History
from handtrack.store.store import Store
from handtrack_app.engine.posing_service import pose as pose_edit
from handtrack_app.engine.posing_service import set_pose
from tests.app.fake_run import FRAMES
from tests.app.opened import opened
from tests.killing import KILLS, forked, killed

OURS = re.compile(
    r"(actions|takes/\d{4})/\d{6}\.log|lease-\d{6}\.json|poses\.npz|versions/poses_[\w.-]+\.npz"
)
"""files that a session's tracks/ may have"""


@dataclass
class Known:
    """What must be there: actions that were acknowledged, and frames that were shown."""

    last_id: int = 0
    state: dict[str, Any] = field(default_factory=dict)
    frames: set[tuple[int, int]] = field(default_factory=set)
    """take and frame"""

    def hear(self, line):
        if line[0] == "saved":
            self.last_id, self.state = line[1], line[2]
        elif line[0] == "frame":
            self.frames.add((line[1], line[2]))

    def check(self, folder):
        """Raise AssertionError where an acknowledged action is lost or changed."""
        store = Store(folder / "tracks")
        up_to_it = History.of(a for a in store.actions() if a.id <= self.last_id)
        assert up_to_it.state == self.state
        again = opened(folder)
        document = again.document
        given = document.state
        assert {
            name_of(key): written(key, value)
            for key, value in given.changed(SessionState()).items()
        } == again.history.state
        shown = {frame for frame, pose in given.pose.items() if not pose.carried}
        assert document.by_hand.keys() == shown
        for frame, values in document.by_hand.items():
            parameters = given.pose[frame].parameters
            assert [parameters[n] for n in document.model.parameter_names] == values.tolist()
        again.close()
        takes = [take.number for take in store.takes()]
        there = {(number, frame) for number in takes for frame in store.frames_of(number)}
        assert self.frames <= there, "frames that were shown"
        self.last_id, self.state = again.history.last_id, dict(again.history.state)


class Session:
    """A program at work, which tells what it acknowledged."""

    def __init__(self, folder, tell, rng):
        self.folder, self.tell, self.rng = folder, tell, rng
        self.open()

    def open(self):
        self.store = opened(self.folder)

    def deed(self):
        """Do one thing, and tell what is saved."""
        rng, store = self.rng, self.store
        deeds = [self.pose] * 8 + [self.setting] * 2 + [self.limits] * 2 + [store.undo] * 4
        deeds += [store.redo] * 2 + [self.track] * 2 + [self.save, self.again, self.second]
        try:
            rng.choice(deeds)()
        except HandtrackError:
            self.tell("failed")
        if self.store.saved == "saved":  # and not merely kept nowhere, where opening found no room
            self.tell("saved", self.store.history.last_id, self.store.history.state)

    def pose(self):
        document, rng = self.store.document, self.rng
        frame, model = rng.randrange(FRAMES), document.model
        values = model.params_within_limits(document.start + rng.uniform(-0.1, 0.1))
        pose = set_pose(document, frame, model.joint_params(values), found=rng.random() < 0.2)
        tag = rng.choice(("", "slider"))
        self.store.do("Pose", pose, tag, waits=rng.random() < 0.5)

    def setting(self):
        name = self.rng.choice(("cloud.weight", "silhouettes.weight"))
        self.store.do("Setting", decide(setting={name: self.rng.choice((1.0, 2.0, 3.0))}))

    def limits(self):
        interval = self.rng.choice((None, (0.0, self.rng.uniform(0.2, 1.0))))
        self.store.do("Limits", decide(limits={"index_pip_flex": interval}))

    def track(self):
        store, rng = self.store, self.rng
        document, first = store.document, rng.randrange(FRAMES)
        params = document.start_params(first)
        frames = range(first, FRAMES)
        store.begin_take(frames, first, params)
        number, done = store._take.number, 0
        stop = rng.randrange(1, FRAMES)
        try:
            for result in document.run.track(frames, first, params):  # type: ignore[attr-defined]
                if done == stop:  # paused, something else done, and cancelled
                    self.pose()
                    break
                store.add(result)
                if store.store is not None:
                    self.tell("frame", number, result.frame)
                done += 1
        finally:
            store.end_take(finished=done == len(frames))

    def save(self):
        self.store.save_track()

    def again(self):
        with suppress(HandtrackError):  # what could not be written was never told to be saved
            self.store.close()
        self.open()

    def second(self):
        other = opened(self.folder)
        # where the first found no room for its lease, the second may write
        assert other.warning or self.store.store is None
        other.do("Pose", pose_edit(other.document, 2, other.document.start.tolist()))
        other.close()


def work(folder, told, rng, fate):
    """Work until the end."""
    session = Session(folder, told, rng)
    told("opened")
    fate.arm()
    while True:
        session.deed()


@forked
def test_a1_a3_a4_a5_a6_a7_killed_at_any_moment_no_acknowledged_action_is_lost(
    tmp_path,
):
    rng, known, actions = random.Random(7), Known(), 0
    for _ in range(KILLS):
        before = known.last_id
        for line in killed(tmp_path, random.Random(rng.random()), work, lines=40):
            known.hear(line)
        known.check(tmp_path)
        actions += known.last_id - before
    for path in tmp_path.rglob(".*.part*"):
        os.utime(path, (0, 0))  # it was left long ago
    known.check(tmp_path)
    assert not strays(tmp_path / "tracks")
    assert actions > KILLS and known.frames
    print(f"{KILLS} kills, {actions} actions, {len(known.frames)} frames acknowledged, 0 lost")


def strays(folder):
    names = [p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()]
    return [name for name in names if not OURS.fullmatch(name)]
