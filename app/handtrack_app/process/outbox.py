"""What the page has asked of the engine: commands have numbers, and are kept until the engine says that they are on disk. To an
engine that begins anew the rest is said again, in order.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, replace

from handtrack_app.protocol import commands
from handtrack_app.protocol.commands import (
    JOBS,
    VIEWS,
    Command,
    Numbered,
    is_edit,
    is_step,
    kind_of,
)
from handtrack_app.protocol.snapshots import (
    LiveSnapshot,
    PoseSnapshot,
    ProgressSnapshot,
    Snapshot,
    WorkSnapshot,
)

_MOST = 1000  # commands that wait: nobody presses so many while an engine begins
_MOST_ENDS = (
    2  # engines that end while they do the one command that they were told: it is what ends them
)
_AT_WORK = ("tracking", "paused")


@dataclass
class _Entry:
    number: int
    command: Command
    is_sent: bool = False
    """to the engine of now"""
    is_again: bool = False
    """it was sent to one before"""
    is_done: bool = False
    """by the engine of now, if not on disk yet"""
    ends: int = 0
    """engines that ended while they did this alone"""


class Outbox:
    """What is kept, and what was said by the engine. Any thread may ask."""

    def __init__(self) -> None:
        self.version = 0
        """of the user's newest edit when the engine of now began"""
        self._newest = 0
        self.stopped_at: int | None = None
        """the frame tracked last, while tracking runs"""
        self.job = ""
        """what the engine is at, while a job runs"""
        self.recording = ""
        """the folder that running cameras are recorded to"""
        self._changed = threading.Condition()
        self._number = 0
        self._kept: list[_Entry] = []
        self._views: dict[type, Command] = {}
        self._frame: int | None = None
        self._frame_done: int | None = None
        """that was shown before the oldest command that is kept"""
        self._work: WorkSnapshot | None = None
        self._told: WorkSnapshot | None = None
        self._is_down = False

    # ---- from the page

    def put(self, command: Command) -> bool:
        """Keep a command, in the place of a waiting one that it replaces; return whether there was room for it. While the engine
        stays ended, edits alone are kept.
        """
        with self._changed:
            if isinstance(command, VIEWS):
                self._views[type(command)] = command
            if self._is_down and not is_edit(command):
                return not isinstance(command, JOBS)  # nobody is there to serve it
            self._replace(command)
            if len(self._kept) >= _MOST:
                return False
            self._number += 1
            self._kept.append(_Entry(self._number, command))
            self._newest = max(self._newest, getattr(command, "version", 0))
            self._changed.notify_all()
            return True

    def _replace(self, command: Command) -> None:
        kind, between = kind_of(command), False
        for place in range(len(self._kept) - 1 if kind is not None else -1, -1, -1):
            entry = self._kept[place]
            # one that is sent was perhaps done: the next takes its place only as the same drag going on
            goes_on = not between and getattr(entry.command, "tag", "") == getattr(
                command, "tag", ""
            )
            if kind_of(entry.command) == kind and (goes_on or not entry.is_sent):
                del self._kept[place]
                return
            if entry.is_sent or is_step(entry.command):
                return
            between = between or _is_work(entry.command)

    # ---- to the engine

    def again(self) -> list[Command]:
        """Return what an engine that begins anew is told first: what the page looks at."""
        with self._changed:
            frame = self._frame_done if self._kept else self._frame
            show = [] if frame is None else [commands.ShowFrame(frame)]
            return [*self._views.values(), *show]

    def take(self, timeout: float) -> Command | Numbered | None:
        """Return what is to be sent next; None when `timeout` [s] has passed."""
        with self._changed:
            self._changed.wait_for(lambda: self._unsent is not None, timeout)
            entry = self._unsent
            if entry is None:
                return None
            if not _is_work(entry.command):
                self._kept.remove(entry)
                return entry.command
            entry.is_sent = True
            command = entry.command
            if getattr(command, "version", self.version) < self.version:
                # the engine passes over poses that are older than what it was told of
                command = replace(command, version=self.version)  # type: ignore[call-arg]
            return Numbered(command, entry.number)

    @property
    def _unsent(self) -> _Entry | None:
        if any(entry.is_again and entry.is_sent and not entry.is_done for entry in self._kept):
            return None  # one of them may have ended the engine before: they are done one by one
        return next((entry for entry in self._kept if not entry.is_sent), None)

    def ended(self) -> list[Command]:
        """The engine ended: what it had not done is to be said again. Return what is given up: jobs that it may have begun, and
        what it ended with again and again.
        """
        with self._changed:
            self.version = self._newest
            sent = [entry for entry in self._kept if entry.is_sent]
            given_up = [entry for entry in sent if isinstance(entry.command, JOBS)]
            edits = [entry for entry in sent if entry not in given_up]
            for entry in [entry for entry in edits if entry.is_again and not entry.is_done][:1]:
                entry.ends += 1
                if entry.ends >= _MOST_ENDS:
                    given_up.append(entry)
            for entry in edits:
                entry.is_sent, entry.is_done, entry.is_again = False, False, True
            self._kept = [entry for entry in self._kept if entry not in given_up]
            self._changed.notify_all()
            return [entry.command for entry in given_up]

    # ---- from the engine

    def see(self, snapshot: Snapshot) -> Snapshot | None:
        """The engine says this; return what the page is to be told."""
        with self._changed:
            match snapshot:
                case PoseSnapshot():
                    self._frame = snapshot.frame
                    if not self._kept:
                        self._frame_done = snapshot.frame
                case LiveSnapshot():
                    self.recording = snapshot.recording
                case ProgressSnapshot(state=state) if state != "opening":
                    self.stopped_at = snapshot.frame if state in _AT_WORK else None
                    self.job = snapshot.job if state != "idle" else ""
                case WorkSnapshot():
                    self._work = snapshot
                    self._done(snapshot.done, snapshot.written)
                    return self._news()
            return snapshot

    def _done(self, done: int, number: int) -> None:
        for entry in self._kept:
            entry.is_done = entry.is_done or (entry.is_sent and entry.number <= done)
            if entry.number <= number and isinstance(entry.command, commands.ShowFrame):
                self._frame_done = entry.command.frame
        self._kept = [entry for entry in self._kept if entry.number > number]
        self._changed.notify_all()

    def work(self, is_down: bool | None = None) -> WorkSnapshot | None:
        """Return what is new of what is saved: `saved` is all that was sent, and no less. is_down: whether the engine stays ended."""
        with self._changed:
            self._is_down = self._is_down if is_down is None else is_down
            return self._news()

    def _news(self) -> WorkSnapshot | None:
        if self._work is None:
            return None
        saved = self._work.saved
        if saved == "saved" and self._edits:
            saved = "unsaved" if self._is_down else "saving"
        now = WorkSnapshot(saved, self._work.takes)
        if now == self._told:
            return None
        self._told = now
        return now

    # ---- what is not on disk

    @property
    def _edits(self) -> list[Command]:
        return [entry.command for entry in self._kept if is_edit(entry.command)]

    @property
    def edits(self) -> list[Command]:
        """The edits that are not known to be on disk, in order."""
        with self._changed:
            return self._edits

    def wait_done(self, timeout: float) -> None:
        """Wait until all edits are on disk, a while at most."""
        until = time.monotonic() + timeout
        with self._changed:
            while self._edits and (left := until - time.monotonic()) > 0:
                self._changed.wait(left)


def _is_work(command: Command) -> bool:
    return is_edit(command) or isinstance(command, (commands.ShowFrame, *JOBS))


def named(given: Iterable[Command]) -> str:
    """Return what commands are about, in words: what may be lost is to be named."""
    counts = Counter(map(_words, given))
    return ", ".join(f"{words} ({n} times)" if n > 1 else words for words, n in counts.items())


def _words(command: Command) -> str:
    match command:
        case commands.SetPose() | commands.TakePose() | commands.PullPlace() | commands.TakeGuess():
            return f"the pose of frame {command.frame}"
        case commands.ForgetPose():
            return f"dropping the pose of frame {command.frame}"
        case commands.SetPin() | commands.DropPins() | commands.CopyPins():
            return f"pins of frame {command.frame}"
        case commands.PaintMask() | commands.DropCorrection():
            return f"the mask of {command.camera}, frame {command.frame}"
        case commands.SetSetting():
            return f"the setting {command.name}"
        case commands.SetLimits():
            return f"the limits of {command.name}"
        case commands.SetShape():
            return f"the shape's {command.name}"
        case commands.Accept():
            spans = ", ".join(f"{a}–{b}" if a != b else f"{a}" for a, b in command.spans[:3])
            more = " …" if len(command.spans) > 3 else ""
            return f"{'accepting' if command.on else 'letting go'} frames {spans}{more}"
        case commands.RestoreTake() | commands.ShowTake():
            return f"take {command.number}"
        case commands.Track():
            return f"tracking frames {command.start}–{command.stop - 1}"
    return _PLAIN.get(type(command), type(command).__name__)


_PLAIN: dict[type, str] = {
    commands.Undo: "an undo",
    commands.Redo: "a redo",
    commands.SetClouds: "settings of clouds",
    commands.RestoreClouds: "settings of clouds",
    commands.SaveClouds: "saving settings of clouds",
    commands.SetMasks: "settings of masks",
    commands.SampleSkin: "the colour of skin",
    commands.MarkMaskBox: "a box for masks",
    commands.RestoreMasks: "settings of masks",
    commands.SaveMasks: "saving settings of masks",
    commands.SavePose: "saving the first-frame pose",
    commands.SaveTrack: "saving the track",
    commands.SaveSettings: "saving settings",
    commands.Refine: "refining",
    commands.FitSize: "fitting the size",
    commands.TakeSize: "taking the size",
    commands.FindHand: "finding the first pose",
    commands.TrackLive: "live tracking",
    commands.CarryMasks: "carrying masks on",
    commands.Record: "recording",
    commands.Export: "an export",
    commands.WantLibrary: "the pose library",
}
