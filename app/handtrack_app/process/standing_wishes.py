"""What the page wants until it says otherwise: told again to an engine that begins anew."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace

from handtrack_app.protocol import commands
from handtrack_app.protocol.commands import Command
from handtrack_app.protocol.snapshots import LiveSnapshot, PoseSnapshot, ProgressSnapshot, Snapshot

_STANDING = (
    commands.WantPictures, commands.WantSurface, commands.WantCloud, commands.WantMasks, commands.Follow,
    commands.CompareTake, commands.WantCurves, commands.RefitWhileTuning,
)  # fmt: skip
_UNWRITTEN_S = 2.0  # edits reach the disk within one second, and a busy engine is late
_AT_WORK = ("tracking", "paused")


class StandingWishes:
    """Reads along what is said to the engine and by it, on any thread."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self.version = 0
        """of the user's newest edit"""
        self.stopped_at: int | None = None
        """the frame tracked last, while tracking runs"""
        self.recording = ""
        """the folder that running cameras are recorded to"""
        self._clock, self._lock = clock, threading.Lock()
        self._wishes: dict[type, Command] = {}
        self._frame: int | None = None
        self._edits: dict[int, tuple[float, commands.SetPose]] = {}
        self._strokes: deque[tuple[float, commands.PaintMask]] = deque()

    def note(self, command: Command) -> None:
        """The page says this to the engine."""
        with self._lock:
            self._note(command)

    def see(self, snapshot: Snapshot) -> None:
        """The engine says this to the page."""
        match snapshot:
            case PoseSnapshot():
                self._frame = snapshot.frame
            case LiveSnapshot():
                self.recording = snapshot.recording
            case ProgressSnapshot(state=state) if state != "opening":
                self.stopped_at = snapshot.frame if state in _AT_WORK else None

    def again(self) -> list[Command]:
        """Return what is to be said again: wishes, edits that may not have been written, and the frame shown at last."""
        now, frame = self._clock(), self._frame
        show = [] if frame is None else [commands.ShowFrame(frame)]
        with self._lock:
            edits = [  # as of now: the new engine passes over what is older than the newest edit
                replace(edit, version=self.version)
                for when, edit in self._edits.values()
                if now - when < _UNWRITTEN_S
            ]
            self._edits.clear()
            # painting the same again, in order, changes nothing that was written
            strokes = [stroke for when, stroke in self._strokes if now - when < _UNWRITTEN_S]
            self._strokes.clear()
            return [*self._wishes.values(), *edits, *strokes, *show]

    def _note(self, command: Command) -> None:
        match command:
            case commands.SetPose():
                self._edits[command.frame] = (self._clock(), command)
            case commands.PaintMask():
                now = self._clock()
                self._strokes.append((now, command))
                while now - self._strokes[0][0] > _UNWRITTEN_S:
                    self._strokes.popleft()
            case _ if isinstance(command, _STANDING):
                self._wishes[type(command)] = command
            case commands.ShowFrame() | commands.LookBefore():
                pass
            case _:
                self._edits.clear()  # what came before it is not to come back over it
        version = getattr(command, "version", 0)
        self.version = max(self.version, version)
