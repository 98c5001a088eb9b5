"""What every panel is handed: the server, the user's state, the way to the engine, the page's keys."""

from __future__ import annotations

import json
import logging
import math
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypeVar, cast

import viser

from handtrack_app import viser_internals as internals
from handtrack_app.protocol import (
    Engine,
    Notice,
    ProgressSnapshot,
    SessionSnapshot,
    TimelineSnapshot,
)

if TYPE_CHECKING:
    from handtrack_app.page.scene.grips import Drag
    from handtrack_app.page.scene.looking import CameraView, Pointed, Screen
    from handtrack_app.viser_internals import GuiModalHandle, HotkeyKey, KeyModifier

GUIDE, INFO, DONE = "guide", "info", "done"
"""levels: of what is said before there is a pose, where nothing was to be done, and of what was done"""


@dataclass
class Display:
    """What is drawn."""

    mode: str = "Flesh"
    """`Flesh`, `Surface`, `Skeleton`, `Field` or `All`"""
    cameras: bool = True
    images: bool = True
    truth: bool = True
    handle: bool = True
    opacity: float = 1.0
    paint: str = "outline"
    """over the cameras' small pictures: `plain`, `outline`, `residual` or `field`"""
    ghosts: bool = True
    """poses that the frame may have, besides the one shown"""
    cloud: bool = True
    cloud_colour: str = "residual"
    """`residual` (distance to the model), `own` or `plain`"""
    cloud_size_mm: float = 1.6
    cloud_picture: str = "images"
    """`images`, `stereo` or `none`"""
    cloud_wide: bool = False
    stereo_pair: tuple[str, str] | None = None
    hidden: bool = False
    """nothing is drawn of the model, for a look at the bare image"""
    masks: bool = False
    """over all cameras' small pictures"""

    @property
    def ellipsoids(self) -> bool:
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
class Taste:
    """What a user wants of a page."""

    folded: bool
    """the panel is hidden"""
    colours: Literal["dark", "light"]


@dataclass(eq=False)
class Client:
    """A page in one browser: what it alone sees and does, whatever others do. It ends when it leaves."""

    handle: viser.ClientHandle
    taste: Taste = Taste(False, "dark")
    through: str | None = None
    """a camera; None: it looks freely"""
    paint: str = "outline"
    """over the camera's image: `plain`, `outline`, `residual` or `mask`"""
    view: CameraView | None = None
    """how it looks through the camera"""
    view_line: viser.GuiHtmlHandle | None = None
    """about that view"""
    screen: Screen | None = None
    """stays, hidden, while it looks freely"""
    close_ups: tuple[viser.PanelHandle, viser.GuiHtmlHandle] | None = None
    """of all cameras"""
    grip: viser.BatchedMeshHandle | None = None
    """follows the hand, where it can be taken hold of"""
    drag: Drag | None = None
    """under way"""
    box: Callable[[viser.SceneRectSelectEvent], None] | None = None
    """waits for a box over the picture, which stays where it is meanwhile"""
    pointed: Pointed | None = None
    """told where the picture is touched, while it is painted over"""
    modal: Callable[[str], bool] | None = None
    """while it is at something, such as painting: asked first what a letter means; whether it took it"""
    dialog: GuiModalHandle | None = None
    """that is open"""
    tour: tuple[viser.GuiFolderHandle, int, object] | None = None
    """the step that it is at, and what differs once that is done"""
    lock: threading.RLock = field(default_factory=threading.RLock)
    """of all this, which viser's threads, its loop and the view thread change"""


@dataclass
class UserState:
    """The page's side of the truth. Callbacks run on many threads: hold `lock` for more than one field."""

    kind: str = "hand"
    """of model: `hand` or `body`"""
    session: SessionSnapshot = field(init=False)
    """as it is now; none before scene and panels are built"""
    strip: TimelineSnapshot = field(init=False)
    """likewise, of the whole recording"""
    progress: ProgressSnapshot = ProgressSnapshot("opening", "Opening …")
    frame: int = 0
    awaited: int | None = None
    """the frame that the user went to, until it shows: a pose of another that comes meanwhile leads nobody back"""
    values: tuple[float, ...] = ()
    """(S,) joint parameters as the user last set or saw them [m, rad]"""
    values_at: int | None = None
    """the frame that they are of"""
    version: int = 0
    shows_before: bool = False
    """the pose shown is as it was before the last step; `values` are as it is"""
    playing: bool = False
    tracking: bool = False
    """a job runs: what is only shown gives way"""
    speed: float = 1.0
    follow: bool = True
    """the view follows the tracker"""
    display: Display = field(default_factory=Display)
    lock: threading.RLock = field(default_factory=threading.RLock)

    def is_idle(self) -> bool:
        """Return whether nothing runs."""
        return self.progress.state == "idle"

    def is_free(self) -> bool:
        """Return whether no job runs."""
        return not self.progress.is_busy

    def is_paused(self) -> bool:
        """Return whether a job waits to be resumed."""
        return self.progress.state == "paused"

    @property
    def names(self) -> tuple[str, ...]:
        """Of the model's joint parameters."""
        return self.session.parameter_names

    @property
    def passes(self) -> bool:
        """Whether tracked frames pass by, twenty a second: what is not on the screen waits."""
        return self.tracking and self.follow

    def edit(self, changes: dict[str, float]) -> tuple[int, tuple[float, ...], int] | None:
        """Change joint parameters by name [m, rad]; return the pose as the user just set it, its frame, values and version; None if
        nothing is valid or new.
        """
        with self.lock:
            valid = {
                n: float(v) for n, v in changes.items() if n in self.names and math.isfinite(v)
            }
            if not self.values or not valid:
                return None
            values = tuple(valid.get(n, v) for n, v in zip(self.names, self.values, strict=True))
            if values == self.values:
                return None
            self.values = values
            if (
                self.values_at is not None
            ):  # while it was played, the next frame was asked for already
                self.frame = self.values_at
            return self.frame, values, self.begin_edit()

    def begin_edit(self) -> int:
        """Return the version of an edit that begins: poses shown before it no longer move the page's widgets."""
        with self.lock:
            self.version += 1
            self.follow = self.playing = False  # no frame comes over who edits
            self.awaited = None
            return self.version

    def is_late(self, frame: int) -> bool:
        """Return whether a pose of a frame comes after the user has gone to another."""
        waits = self.awaited is not None and not (self.follow or self.playing)
        return waits and frame != self.awaited

    def clamp_frame(self, frame: float) -> int:
        """Return a frame of the session for any number; a page's are finite, as access control lets nothing else pass."""
        return int(min(max(round(frame), self.strip.start), self.strip.stop - 1))


# ---- What every panel is handed


_PARTS = {"hand": ("finger", "palm"), "body": ("limb", "trunk")}
"""by kind of model: what it has several of, and what they hang on"""
log = logging.getLogger(__name__)
_OPEN_TAB = """%s.forEach((name, n) => setTimeout(() => {
  const tab = [...document.querySelectorAll('[role="tab"]')].find((one) => one.textContent.trim() === name);
  const sends = (Kind, kind) => tab?.dispatchEvent(new Kind(kind, {bubbles: true, button: 0, isPrimary: true, pointerId: 1}));
  sends(PointerEvent, "pointerdown"); sends(MouseEvent, "mousedown"); sends(PointerEvent, "pointerup"); sends(MouseEvent, "mouseup");
  tab?.click();
}, 300 * n));"""
"""viser opens tabs by the pointer alone; one within another is drawn after it"""
_ASKED_S = 60.0  # a browser is waited for
_KEY_WORDS = {"cmd/ctrl": "Ctrl", "escape": "Esc", "arrowright": "→", "arrowleft": "←"}


Action = Callable[[Client, Any], object]
"""gets the page on which a widget was used or a command given, and what was chosen: the widget's own value may be the program's by
now, written since
"""
When = Callable[[], bool] | None
Shows = TypeVar("Shows")
Widget = TypeVar("Widget", bound=Any)


def remembered(client: viser.ClientHandle, name: str, act: Callable[[str | None], object]) -> None:
    """Call back with what a page's browser keeps under a name, None for nothing or no answer.

    On a thread of its own: a page that draws its first picture answers late, and the threads of viser are for others.
    """

    def ask() -> None:
        try:
            kept = client.local_storage.get_item(name, timeout=_ASKED_S)
        except TimeoutError:
            kept = None
        except RuntimeError:
            return  # it has left
        act(kept)

    threading.Thread(target=ask, name="remembered", daemon=True).start()


@dataclass
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
    leave: Callable[[], None]
    """somebody wants another recording"""
    said: Callable[[Any], Any]
    """the value that a page last gave to a widget"""
    own_widgets: dict[str, Callable[[int, object], None]] = field(default_factory=dict)
    """by id: what is called with a client and the value that it gave to a widget that each page has for itself"""
    keys: list[tuple[str, str]] = field(default_factory=list)
    """key and what it does, in words"""
    _shows: dict[type, list[Callable[[Any], object]]] = field(default_factory=dict)
    """by kind of snapshot, in the order in which they subscribed"""
    early: dict[type, object] = field(default_factory=dict)
    """the newest snapshots of kinds that nobody subscribed to yet"""
    _watches: list[Callable[[], object]] = field(default_factory=list)
    """called after each snapshot and each use of a widget"""
    _clients: dict[int, Client] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def by_number(self) -> dict[int, Client]:
        """The pages in browsers that are there now."""
        with self._lock:
            here, known = self.server.get_clients(), self._clients
            self._clients = {n: known.get(n) or Client(one) for n, one in here.items()}
            return self._clients

    @property
    def clients(self) -> list[Client]:
        """The same, in the order in which they came."""
        return list(self.by_number.values())

    def client(self, handle: viser.ClientHandle) -> Client:
        """Return one of them; of one that has left, what nobody sees."""
        return self.by_number.get(handle.client_id) or Client(handle)

    def greet(self, act: Callable[[Client], None]) -> None:
        """Call back with each page that comes."""
        self.server.on_client_connect(lambda handle: act(self.client(handle)))

    def phrase(self, text: str) -> str:
        """Return a text in which {kind} and {Kind} stand for what is tracked, hand or body, and {part} for one of its parts, {middle} for
        what they hang on.
        """
        kind = self.state.kind
        part, middle = _PARTS[kind]
        said = text.replace("{kind}", kind).replace("{Kind}", kind.capitalize())
        return said.replace("{part}", part).replace("{middle}", middle)

    def subscribe(self, kind: type[Shows], *show: Callable[[Shows], object]) -> None:
        """Have snapshots of a kind shown, from now on."""
        self._shows.setdefault(kind, []).extend(show)

    def show(self, snapshot: object) -> None:
        """Show a snapshot wherever its kind was subscribed to."""
        shows = self._shows.get(type(snapshot), ())
        if not shows:
            self.early[type(snapshot)] = snapshot
        for show in shows:
            show(snapshot)
        self.refresh()

    def watch(self, show: Callable[[], object]) -> None:
        """Call back whenever what the page shows may have changed, often: it is to be quick."""
        self._watches.append(show)

    def reflect(self, handle: Widget, **looks: Callable[[], object]) -> Widget:
        """Let properties of a viser handle be what functions return, from the next snapshot or use of a widget on."""
        self.watch(lambda: put(handle, **{name: look() for name, look in looks.items()}))
        return handle

    def refresh(self) -> None:
        """Have everybody look who watches."""
        for watch in list(self._watches):
            watch()

    def show_early(self) -> None:
        """Show what came before its panels were built."""
        early = list(self.early.values())
        self.early.clear()
        for snapshot in early:
            self.show(snapshot)

    @contextmanager
    def dialog(self, client: Client, title: str) -> Iterator[None]:
        """Open a dialog of one page, in the place of another, to be filled; it ends with a button that closes it."""
        self.close_dialog(client)
        client.dialog = client.handle.gui.add_modal(title)
        with client.dialog:
            yield
            close = client.handle.gui.add_button("Close", color="gray")
        self.on(close, lambda who, _: self.close_dialog(who))

    def close_dialog(self, client: Client) -> bool:
        """Close a page's dialog; return whether there was one."""
        opened, client.dialog = client.dialog, None
        if opened is not None:
            opened.close()
        return opened is not None

    def open_tab(self, client: Client, names: Sequence[str]) -> None:
        """Open a tab of one page, and a tab within it."""
        internals.run_javascript(client.handle, _OPEN_TAB.replace("%s", json.dumps(names)))

    def play(self, on: bool) -> None:
        """Begin or end playback; what is too slow for it is drawn differently meanwhile."""
        if self.state.playing != on:
            self.state.playing = on
            self.redraw()

    def draw(self, option: str, value: object) -> None:
        """Change how something is drawn: an option of Display."""
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
            at = f"{tag} {edit[0]}" if tag else ""  # a drag is of one frame
            self.engine.set_pose(*edit, at, is_stroke, words)

    def flip(self) -> None:
        """Show the frame's pose as it was before the last step that changed it, or again as it is: a look, no edit."""
        state = self.state
        state.follow = state.playing = False
        self.engine.look_before(not state.shows_before)

    def travel(self, back: bool, steps: int = 1) -> None:
        """Undo or redo the latest step, or several."""
        for _ in range(steps):
            version = self.state.begin_edit()
            if back:
                self.engine.undo(version)
            else:
                self.engine.redo(version)

    def notify(self, level: str, title: str, text: str, client: Client | None = None) -> None:
        """Tell something; of what is done, one client or all show a notification."""
        number = None if client is None else client.handle.client_id
        self.show(Notice(level, title, text, client_id=number))

    def own(
        self,
        widget: viser.GuiInputHandle[str] | viser.GuiButtonGroupHandle,
        action: Callable[[Client, str], None],
    ) -> None:
        """Let each page have a value of its own for a widget; `action` gets it."""

        def call(client_id: int, value: object) -> None:
            if (client := self.by_number.get(client_id)) is not None:
                internals.submit(self.gui, self._tried, client, partial(action, client, str(value)))

        self.own_widgets[internals.id_of(widget)] = call

    def key(self, words: str, keys: str, act: Callable[..., object], by_page: bool = False) -> None:
        """Let a key, such as `shift+Z`, call `act`; the palette (Ctrl-K) has it too, or alone (""). by_page: `act` gets the page whose
        key it was.
        """
        modifier, _, key = keys.rpartition("+")
        hotkey, held = cast("HotkeyKey | None", key or None), cast("KeyModifier", modifier)
        command = self.gui.add_command(self.phrase(words), hotkey=hotkey, modifier=held or None)

        def use(client: Client, _: object) -> None:
            first = None if modifier or not key else client.modal
            if first is None or not first(key):
                act(*[client] * by_page)

        command.on_trigger(self.from_user(use))
        if key:
            named = [_KEY_WORDS.get(one, one.capitalize()) for one in keys.split("+")]
            self.keys.append((" ".join(named), words))

    def button(
        self, label: str, act: Callable[..., object], icon: str = "", hint: str = "",
        color: Literal["gray", "red"] | None = "gray", when: When = None, by_page: bool = False,
    ) -> viser.GuiButtonHandle:  # fmt: skip
        """Add a button that calls `act`. icon: of viser, by its name there. by_page: `act` gets the page that pressed it."""
        named = cast("viser.IconName", icon) if icon else None
        made = self.gui.add_button(label, icon=named, hint=hint or None, color=color)
        self.on(made, lambda client, _: act(*[client] * by_page))
        return self.offer(made, when)

    def offer(self, widget: Widget, when: When) -> Widget:
        """Let a widget be seen when it can be used; None: always."""
        if when is not None:
            widget.visible = False
            self.reflect(widget, visible=when)
        return widget

    def buttons(
        self, label: str, names: Sequence[str], act: Callable[[str], object], hint: str = "",
        when: When = None,
    ) -> viser.GuiButtonGroupHandle:  # fmt: skip
        """Add a row of buttons that call `act` with their names."""
        made = self.gui.add_button_group(label, tuple(names), hint=hint or None)
        return self.offer(self.bind(made, act), when)

    def check(
        self, label: str, on: bool, act: Callable[[bool], object], hint: str = "",
        when: When = None,
    ) -> viser.GuiCheckboxHandle:  # fmt: skip
        """Add a check box."""
        made = self.gui.add_checkbox(label, on, hint=hint or None)
        return self.offer(self.bind(made, act), when)

    def toggle(self, label: str, option: str, hint: str = "") -> viser.GuiCheckboxHandle:
        """Add a check box of an option of Display."""
        now = getattr(self.state.display, option)
        return self.check(label, now, partial(self.draw, option), hint)

    def choice(
        self, label: str, words: Iterable[str] | Mapping[str, object], act: Callable[[Any], object], hint: str = "",
        now: str | None = None,
    ) -> viser.GuiDropdownHandle[str]:  # fmt: skip
        """Add a choice of words that calls `act` with the word, or with what it stands for. now: the word at first, else the first."""
        options = tuple(words)
        widget: viser.GuiDropdownHandle[str] = self.gui.add_dropdown(
            label, options, initial_value=now or options[0], hint=hint or None
        )
        if isinstance(words, Mapping):
            return self.bind(widget, lambda word: act(words[word]))
        return self.bind(widget, act)

    def bind(self, widget: Widget, act: Callable[..., object]) -> Widget:
        """Have a user's use of a widget call `act` with what was chosen: of its kind and within its limits, as access control lets nothing else
        pass; a pair in order.
        """

        def use(_: Client, value: Any) -> None:
            options = getattr(widget, "options", None)
            if options is None or value in options:  # they may be others by now
                act(tuple(sorted(value)) if isinstance(value, list | tuple) else value)

        self.on(widget, use)
        return widget

    def on(self, widget: Any, action: Action) -> None:
        """Call back when a user presses a button, or changes the value of another widget."""
        register = getattr(widget, "on_click", None) or widget.on_update
        register(self.from_user(action))

    def from_user(self, action: Action) -> Callable[[Any], None]:
        """Wrap a callback: values that the program itself wrote are ignored, mistakes are told in words."""

        def callback(event: Any) -> None:
            if event.client_id is not None:
                client, value = self.client(event.client), self.said(event.target)
                self._tried(client, partial(action, client, value))

        return callback

    def _tried(self, client: Client, act: Callable[[], object]) -> None:
        try:
            act()
            self.refresh()
        except Exception as error:
            log.exception("callback failed")
            self.notify("error", "That did not work", f"{type(error).__name__}: {error}", client)


def put(handle: object, **values: object) -> None:
    """Set those properties of a viser handle that differ: each one set is a message to every client."""
    for name, value in values.items():
        if getattr(handle, name) != value:
            setattr(handle, name, value)


# ---- What the page consists of


@dataclass
class Part:
    """A part of the page, built where that builds now."""

    page: Page

    def __post_init__(self) -> None:
        page = self.page
        self.gui, self.state, self.engine = page.gui, page.state, page.engine
        self.build()

    def build(self) -> None:
        """Add its widgets and keys."""
        raise NotImplementedError


@dataclass
class Panel(Part):
    """A tab, or a part of one."""

    tab: viser.GuiTabHandle

    def __post_init__(self) -> None:
        with self.tab:
            super().__post_init__()
