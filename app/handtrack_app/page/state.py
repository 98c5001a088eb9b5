"""What the user has chosen: plain data, no viser; and undo."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from handtrack_app.protocol.commands import Command

_MERGE_S = 0.8  # edits of one control closer than this are one step of undo: a drag is one step


@dataclass
class Display:
    """What is drawn."""

    mode: str = "Flesh"
    """`Flesh`, `Surface`, `Skeleton`, `Field` or `All`"""
    cameras: bool = True
    images: bool = True
    truth: bool = True
    handle: bool = True
    tips: bool = False
    opacity: float = 1.0
    paint: str = "outline"
    """`plain`, `outline`, `residual` or `field`"""
    through: str | None = None
    """the camera that the view looks through"""
    screen: str | None = None
    """the camera whose picture stands behind the hand"""
    ghosts: bool = True
    """poses that the frame may have, besides the one shown"""
    cloud: bool = True
    cloud_colour: str = "residual"
    """`residual` (distance to the model), `own` or `plain`"""
    cloud_size_mm: float = 1.6
    cloud_dropped: bool = False
    """also the points that a filter dropped"""
    cloud_picture: str = "images"
    """`images`, `stereo` or `none`"""
    cloud_wide: bool = False
    stereo_pair: tuple[str, str] | None = None
    skin_box: tuple[str, tuple[int, int, int, int]] | None = None
    """camera and x, y, w, h [px] of the marked patch of skin"""

    @property
    def flesh(self) -> bool:
        return self.mode in ("Flesh", "All")

    @property
    def surface(self) -> bool:
        return self.mode == "Surface"

    @property
    def skeleton(self) -> bool:
        return self.mode in ("Skeleton", "All")

    @property
    def field(self) -> bool:
        return self.mode in ("Field", "All")


@dataclass(frozen=True)
class PoseStep:
    """A pose that undo can return to."""

    frame: int
    values: tuple[float, ...]


@dataclass(frozen=True)
class ChangeStep:
    """A change of settings, limits or filters: what to send to take it back, and to make it again."""

    words: str
    back: tuple[Command, ...]
    forth: tuple[Command, ...]


Step = PoseStep | ChangeStep


@dataclass
class UndoStack:
    """Poses and changes before and after what holds now. Steps with the same tag in quick succession merge."""

    past: list[Step] = field(default_factory=list)
    future: list[Step] = field(default_factory=list)
    depth: int = 200
    _tag: str = ""
    _when: float = -math.inf

    def record(self, step: Step, tag: str, now: float | None = None) -> None:
        """Remember the pose before an edit, or a change."""
        now = time.monotonic() if now is None else now
        merges = tag == self._tag and now - self._when < _MERGE_S and bool(self.past)
        self._tag, self._when = tag, now
        self.future.clear()
        last = self.past[-1] if merges else None
        if isinstance(last, ChangeStep) and isinstance(step, ChangeStep):
            self.past[-1] = replace(last, forth=step.forth)
        elif not (
            isinstance(last, PoseStep) and isinstance(step, PoseStep) and last.frame == step.frame
        ):
            self.past.append(step)
            del self.past[: -self.depth]

    def undo(self, current: PoseStep) -> Step | None:
        """Return the pose to go back to, or the change to take back; None at the end."""
        return self._move(self.past, self.future, current)

    def redo(self, current: PoseStep) -> Step | None:
        """Return the pose to go forward to, or the change to make again; None at the end."""
        return self._move(self.future, self.past, current)

    def forget_poses(self) -> None:
        """Drop the poses: those of another model mean nothing any more."""
        for steps in (self.past, self.future):
            steps[:] = [step for step in steps if isinstance(step, ChangeStep)]

    def _move(self, source: list[Step], sink: list[Step], current: PoseStep) -> Step | None:
        self._tag = ""
        if not source:
            return None
        step = source.pop()
        sink.append(step if isinstance(step, ChangeStep) else current)
        return step


@dataclass
class UserState:
    """The page's side of the truth. Callbacks run on many threads: hold `lock` for more than one field."""

    names: tuple[str, ...] = ()
    frame: int = 0
    start: int = 0
    stop: int = 1
    values: tuple[float, ...] = ()
    """(S,) joint parameters as the user last set or saw them [m, rad]"""
    version: int = 0
    playing: bool = False
    tracking: bool = False
    """a job runs: what is only shown gives way"""
    speed: float = 1.0
    follow: bool = True
    """the view follows the tracker"""
    editor: int | None = None
    """the client whose changes count"""
    display: Display = field(default_factory=Display)
    undo: UndoStack = field(default_factory=UndoStack)
    lock: threading.RLock = field(default_factory=threading.RLock)

    def value_of(self, name: str) -> float:
        """Return a joint parameter as the user last set or saw it [m, rad]."""
        with self.lock:
            return (
                self.values[self.names.index(name)] if self.values and name in self.names else 0.0
            )

    def step(self) -> PoseStep:
        """Return the pose as it is now."""
        return PoseStep(self.frame, self.values)

    def edit(self, changes: dict[str, float], tag: str) -> PoseStep | None:
        """Change joint parameters by name [m, rad]; return the new pose, None if nothing is valid or new."""
        with self.lock:
            valid = {
                n: float(v) for n, v in changes.items() if n in self.names and math.isfinite(v)
            }
            if not self.values or not valid:
                return None
            values = tuple(valid.get(n, v) for n, v in zip(self.names, self.values, strict=True))
            if values == self.values:
                return None
            return self.replace(values, tag)

    def replace(self, values: Sequence[float], tag: str) -> PoseStep:
        """Set the whole pose, remembering the one before."""
        with self.lock:
            self.undo.record(self.step(), tag)
            self.values = tuple(values)
            self.version += 1
            self.follow = False
            return self.step()

    def travel(self, back: bool) -> Step | None:
        """Undo (`back`) or redo; return the pose to show or the change to make, None at the end of the history."""
        with self.lock:
            move = self.undo.undo if back else self.undo.redo
            target = move(self.step())
            if isinstance(target, PoseStep):
                self.frame, self.values = target.frame, target.values
                self.version += 1
            return target

    def changes(self, step: ChangeStep) -> None:
        """Remember a change of settings, limits or filters."""
        with self.lock:
            self.undo.record(step, step.words)

    def waits_for_settings(self, back: bool) -> bool:
        """Return whether undo (`back`) or redo would change settings while tracking keeps them fixed."""
        with self.lock:
            steps = self.undo.past if back else self.undo.future
            return self.tracking and bool(steps) and isinstance(steps[-1], ChangeStep)

    def begin_edit(self, tag: str) -> int:
        """Remember the pose before an edit that the worker computes; return the edit's version."""
        with self.lock:
            self.undo.record(self.step(), tag)
            self.version += 1
            self.follow = False
            return self.version

    def clamp_frame(self, frame: float) -> int | None:
        """Return a frame of the session for any number from a client; None for no number."""
        if not math.isfinite(frame):
            return None
        return int(min(max(round(frame), self.start), self.stop - 1))
