"""History: what was decided, action by action, and what holds after it: the one rule by which an action counts.

A session's state is a table of named values (`pose/12`, `setting/cloud.weight`, `spans`). An action is a record of what each
of them was before and is after it, so undo is an action as any other, and whoever reads all of them, a year later too,
has the same state as the program that wrote them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

Value = Any
"""JSON; None where nothing is said"""
State = Mapping[str, Value]

DO, UNDO, REDO, NOTE = "do", "undo", "redo", "note"
KINDS = (DO, UNDO, REDO, NOTE)
"""a note changes the state, and is no step of the history: what was saved to a file, say"""


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
    kind: str
    words: str
    """what was done, for people"""
    changes: tuple[Change, ...]
    joins: bool = False
    """one step with the action before: both belong to one drag"""

    @property
    def content(self) -> dict[str, Any]:
        """What its record holds."""
        return asdict(self)

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Action:
        """Return the action of a record's content. Raises ValueError, KeyError or TypeError for one that is none."""
        changes = tuple(Change(str(c["key"]), c["before"], c["after"]) for c in content["changes"])
        if content["kind"] not in KINDS:
            raise ValueError(f"no kind of action: {content['kind']}")
        return cls(
            int(content["id"]), str(content["kind"]), str(content["words"]), changes,
            bool(content.get("joins", False)),
        )  # fmt: skip

    @property
    def after(self) -> dict[str, Value]:
        """What holds after it, of the values that it changes."""
        return {change.key: change.after for change in self.changes}


def merged(actions: Sequence[Action]) -> tuple[Change, ...]:
    """Return what several actions did together: each value as it was before the first of them, and after the last."""
    found: dict[str, Change] = {}
    for change in (change for action in actions for change in action.changes):
        first = found.get(change.key, change)
        found[change.key] = Change(change.key, first.before, change.after)
    return tuple(found.values())


@dataclass
class History:
    """Actions so far, as state and as steps that undo and redo go along."""

    state: dict[str, Value] = field(default_factory=dict)
    past: list[list[Action]] = field(default_factory=list)
    """steps, the oldest first; those of a drag are one"""
    future: list[list[Action]] = field(default_factory=list)
    """steps that were undone, the latest last"""
    last_id: int = 0

    @classmethod
    def of(cls, actions: Iterable[Action]) -> History:
        """Return the history of actions in their order."""
        history = cls()
        for action in actions:
            history.take(action)
        return history

    def next(
        self, words: str, changes: Sequence[Change], kind: str = DO, joins: bool = False
    ) -> Action:
        """Return an action that may come next; `take` makes it count."""
        return Action(self.last_id + 1, kind, words, tuple(changes), joins)

    def undoing(self) -> Action | None:
        """Return the action that takes the latest step back; None at the end of the history."""
        if not self.past:
            return None
        back = [Change(c.key, c.after, c.before) for c in merged(self.past[-1])]
        return self.next(self.past[-1][-1].words, back, UNDO)

    def redoing(self) -> Action | None:
        """Return the action that makes the step undone last again; None where there is none."""
        if not self.future:
            return None
        return self.next(self.future[-1][-1].words, merged(self.future[-1]), REDO)

    def amend(self, changes: Sequence[Change]) -> Action:
        """Let the latest action have done this instead: a drag goes on. Return it as it is now."""
        latest = self.past[-1][-1]
        self.past[-1][-1] = amended = replace(latest, changes=tuple(changes))
        self._count(amended)
        return amended

    def take(self, action: Action) -> None:
        """Let an action count."""
        self.last_id = max(self.last_id, action.id)
        self._count(action)
        if action.kind == DO:
            self.future.clear()
            if action.joins and self.past:
                self.past[-1].append(action)
            else:
                self.past.append([action])
        elif action.kind == UNDO and self.past:
            self.future.append(self.past.pop())
        elif action.kind == REDO and self.future:
            self.past.append(self.future.pop())

    def _count(self, action: Action) -> None:
        for change in action.changes:
            if change.after is None:
                self.state.pop(change.key, None)
            else:
                self.state[change.key] = change.after
