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
from typing import Any, Literal

import msgspec

Value = Any
"""JSON; None where nothing is said"""
State = Mapping[str, Value]

DO, UNDO, REDO, NOTE = "do", "undo", "redo", "note"
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


def _packed(action: Action) -> bytes:
    """Return an action as it is kept: of a day's work there are thousands, of 7 kB each."""
    return zlib.compress(json.dumps(action.content).encode())


def _unpacked(content: bytes) -> Action:
    return Action.of(json.loads(zlib.decompress(content)))


@dataclass
class History:
    """Actions so far, as state and as steps that undo and redo go along."""

    state: dict[str, Value] = field(default_factory=dict)
    past: list[bytes] = field(default_factory=list)
    """steps, packed; a step is one action: those that joined it are merged into it"""
    future: list[bytes] = field(default_factory=list)
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
            tuple(_unpacked(step).words for step in reversed(steps[-most:]))
            for steps in (self.past, self.future)
        )
        return past, future

    @property
    def latest_first(self) -> Iterator[Action]:
        """The steps from the latest on."""
        return map(_unpacked, reversed(self.past))

    def undoing(self) -> Action | None:
        """Return the action that takes the latest step back; None at the end of the history."""
        if not self.past:
            return None
        latest = _unpacked(self.past[-1])
        back = [Change(c.key, c.after, c.before) for c in latest.changes]
        return self.next(latest.words, back, UNDO)

    def redoing(self) -> Action | None:
        """Return the action that makes the step undone last again; None where there is none."""
        if not self.future:
            return None
        undone = _unpacked(self.future[-1])
        return self.next(undone.words, undone.changes, REDO)

    def take(self, action: Action) -> None:
        """Let an action count."""
        self.last_id = max(self.last_id, action.id)
        self._count(action)
        if action.kind == DO:
            self.future.clear()
            joined = [_unpacked(self.past.pop())] if action.joins and self.past else []
            step = [*joined, action]
            self.past.append(_packed(replace(step[0], changes=merged(step))))
        elif action.kind == UNDO and self.past:
            self.future.append(self.past.pop())
        elif action.kind == REDO and self.future:
            self.past.append(self.future.pop())

    def _count(self, action: Action) -> None:
        self.said = action.said or self.said
        apply(action.changes, self.state)
