"""History: what was decided, action by action, and what holds after it: the one rule by which an action counts.

A session's state is a table of named values (`pose/12`, `setting/cloud.weight`, `spans`). An action is a record of what each
of them was before and is after it, so undo is an action as any other, and whoever reads all of them, a year later too,
has the same state as the program that wrote them.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import islice
from typing import Any, Literal

import msgspec

Value = Any
"""JSON; None where nothing is said"""
State = Mapping[str, Value]

DO, UNDO, REDO, NOTE = "do", "undo", "redo", "note"
_OPEN = 4  # steps that are kept as they are: the latest, which a drag goes on with, and those of an undo
Kind = Literal["do", "undo", "redo", "note"]
"""a note changes the state, and is no step of the history: what was saved to a file, say"""


@dataclass(frozen=True, order=True)
class Span:
    """Frames of one take."""

    take: int
    first: int
    stop: int
    """one past the last"""


@dataclass(frozen=True)
class Change:
    """What an action does to one value."""

    key: str
    before: Value
    after: Value


@dataclass(frozen=True)
class Action:
    """One decision."""

    id: int
    """its number in the session, from 1"""
    kind: Kind
    words: str
    """what was done, for people"""
    changes: tuple[Change, ...]
    joins: bool = False
    """one step with the action before: both belong to one drag"""
    said: tuple[str, int] | None = None
    """whose command led to it, and that command's number: none is done twice after a crash"""

    @property
    def content(self) -> dict[str, Any]:
        """What its record holds."""
        content = asdict(self)
        if self.said is None:
            del content["said"]
        return content

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Action:
        """Return the action of a record's content. Raises ValueError for one that is none."""
        return msgspec.convert(content, cls)

    @property
    def after(self) -> dict[str, Value]:
        """What holds after it, of the values that it changes."""
        return {change.key: change.after for change in self.changes}


def apply(changes: Iterable[Change], state: dict[str, Value]) -> None:
    """Make changes in a state, in place: a value of None is taken out."""
    for change in changes:
        if change.after is None:
            state.pop(change.key, None)
        else:
            state[change.key] = change.after


def merged(actions: Sequence[Action]) -> tuple[Change, ...]:
    """Return what several actions did together: each value as it was before the first of them, and after the last."""
    found: dict[str, Change] = {}
    for change in (change for action in actions for change in action.changes):
        first = found.get(change.key, change)
        found[change.key] = Change(change.key, first.before, change.after)
    return tuple(found.values())


Step = list[Action]
"""of a drag there may be several"""


def _unpacked(step: bytes) -> Step:
    return [Action.of(one) for one in json.loads(zlib.decompress(step))]


@dataclass
class Steps:
    """Steps one upon the other. Those further down are packed: of a day's work there are thousands, of 7 kB each."""

    _packed: list[bytes] = field(default_factory=list)
    _open: list[Step] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self._packed) + len(self._open)

    @property
    def top(self) -> Step:
        """The latest step. Raises IndexError where there is none."""
        if not self._open:
            self._open.append(_unpacked(self._packed.pop()))
        return self._open[-1]

    def push(self, step: Step) -> None:
        """Lay a step upon the others."""
        self._open.append(step)
        if len(self._open) > _OPEN:
            content = json.dumps([action.content for action in self._open.pop(0)])
            self._packed.append(zlib.compress(content.encode()))

    def pop(self) -> Step:
        """Take the latest step off. Raises IndexError where there is none."""
        step = self.top
        self._open.pop()
        return step

    def latest_first(self) -> Iterator[Step]:
        """Yield the steps from the latest on; none is taken off."""
        yield from reversed(self._open)
        for packed in reversed(self._packed):
            yield _unpacked(packed)

    def clear(self) -> None:
        """Forget all."""
        self._packed.clear()
        self._open.clear()


@dataclass
class History:
    """Actions so far, as state and as steps that undo and redo go along."""

    state: dict[str, Value] = field(default_factory=dict)
    past: Steps = field(default_factory=Steps)
    future: Steps = field(default_factory=Steps)
    """steps that were undone"""
    last_id: int = 0
    said: tuple[str, int] | None = None
    """the latest of its actions'"""

    @classmethod
    def of(cls, actions: Iterable[Action]) -> History:
        """Return the history of actions in their order."""
        history = cls()
        for action in actions:
            history.take(action)
        return history

    def next(
        self, words: str, changes: Sequence[Change], kind: Kind = DO, joins: bool = False
    ) -> Action:
        """Return an action that may come next; `take` makes it count."""
        return Action(self.last_id + 1, kind, words, tuple(changes), joins)

    def names(self, most: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Return what undo and redo would take back and make again, the next first, at most so many of each."""
        past, future = (
            tuple(step[0].words for step in islice(steps.latest_first(), most))
            for steps in (self.past, self.future)
        )
        return past, future

    def undoing(self) -> Action | None:
        """Return the action that takes the latest step back; None at the end of the history."""
        if not self.past:
            return None
        back = [Change(c.key, c.after, c.before) for c in merged(self.past.top)]
        return self.next(self.past.top[0].words, back, UNDO)

    def redoing(self) -> Action | None:
        """Return the action that makes the step undone last again; None where there is none."""
        if not self.future:
            return None
        return self.next(self.future.top[0].words, merged(self.future.top), REDO)

    def amend(self, changes: Sequence[Change], said: tuple[str, int] | None) -> Action:
        """Let the latest action have done this instead: a drag goes on. Return it as it is now."""
        latest = self.past.top[-1]
        self.past.top[-1] = amended = replace(latest, changes=tuple(changes), said=said)
        self._count(amended)
        return amended

    def take(self, action: Action) -> None:
        """Let an action count."""
        self.last_id = max(self.last_id, action.id)
        self._count(action)
        if action.kind == DO:
            self.future.clear()
            if action.joins and self.past:
                self.past.top.append(action)
            else:
                self.past.push([action])
        elif action.kind == UNDO and self.past:
            self.future.push(self.past.pop())
        elif action.kind == REDO and self.future:
            self.past.push(self.future.pop())

    def _count(self, action: Action) -> None:
        self.said = action.said or self.said
        apply(action.changes, self.state)
