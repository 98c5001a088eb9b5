"""What the page keeps until it is on disk, and repeats to the next engine."""

from threading import Thread
from unittest.mock import Mock

from handtrack_app.engine.open_session import COMMANDS
from handtrack_app.process.child import EnginePlan
from handtrack_app.process.engine_process import EngineProcess, Outbox
from handtrack_app.protocol import Hold, PoseSnapshot, WorkSnapshot


class Pipe:
    """An outbox, and what came out of it."""

    def __init__(self, is_listening=True):
        self.sent = []
        self.outbox = Outbox(self.sent.append, commands=COMMANDS)
        if is_listening:
            self.outbox.listen(is_anew=False)

    def put(self, name, *given, **named_):
        return self.outbox.put(name, given, named_) is None

    def pose(self, frame, version, tag=""):
        return self.put("set_pose", frame, (0.1 * version,), version, tag)

    def written(self, number):
        told = self.outbox.see(WorkSnapshot("saved", (), number, number))
        return None if told is None else told.saved  # type: ignore[union-attr]

    @property
    def names(self):
        return [one.name for one in self.sent]


def test_calls_that_may_have_ended_an_engine_are_repeated_one_by_one():
    pipe = Pipe()
    for frame in range(3):
        pipe.pose(frame, frame)
    pipe.outbox.ended()
    pipe.sent.clear()
    pipe.outbox.listen(is_anew=False)
    assert len(pipe.sent) == 1


def test_a_drag_is_kept_once_and_nothing_is_moved_past_a_step():
    pipe = Pipe()
    for version in range(1, 9):
        pipe.pose(3, version, "slider")
    assert [one.arguments["version"] for one in pipe.outbox.edits] == [8]
    pipe.put("save_pose")
    pipe.pose(3, 9, "slider")
    pipe.pose(3, 10, "slider")
    assert [one.name for one in pipe.outbox.edits] == ["set_pose", "save_pose", "set_pose"]
    for joint in "ab":
        pipe.put("pull_place", 3, (0.0, 0.0, 0.0), 11, Hold(joint), tag=joint)
    pulls = [one.arguments["hold"].joint for one in pipe.outbox.edits[-2:]]
    assert pulls == ["a", "b"], "another finger's is another edit"


def test_a_job_that_may_have_begun_is_given_up_and_one_that_waits_is_not():
    pipe = Pipe()
    pipe.put("track", 0, 5, 0)
    given_up = pipe.outbox.ended()
    pipe.put("refine")
    assert [one.name for one in given_up] == ["track"]
    pipe.outbox.listen(is_anew=False)
    assert pipe.names == ["track", "refine"]


def test_saved_is_all_that_was_called_whatever_else_is_looked_at():
    pipe = Pipe()
    assert pipe.written(0) == "saved"
    pipe.put("show_frame", 4)
    assert pipe.outbox.work() is None, "that is no edit"
    pipe.pose(4, 1)
    told = pipe.outbox.work()
    assert told is not None and told.saved == "saving"
    assert pipe.written(1) is None and pipe.outbox.edits
    assert pipe.written(2) == "saved"
    pipe.pose(4, 2)
    down = pipe.outbox.work(is_down=True)
    assert down is not None and down.saved == "unsaved"


def test_an_edit_while_it_is_told_that_all_is_saved_is_told_of_after_that(tmp_path):
    told = []
    edit = Thread(target=lambda: process.engine.set_pose(1, (0.1,), 1))

    def publish(work):
        if not told and not edit.ident:
            edit.start()
            edit.join(0.3)
        told.append(work.saved)

    process = EngineProcess(EnginePlan(tmp_path), publish)
    for message in (COMMANDS, WorkSnapshot("saved", (), 0, 0)):
        process._take(None, message, False)  # type: ignore[arg-type]
    edit.join()
    assert told == ["saved", "saving"]


def test_too_much_is_refused_and_not_dropped():
    pipe = Pipe(is_listening=False)
    taken = [pipe.put("accept", ((frame, frame),)) for frame in range(1100)]
    assert sum(taken) == len(pipe.outbox.edits) == 1000 and not taken[-1]


def test_the_frame_that_edits_went_on_from_is_shown_first():
    """What is saved as first pose is the one that is shown."""
    pipe = Pipe()
    for name, *given in (("show_frame", 4), ("save_pose",), ("show_frame", 9)):
        pipe.put(name, *given)
    pipe.written(1)
    pipe.outbox.ended()
    pipe.sent.clear()
    pipe.outbox.listen(is_anew=True)
    done = 0
    while len(pipe.sent) > done:  # it serves all that it is sent, and writes nothing
        done = len(pipe.sent)
        pipe.outbox.see(WorkSnapshot("saving", (), 0, pipe.sent[-1].number))
    assert [(one.name, *one.arguments.values()) for one in pipe.sent] == [
        ("show_frame", 4), ("save_pose",), ("show_frame", 9),
    ]  # fmt: skip


def test_an_engine_that_begins_again_shows_the_frame_that_was_shown():
    pipe = Pipe()
    pipe.outbox.see(Mock(PoseSnapshot, frame=8))
    pipe.outbox.ended()
    pipe.outbox.see(Mock(PoseSnapshot, frame=0))  # its first
    pipe.outbox.listen(is_anew=True)
    assert pipe.sent[0].arguments["frame"] == 8
