"""How each page is laid out, whatever others do: folded panels, light or dark, large text. The browser remembers it."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

import viser

from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Keys, Page
from handtrack_app.protocol.palette import BRAND

_KEPT_AS = "handtrack.room"  # in the browser's storage
_LARGER = 1.25
_LARGE = "document.documentElement.style.setProperty('--mantine-scale', '{}', 'important')"
DARK, LIGHT, USUAL, LARGE = "dark", "light", "usual", "large"
WIDTH = 276
"""of the panel, with usual text [px]: the scene keeps 70 % of a window of 1280 x 800"""
_SYSTEM = """
const key = "viser-user:handtrack.room";
if (!localStorage.getItem(key)) localStorage.setItem(key, JSON.stringify({
  folded: false, text: "usual", colours: matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"}));
"""
"""a browser that remembers nothing takes the system's colours"""
_COLOURS: tuple[str, ...] = (DARK, LIGHT)
_TEXTS: tuple[str, ...] = (USUAL, LARGE)


@dataclass(frozen=True)
class Taste:
    """What a user wants of a page."""

    folded: bool = False
    """the panel is hidden"""
    colours: str = DARK
    text: str = USUAL

    @classmethod
    def read(cls, kept: str | None) -> Taste | None:
        """Return what a browser kept, None for nothing, or for what is none of ours."""
        try:
            values = json.loads(kept or "")
            colours = LIGHT if values["colours"] == LIGHT else DARK
            return cls(
                values["folded"] is True, colours, LARGE if values["text"] == LARGE else USUAL
            )
        except (ValueError, KeyError, TypeError):
            return None


def colours(gui: viser.GuiApi, chosen: str = DARK) -> None:
    """Give a page its colours; all pages, by the server's `gui`."""
    gui.configure_theme(
        dark_mode=chosen == DARK, show_logo=False, show_share_button=False, control_width="medium",
        brand_color=BRAND,
    )  # fmt: skip


@dataclass
class Room:
    """The pages' tastes."""

    page: Page
    keys: Keys
    tastes: dict[int, Taste] = field(default_factory=dict)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def build(self) -> None:
        """Add the widgets where the page builds now, and the keys."""
        gui, own = self.page.gui, self.page.own
        with gui.add_folder("This page", expand_by_default=False, order=1e5):
            self.colours = gui.add_dropdown(
                "Colours", _COLOURS, initial_value=DARK, hint="Light is for print and projectors."
            )  # fmt: skip
            self.text = gui.add_dropdown(
                "Text", _TEXTS, initial_value=USUAL, hint="Of all panels. Your browser remembers it."
            )  # fmt: skip
        own(self.colours, lambda client, chosen: self.change(client, colours=chosen))
        own(self.text, lambda client, chosen: self.change(client, text=chosen))
        self._key("Hide or show the panel", "T", self.fold)
        self._key("Light or dark", None, self._other_colours)
        self._key("Large or usual text", None, self._other_text)

    def _key(self, words: str, key: str | None, act: Callable[[viser.ClientHandle], None]) -> None:
        from_user = self.page.from_user(lambda event: act(event.client))
        self.page.everyones.add(self.keys.add(words, key, from_user))

    def welcome(self, client: viser.ClientHandle) -> None:
        """Lay a page out as its browser remembers; else in the system's colours."""
        internals.run_javascript(client, _SYSTEM)

        def begin(kept: str | None) -> None:
            taste = Taste.read(kept)
            if taste is not None:
                self._apply(client, taste)

        self.page.remembered(client, _KEPT_AS, begin)

    def fold(self, client: viser.ClientHandle, folded: bool | None = None) -> None:
        """Hide the panel, or show a hidden one."""
        before = self.tastes.get(client.client_id, Taste()).folded
        self.change(client, folded=not before if folded is None else folded)

    def change(self, client: viser.ClientHandle, **values: object) -> None:
        """Change a taste, and let the browser remember it."""
        taste = replace(self.tastes.get(client.client_id, Taste()), **values)
        self._apply(client, taste)
        client.local_storage.set_item(_KEPT_AS, json.dumps(asdict(taste)))

    def _other_colours(self, client: viser.ClientHandle) -> None:
        now = self.tastes.get(client.client_id, Taste()).colours
        self.change(client, colours=LIGHT if now == DARK else DARK)

    def _other_text(self, client: viser.ClientHandle) -> None:
        now = self.tastes.get(client.client_id, Taste()).text
        self.change(client, text=LARGE if now == USUAL else USUAL)

    def _apply(self, client: viser.ClientHandle, taste: Taste) -> None:
        with self._lock:
            here = self.page.server.get_clients()
            self.tastes = {one: kept for one, kept in self.tastes.items() if one in here}
            before = self.tastes.get(client.client_id, Taste())
            self.tastes[client.client_id] = taste
            gui = self.page.gui
            if taste.folded != before.folded:
                internals.place_panel(client, gui, gui.main_panel, folded=taste.folded)
            if taste.colours != before.colours:
                colours(client.gui, taste.colours)
                internals.show_value(client, self.colours, taste.colours)
            if taste.text != before.text:
                internals.show_value(client, self.text, taste.text)
                factor = _LARGER if taste.text == LARGE else 1.0
                internals.place_panel(client, gui, gui.main_panel, width=factor * WIDTH)
                internals.run_javascript(client, _LARGE.format(factor))
