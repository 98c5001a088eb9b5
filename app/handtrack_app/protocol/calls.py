"""Calls of the page to the engine: methods that the engine marks as a `Command` are all that the page can call.

A call is the method's name and its arguments, picklable. What is shown comes back as snapshots.
"""

from __future__ import annotations

import inspect
import threading
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

Method = TypeVar("Method", bound=Callable[..., Any])


@dataclass(frozen=True)
class Command:
    """Marks a method that the page may call: how its calls are treated before it runs."""

    latest: tuple[str, ...] | None = None
    """of waiting calls that are equal in these arguments (of a mapping: in its keys) the newest replaces the older ones; None: each is
    served"""
    edits: bool = False
    """it changes what is kept of the session: it is on disk, repeated, or named as lost"""
    job: bool = False
    """it takes long; once sent it is not repeated unasked"""
    view: bool = False
    """a subscription of the page: the latest is repeated to an engine that begins again"""
    is_ordered: bool = False
    """later edits depend on it: it is repeated in its turn"""
    tunes: bool = False
    """it changes what is tracked by: never while a job runs, and what holds then is shown"""
    files: bool = False
    """it writes files of the session, which a live one does not have"""
    signature: inspect.Signature = inspect.Signature()
    at_once: Callable[..., None] | None = None
    """acts on the jobs as the call comes, before its turn: called with the JobControl and the call's arguments"""

    def __call__(self, method: Method) -> Method:
        whole = inspect.signature(method)
        signature = whole.replace(parameters=[*whole.parameters.values()][1:])
        method.command = replace(self, signature=signature)  # type: ignore[attr-defined]
        return method


Commands = Mapping[str, Command]


def commands_of(*classes: type) -> dict[str, Command]:
    """Return all marked methods' commands by name."""
    return {
        name: command
        for cls in classes
        for name in dir(cls)
        if (command := getattr(getattr(cls, name), "command", None)) is not None
    }


def portable(commands: Commands) -> dict[str, Command]:
    """Return commands without what only the engine needs, to be sent to the page."""
    return {name: replace(one, at_once=None) for name, one in commands.items()}


@dataclass(frozen=True)
class Call:
    """A method of the engine with its arguments by name."""

    name: str
    arguments: Mapping[str, Any]
    command: Command = field(compare=False, repr=False)
    number: int = 0
    """counts a page's calls from 1; the engine reports up to which all is on disk (`WorkSnapshot.written`)"""

    @classmethod
    def of(
        cls, commands: Commands, name: str, given: tuple[Any, ...], named: Mapping[str, Any]
    ) -> Call:
        """Return a call. Raises TypeError for a name or argument that the engine does not have."""
        if name not in commands:
            raise TypeError(f"the engine has no command {name}.")
        return cls(name, commands[name].signature.bind(*given, **named).arguments, commands[name])

    @property
    def key(self) -> Hashable | None:
        """What it has in common with the waiting calls that it replaces; None: it replaces none."""
        if self.command.latest is None:
            return None
        values = (self.arguments.get(name) for name in self.command.latest)
        return self.name, *(tuple(v) if isinstance(v, Mapping) else v for v in values)

    @property
    def is_kept(self) -> bool:
        """Whether the page keeps it until the engine has done it."""
        return self.command.edits or self.command.job or self.command.is_ordered

    @property
    def is_step(self) -> bool:
        """Whether it depends on all calls before it, or those after it on it: none is moved past it."""
        return self.key is None and self.is_kept

    @property
    def words(self) -> str:
        """What it is about, to be named when it is lost."""
        given, spans = self.arguments, self.arguments.get("spans", ())
        if "stop" in given:
            spans = [(given["start"], given["stop"] - 1)]
        elif given.get("frame") is not None:
            spans = [(given["frame"], given["frame"])]
        about = [str(given[one]) for one in ("name", "camera", "number") if given.get(one)]
        words = " ".join([self.name.replace("_", " "), *about])
        return f"{words}, {_frames(spans)}" if spans else words


def _frames(spans: Iterable[tuple[int, int]]) -> str:
    """Return spans of frames, each first to last, in words."""
    named = [str(first) if first == last else f"{first} to {last}" for first, last in spans]
    one = len(named) == 1 and named[0].isdigit()
    return f"frame{'' if one else 's'} {', '.join(named)}"


class Caller:
    """Makes a call of each method that is called on it; the page has it as the engine (`Engine`)."""

    def __init__(self, send: Callable[[str, tuple[Any, ...], Mapping[str, Any]], None]) -> None:
        self._send = send

    def __getattr__(self, name: str) -> Callable[..., None]:
        if name.startswith("_"):
            raise AttributeError(name)
        return lambda *given, **named: self._send(name, given, named)


# ---- a queue that keeps only the newest of each kind where only the newest counts

Item = TypeVar("Item")


class Mailbox(Generic[Item]):
    """Thread-safe queue. Items with an equal `kind` (not None) replace one another: the latest wins."""

    def __init__(
        self,
        kind: Callable[[Item], Hashable | None],
        is_step: Callable[[Item], bool] = lambda _: False,
    ) -> None:
        """is_step: whether an item stays between what came before and after it: nothing from before it is replaced."""
        self._kind, self._is_step = kind, is_step
        self._items: deque[Item] = deque()
        self._ready = threading.Condition()
        self._closed = False

    def close(self) -> None:
        """Let nobody wait for an item any more; those that are there can still be taken."""
        with self._ready:
            self._closed = True
            self._ready.notify_all()

    def put(self, item: Item) -> None:
        """Add an item at the end, dropping a waiting one that it replaces."""
        kind = self._kind(item)
        with self._ready:
            if kind is not None:
                for place in range(len(self._items) - 1, -1, -1):
                    old = self._items[place]
                    if self._kind(old) == kind:
                        del self._items[place]
                        break
                    if self._is_step(old):
                        break
            self._items.append(item)
            self._ready.notify()

    def take(self, timeout: float | None = None) -> Item | None:
        """Return the oldest item, or None when `timeout` [s] has passed, or the box is empty and closed."""
        with self._ready:
            self._ready.wait_for(lambda: self._items or self._closed, timeout)
            return self._items.popleft() if self._items else None

    def __len__(self) -> int:
        return len(self._items)


if TYPE_CHECKING:  # the page's process has no use for what the engine imports
    from handtrack_app.engine.job_control import JobControl
    from handtrack_app.engine.mask_service import MaskService
    from handtrack_app.engine.open_session import OpenSession
    from handtrack_app.engine.pictures.camera_pictures import Painter
    from handtrack_app.engine.pictures.cloud_service import CloudService
    from handtrack_app.engine.posing_service import PosingService
    from handtrack_app.engine.review_service import ReviewService
    from handtrack_app.engine.tuning_service import TuningService

    class Engine(  # type: ignore[misc]
        OpenSession,
        JobControl,
        PosingService,
        TuningService,
        ReviewService,
        Painter,
        CloudService,
        MaskService,
    ): ...
else:
    Engine = object
