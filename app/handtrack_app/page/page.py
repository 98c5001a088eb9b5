"""What every panel is handed: the server, the user's state, the way to the engine; and the page's keys."""

from __future__ import annotations

import functools
import json
import logging
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar, cast

import viser

from handtrack_app import viser_internals as internals
from handtrack_app.page.state import UserState
from handtrack_app.page.worded import Worded
from handtrack_app.protocol.calls import Engine
from handtrack_app.protocol.snapshots import Notice

if TYPE_CHECKING:
    from handtrack_app.viser_internals import GuiModalHandle, HotkeyKey, KeyModifier

log = logging.getLogger(__name__)
_OPEN_TAB = """%s.forEach((name, n) => setTimeout(() => [...document.querySelectorAll('[role="tab"]')].find(
  (one) => one.textContent.trim() === name)?.click(), 300 * n));"""
"""viser opens tabs by clicks alone; one within another is drawn after it"""
_ASKED_S = 60.0  # a browser is waited for


@dataclass(frozen=True)
class UserEvent:
    """A widget that was used, or a command that was given."""

    client: viser.ClientHandle
    target: Any
    value: Any
    """what the user chose: `target.value` may be the program's by now, written since"""


Action = Callable[[UserEvent], None]
Shows = TypeVar("Shows")


@dataclass(frozen=True)
class Page:
    """The page as its panels see it."""

    server: viser.ViserServer
    state: UserState
    engine: Engine
    """its methods can be called, and return at once; what they do comes as snapshots"""
    redraw: Callable[[], None]
    """apply changed display options to the scene"""
    go_to: Callable[[float], None]
    """show a frame"""
    said: Callable[[Any], Any]
    """the value that a page last gave to a widget"""
    own_widgets: dict[str, Callable[[int, object], None]] = field(default_factory=dict)
    """by id: what is called with a client and the value that it gave to a widget that each page has for itself"""
    everyones: set[str] = field(default_factory=set)
    """ids of commands that also a page may give that looks on"""
    words: Worded = field(default_factory=Worded)
    heard: list[Callable[[Notice], None]] = field(default_factory=list)
    """called with all that is said"""
    _shows: dict[type, list[Callable[[Any], object]]] = field(default_factory=dict)
    """by kind of snapshot, in the order in which they subscribed"""
    _dialogs: dict[int, GuiModalHandle] = field(default_factory=dict)
    """by client, those that are open"""

    def subscribe(self, kind: type[Shows], *show: Callable[[Shows], object]) -> None:
        """Have snapshots of a kind shown, from now on."""
        self._shows.setdefault(kind, []).extend(show)

    def show(self, snapshot: object) -> None:
        """Show a snapshot wherever its kind was subscribed to."""
        for show in self._shows.get(type(snapshot), ()):
            show(snapshot)

    def dialog(self, client: viser.ClientHandle, title: str) -> GuiModalHandle:
        """Open a dialog of one page, in the place of another. Whoever opens it adds a button that closes it."""
        self.close_dialog(client)
        self._dialogs[client.client_id] = opened = client.gui.add_modal(title)
        return opened

    def close_dialog(self, client: viser.ClientHandle) -> None:
        """Close a page's dialog, if there is one."""
        here = self.server.get_clients()
        opened = self._dialogs.pop(client.client_id, None)
        for gone in [one for one in self._dialogs if one not in here]:
            del self._dialogs[gone]
        if opened is not None:
            opened.close()

    def open_tab(self, client: viser.ClientHandle | None, *names: str) -> None:
        """Open a tab of one page, and a tab within it."""
        if client is not None:
            internals.run_javascript(client, _OPEN_TAB.replace("%s", json.dumps(names)))

    def has_dialog(self, client: viser.ClientHandle) -> bool:
        """Return whether a page has a dialog open."""
        return client.client_id in self._dialogs

    def play(self, on: bool) -> None:
        """Begin or end playback; what is too slow for it is drawn differently meanwhile."""
        if self.state.playing != on:
            self.state.playing = on
            self.redraw()

    def draw(self, option: str, value: object) -> None:
        """Change how something is drawn: an option of Display; None, for what no widget offers, changes nothing."""
        if value is not None:
            setattr(self.state.display, option, value)
            self.redraw()

    @property
    def gui(self) -> viser.GuiApi:
        return self.server.gui

    def edit_pose(
        self, changes: dict[str, float], words: str, tag: str = "", is_stroke: bool = False
    ) -> None:
        """Change joint parameters [m, rad] of the frame shown by name; undo takes it back. words: what is done; tag: of the
        control; is_stroke: of one drag of it, which is one step however long it takes.
        """
        edit = self.state.edit(changes)
        if edit is not None:
            at = f"{tag} {edit.frame}" if tag else ""  # a drag is of one frame
            self.engine.set_pose(edit.frame, edit.values, edit.version, at, is_stroke, words)

    def flip(self) -> None:
        """Show the frame's pose as it was before the last step that changed it, or again as it is: a look, no edit."""
        state = self.state
        state.follow = state.playing = False
        self.engine.look_before(not state.looks_before)

    def travel(self, back: bool, steps: int = 1) -> None:
        """Undo or redo the latest step, or several."""
        for _ in range(steps):
            version = self.state.begin_edit()
            if back:
                self.engine.undo(version)
            else:
                self.engine.redo(version)

    def notify(
        self, level: str, title: str, text: str, client: viser.ClientHandle | None = None
    ) -> None:
        """Show a notification for a while, on one client or on all; it can be read later, too."""
        colour = {"done": "teal", "warning": "orange", "error": "red"}.get(level, "blue")
        close = 8.0 if level in ("info", "done") else 15.0
        for hear in self.heard:
            hear(Notice(level, title, text))
        clients = [client] if client is not None else list(self.server.get_clients().values())
        for target in clients:
            target.add_notification(title, text, color=colour, auto_close_seconds=close)  # type: ignore[arg-type]

    def remembered(
        self, client: viser.ClientHandle, name: str, act: Callable[[str | None], None]
    ) -> None:
        """Call back with what a page's browser keeps under a name, None for nothing or no answer; a page that draws its first
        picture answers late, and the threads of viser are for others.
        """

        def ask() -> None:
            try:
                kept = client.local_storage.get_item(name, timeout=_ASKED_S)
            except (RuntimeError, TimeoutError):
                kept = None
            if client.client_id in self.server.get_clients():
                self._tried(client, partial(act, kept))

        threading.Thread(target=ask, name="remembered", daemon=True).start()

    def own(
        self,
        widget: viser.GuiInputHandle[str] | viser.GuiButtonGroupHandle,
        action: Callable[[viser.ClientHandle, str], None],
    ) -> None:
        """Let each page have a value of its own for a widget, also one that looks on; `action` gets it."""

        def call(client_id: int, value: object) -> None:
            client = self.server.get_clients().get(client_id)
            if client is not None:
                internals.submit(self.gui, self._tried, client, partial(action, client, str(value)))

        self.own_widgets[internals.id_of(widget)] = call

    def on(self, widget: Any, action: Action) -> None:
        """Call back when a user presses a button, or changes the value of another widget."""
        register = getattr(widget, "on_click", None) or widget.on_update
        register(self.from_user(action))

    def from_user(self, action: Action) -> Callable[[Any], None]:
        """Wrap a callback: values that the program itself wrote are ignored, mistakes are told in words."""

        @functools.wraps(action)
        def callback(event: Any) -> None:
            if event.client_id is not None:
                used = UserEvent(event.client, event.target, self.said(event.target))
                self._tried(event.client, partial(action, used))

        return callback

    def _tried(self, client: viser.ClientHandle | None, act: Callable[[], None]) -> None:
        try:
            act()
        except Exception as error:
            log.exception("callback failed")
            self.notify("error", "That did not work", f"{type(error).__name__}: {error}", client)


def put(handle: object, **values: object) -> None:
    """Set those properties of a viser handle that differ: each one set is a message to every client."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


def number(value: object, low: float, high: float) -> float | None:
    """Return a client's value as a number within [low, high]; None if it is no finite number."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        return None
    return min(max(float(value), low), high)


_MODIFIERS = {
    "cmd/ctrl": "Ctrl", "cmd/ctrl+shift": "Ctrl Shift", "shift": "Shift", "alt": "Alt", "alt+shift": "Alt Shift",
}  # fmt: skip

_KEY_WORDS = {
    "pageup": "Page ↑",
    "pagedown": "Page ↓",
    "home": "Home",
    "end": "End",
    "space": "Space",
    "escape": "Esc",
    "tab": "Tab",
    "arrowright": "→",
    "arrowleft": "←",
}


@dataclass
class Keys:
    """Registers commands with their keys; the palette (Ctrl-K) has them too."""

    gui: viser.GuiApi
    words: Worded = field(default_factory=Worded)
    known: list[tuple[str, str]] = field(default_factory=list)
    """key and what it does, in words"""
    modal: dict[int, Callable[[str], bool]] = field(default_factory=dict)
    """by client that is at something, such as painting: asked first what a letter means; whether it took it"""

    def add(
        self,
        words: str,
        key: str | None,
        action: Callable[[Any], None],
        modifier: KeyModifier | None = None,
    ) -> str:
        """Let a key do something, or the palette alone (None); `action` gets viser's event. Return the command's id."""
        hotkey = cast("HotkeyKey | None", key)
        command = self.gui.add_command(self.words.of(words), hotkey=hotkey, modifier=modifier)
        self.words.on(command, label=words)

        def act(event: viser.CommandEvent) -> None:
            first = None if modifier else self.modal.get(event.client_id or 0)
            if first is None or key is None or not first(key):
                action(event)

        command.on_trigger(act)
        if key is not None:
            shown = _KEY_WORDS.get(key, key)
            self.known.append((f"{_MODIFIERS.get(modifier or '', '')} {shown}".strip(), words))
        return internals.id_of(command)
