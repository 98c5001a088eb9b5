"""How each page is laid out, whatever others do: folded panels, light or dark, large text. The browser remembers it."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

import viser

from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Keys, Page
from handtrack_app.protocol.palette import BRAND

_KEPT_AS, _ASKED_S = (
    "handtrack.room",
    5.0,
)  # name in the browser's storage; how long it is waited for
_NARROW_PX = 800  # a scene that is narrower beside both panels: the pose panel is folded at first
_SETTLES_S = 15.0  # a page is laid out within this
_LARGER = 1.25
_LARGE = "document.documentElement.style.setProperty('--mantine-scale', '{}', 'important')"
DARK, LIGHT, USUAL, LARGE = "dark", "light", "usual", "large"
POSE, REST = "Pose", "Views and tools"
WIDTHS = {POSE: 310, REST: 298}
"""of the panels, with usual text [px]"""
_COLOURS: tuple[str, ...] = (DARK, LIGHT)
_TEXTS: tuple[str, ...] = (USUAL, LARGE)


@dataclass(frozen=True)
class Taste:
    """What a user wants of a page."""

    folded: tuple[str, ...] = ()
    """panels"""
    colours: str = DARK
    text: str = USUAL

    @classmethod
    def read(cls, kept: str | None) -> Taste | None:
        """Return what a browser kept, None for nothing, or for what is none of ours."""
        try:
            values = json.loads(kept or "")
            folded = tuple(name for name in values["folded"] if name in (POSE, REST))
            colours = LIGHT if values["colours"] == LIGHT else DARK
            return cls(folded, colours, LARGE if values["text"] == LARGE else USUAL)
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
    panels: dict[str, viser.PanelHandle | viser.MainPanelHandle] = field(default_factory=dict)
    tastes: dict[int, Taste] = field(default_factory=dict)
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def build(self) -> None:
        """Add the widgets where the page builds now, and the keys."""
        gui, own = self.page.gui, self.page.own
        with gui.add_folder("This page", expand_by_default=False):
            self.colours = gui.add_dropdown(
                "Colours", _COLOURS, initial_value=DARK, hint="Light is for print and projectors."
            )  # fmt: skip
            self.text = gui.add_dropdown(
                "Text", _TEXTS, initial_value=USUAL, hint="Of all panels. Your browser remembers it."
            )  # fmt: skip
            fold = gui.add_button_group(
                "Fold", (POSE, REST), hint="Fold a panel, or open it again: keys T and R. The scene takes its room."
            )  # fmt: skip
        own(self.colours, lambda client, chosen: self.change(client, colours=chosen))
        own(self.text, lambda client, chosen: self.change(client, text=chosen))
        own(fold, self.fold)
        self._key("Fold or open the pose panel", "T", lambda client: self.fold(client, POSE))
        self._key("Fold or open the views and tools", "R", lambda client: self.fold(client, REST))
        self._key("Light or dark", None, self._other_colours)
        self._key("Large or usual text", None, self._other_text)

    def _key(self, words: str, key: str | None, act: Callable[[viser.ClientHandle], None]) -> None:
        from_user = self.page.from_user(lambda event: act(event.client) if event.client else None)
        self.page.everyones.add(self.keys.add(words, key, from_user))

    def welcome(self, client: viser.ClientHandle) -> None:
        """Lay a page out as its browser remembers, else by how much room it has."""
        began = time.monotonic()

        def laid_out(camera: viser.CameraHandle) -> None:
            early = time.monotonic() - began < _SETTLES_S and client.client_id not in self.tastes
            if early and camera.image_width < _NARROW_PX:
                self._apply(client, Taste(folded=(POSE,)))

        def begin(kept: str | None) -> None:
            nonlocal began
            taste = Taste.read(kept)
            if taste is not None:
                self._apply(client, taste)
                return
            began = time.monotonic()
            client.camera.on_update(laid_out)
            laid_out(client.camera)

        self.page.remembered(client, _KEPT_AS, begin)

    def fold(self, client: viser.ClientHandle, panel: str, folded: bool | None = None) -> None:
        """Fold a panel, open a folded one; or as told."""
        before = self.tastes.get(client.client_id, Taste()).folded
        folded = panel not in before if folded is None else folded
        rest = tuple(name for name in before if name != panel)
        self.change(client, folded=(*rest, panel) if folded else rest)

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
            for name, panel in self.panels.items():
                if (name in taste.folded) != (name in before.folded):
                    internals.place_panel(client, gui, panel, folded=name in taste.folded)
            if taste.colours != before.colours:
                colours(client.gui, taste.colours)
                internals.show_value(client, self.colours, taste.colours)
            if taste.text != before.text:
                internals.show_value(client, self.text, taste.text)
                factor = _LARGER if taste.text == LARGE else 1.0
                for name, panel in self.panels.items():
                    internals.place_panel(client, gui, panel, width=factor * WIDTHS[name])
                internals.run_javascript(client, _LARGE.format(factor))
