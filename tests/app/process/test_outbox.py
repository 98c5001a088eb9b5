"""What the page keeps until it is on disk, and says again to the next engine."""

from __future__ import annotations

from handtrack_app.process.outbox import Outbox, named
from handtrack_app.protocol import commands
from handtrack_app.protocol.snapshots import WorkSnapshot


def pose(frame: int, version: int, tag: str = "") -> commands.SetPose:
    return commands.SetPose(frame, (0.1 * version,), version, tag)


def sent(outbox: Outbox) -> list[commands.Command]:
    """Send all that waits."""
    found = []
    while (taken := outbox.take(0.0)) is not None:
        found.append(taken.command if isinstance(taken, commands.Numbered) else taken)
    return found


def sent_one_by_one(outbox: Outbox) -> list[commands.Command]:
    """Send all that waits, to an engine that does each at once, and writes nothing."""
    found = []
    while (taken := outbox.take(0.0)) is not None:
        found.append(taken.command if isinstance(taken, commands.Numbered) else taken)
        if isinstance(taken, commands.Numbered):
            outbox.see(WorkSnapshot("saving", (), 0, taken.number))
    return found


def written(outbox: Outbox, number: int, saved: str = "saved") -> str | None:
    told = outbox.see(WorkSnapshot(saved, (), number, number))
    return None if told is None else told.saved  # type: ignore[union-attr]


def test_all_above_what_is_on_disk_is_said_again_in_order() -> None:
    outbox = Outbox()
    wish = commands.WantPictures(True, "plain")
    said = [
        pose(3, 1),
        commands.Undo(2),
        commands.Accept(((1, 2),)),
        pose(3, 3),
        commands.SetSetting("a", 1),
    ]
    for command in (wish, *said):
        assert outbox.put(command)
    assert sent(outbox) == [wish, *said]
    assert written(outbox, 3) == "saving", "1 is the wish, 3 the undo"
    assert outbox.edits == said[2:]
    assert outbox.ended() == []
    assert outbox.again() == [wish]
    assert len(sent(outbox)) == 1, "one of them may have ended it"
    outbox.ended()
    again = sent_one_by_one(outbox)
    assert [type(one) for one in again] == [commands.Accept, commands.SetPose, commands.SetSetting]
    assert written(outbox, 6) == "saved"
    assert not outbox.edits


def test_a_pose_said_again_is_no_older_than_what_the_engine_is_told() -> None:
    outbox = Outbox()
    outbox.put(pose(7, 1))
    outbox.put(commands.TakePose(6, "start", 5))
    outbox.take(0.0)  # the other waits yet
    outbox.ended()
    outbox.put(pose(8, 6))
    assert [one.version for one in sent_one_by_one(outbox)] == [5, 5, 6]  # type: ignore[union-attr]
    assert outbox.version == 5


def test_a_drag_is_kept_once_and_nothing_is_moved_past_a_step() -> None:
    outbox = Outbox()
    for version in range(1, 9):
        outbox.put(pose(3, version, "slider"))
        sent(outbox)
    assert [one.version for one in outbox.edits] == [8]  # type: ignore[attr-defined]
    outbox.put(commands.SavePose())
    outbox.put(pose(3, 9, "slider"))
    outbox.put(pose(3, 10, "slider"))
    assert [type(one) for one in outbox.edits] == [
        commands.SetPose,
        commands.SavePose,
        commands.SetPose,
    ]
    first, second = (commands.PullPlace(3, (0.0, 0.0, 0.0), 11, joint, tag=joint) for joint in "ab")
    outbox.put(first)
    outbox.put(second)
    assert outbox.edits[-2:] == [first, second], "another finger's is another edit"


def test_a_job_that_may_have_begun_is_given_up_and_one_that_waits_is_not() -> None:
    outbox, track = Outbox(), commands.Track(0, 5, 0)
    outbox.put(track)
    sent(outbox)
    outbox.put(commands.Refine())
    assert outbox.ended() == [track]
    assert sent(outbox) == [commands.Refine()]
    assert "0–4" in named([track])


def test_what_ends_every_engine_is_given_up_and_not_what_comes_before_it() -> None:
    outbox, deadly = Outbox(), commands.SetSetting("deadly", 1)
    for command in (pose(3, 1), deadly, pose(5, 2)):
        outbox.put(command)
    sent(outbox)
    given_up = [outbox.ended()]
    while not given_up[-1]:
        for _ in range(2):  # the pose is done, the setting ends it
            taken = outbox.take(0.0)
            assert isinstance(taken, commands.Numbered)
            if taken.command != deadly:
                outbox.see(WorkSnapshot("saving", (), 0, taken.number))
        given_up.append(outbox.ended())
        assert len(given_up) < 9
    assert given_up[-1] == [deadly]
    assert [one.frame for one in outbox.edits] == [3, 5]  # type: ignore[attr-defined]


def test_saved_is_all_that_was_sent_whatever_else_is_looked_at() -> None:
    outbox = Outbox()
    assert written(outbox, 0) == "saved"
    outbox.put(commands.ShowFrame(4))
    assert outbox.work() is None, "that is no edit"
    outbox.put(pose(4, 1))
    told = outbox.work()
    assert told is not None and told.saved == "saving"
    sent(outbox)
    assert written(outbox, 1) is None and outbox.edits
    assert written(outbox, 2) == "saved"
    outbox.put(pose(4, 2))
    down = outbox.work(is_down=True)
    assert down is not None and down.saved == "unsaved"


def test_too_much_is_refused_and_not_dropped() -> None:
    outbox = Outbox()
    taken = [outbox.put(commands.Accept(((frame, frame),))) for frame in range(1100)]
    assert sum(taken) == len(outbox.edits) == 1000 and not taken[-1]


def test_the_frame_that_edits_went_on_from_is_shown_first() -> None:
    """What is saved as first pose is the one that is shown."""
    outbox = Outbox()
    for command in (commands.ShowFrame(4), commands.SavePose(), commands.ShowFrame(9)):
        outbox.put(command)
    sent(outbox)
    written(outbox, 1)
    outbox.ended()
    assert [*outbox.again(), *sent_one_by_one(outbox)] == [
        commands.ShowFrame(4), commands.SavePose(), commands.ShowFrame(9),
    ]  # fmt: skip
