"""Session: what is open, and how it is drawn: display modes, cameras, looking through one."""

from __future__ import annotations

import html
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import msgspec
import viser

from handtrack_app import viser_internals as internals
from handtrack_app.page.html import bar, sheet
from handtrack_app.page.page import Client, Page, Panel, Part, Taste, UserState, put, remembered
from handtrack_app.page.panels.tracking import progress_words
from handtrack_app.page.scene.looking import ALL, Looking
from handtrack_app.page.scene.stage import Stage
from handtrack_app.palette import BRAND
from handtrack_app.protocol import PictureSnapshot, ProgressSnapshot

FREE, TOGETHER = "orbit view", "all cameras"
_MODE_WORDS = {
    "ellipsoids": "Flesh",
    "surface": "Surface",
    "skeleton": "Skeleton",
    "conic field": "Field",
    "everything": "All",
}
_STATES = {
    "idle": ("ready", "#009e73"),
    "failed": ("failed", "#d55e00"),
    "opening": ("opening", "#f0e442"),
    "preparing": ("preparing", "#f0e442"),
    "tracking": ("tracking", "#56b4e9"),
    "paused": ("paused", "#cc79a7"),
}
_SAVED = {
    "saved": "<span class='handtrack-faint'>✓ All changes saved</span>",
    "saving": "<span class='handtrack-faint'>… Saving</span>",
    "unsaved": "<b class='handtrack-warning'>⚠ The last changes are not saved yet</b>",
    "kept nowhere": "<b class='handtrack-warning'>⚠ Read-only: nothing is saved</b>",
}
_PAINT_HINT = (
    "Residual: orange is silhouette without model, blue is model without silhouette; lines lead from each detected joint "
    "to the model's. Mask: what is taken for the {kind}; purple pixels are unknown and ignored."
)
_PAINT_WORDS = {
    "nothing": "plain",
    "model's outline": "outline",
    "residual": "residual",
    "mask": "mask",
    "model's field": "field",
}


@dataclass
class SessionPanel(Panel):
    """The View tab."""

    stage: Stage
    room: Room

    def build(self) -> None:
        page, gui, display, stage = self.page, self.gui, self.state.display, self.stage
        session = page.state.session
        names = [card.name for card in session.cameras]
        self.views = {FREE: None, **dict(zip(names, names, strict=True)), TOGETHER: ALL}
        """by their words"""
        self.sheet = page.offer(gui.add_html(""), lambda: display.images)
        self.mode = page.choice(
            "Model style", _MODE_WORDS, partial(page.draw, "mode"),
            "Surface: used for point-cloud fitting; during playback the ellipsoids are shown instead.",
        )  # fmt: skip
        self.opacity = gui.add_slider("Opacity", 0.1, 1.0, 0.05, display.opacity)
        page.bind(self.opacity, partial(page.draw, "opacity"))
        with gui.add_folder("Cameras"):
            self.through = gui.add_dropdown(
                "Camera view",
                tuple(self.views),
                initial_value=FREE,
                hint=self.page.phrase(
                    "See the {kind} over a camera's image, or all cameras' images of the {kind} side by side."
                ),
            )
            add_zoom_keys(page, self.stage.looking)
            self.paint = gui.add_dropdown(
                "Overlay", tuple(_PAINT_WORDS), initial_value="model's outline",
                hint=page.phrase(_PAINT_HINT),
            )  # fmt: skip
            page.toggle("Cameras", "cameras", "Draw the cameras in the scene.")
            page.toggle(
                "Live images",
                "images",
                "Show each camera's image of this frame, in the scene and above.",
            )
        with gui.add_folder("Show"):
            page.toggle(
                "Handle", "handle", "Drag the whole model: arrows move it, arcs turn it. Without it Shift and a drag pull any "
                "joint or segment in the free view.",
            )  # fmt: skip
            if session.has_truth:
                page.toggle("Ground truth", "truth", "True joints, white.")
        self.view = gui.add_button_group("Look at", (session.kind.capitalize(), "Everything"))
        page.button(
            "Light or dark", self.room.turn_light, "sun-moon", "Of this page. Light is for print and projectors.",
            by_page=True,
        )  # fmt: skip
        leave_button(page)
        self._look_by_keys(names)
        stage.looking.chosen = self._show_chosen
        page.own(self.through, lambda client, chosen: stage.look(self.views[chosen], client))
        page.own(self.paint, self._paint)
        page.own(self.view, lambda client, what: stage.look(None, client, what == "Everything"))

    def _look_by_keys(self, cameras: list[str]) -> None:
        views = [(f"Camera view: {name}", str(i), name) for i, name in enumerate(cameras[:9], 1)]
        more = ("Orbit view", "0", None), ("See the {kind} in all cameras", "B", ALL)
        for words, key, camera in (*views, *more):
            self.page.key(words, key, partial(self.stage.look, camera), by_page=True)
        self.page.key("Next overlay: outline, residual, …", "O", self._next_paint, by_page=True)

    def show_pictures(self, made: PictureSnapshot) -> None:
        """Show what the cameras see, side by side."""
        if made.thumbnails:
            put(self.sheet, content=sheet(made.frame, made.thumbnails))

    def _show_chosen(self, client: Client) -> None:
        """Show a page what it looks through and what is painted over that, also where a key or another tab chose it."""
        choices = (
            (self.through, self.views, client.through),
            (self.paint, _PAINT_WORDS, client.paint),
        )
        for widget, words, chosen in choices:
            word = next(word for word, one in words.items() if one == chosen)
            internals.show_value(client.handle, widget, word)

    def _paint(self, client: Client, chosen: str) -> None:
        """Paint over what a page looks through, and over the small pictures of all."""
        paint, state = _PAINT_WORDS[chosen], self.state
        self.stage.looking.set_paint(client, paint)
        state.display.paint = "plain" if paint == "mask" else paint
        self.page.redraw()

    def _next_paint(self, client: Client) -> None:
        """Take the next overlay."""
        options = list(_PAINT_WORDS.values())
        self._paint(client, list(_PAINT_WORDS)[(options.index(client.paint) + 1) % len(options)])

    def leave(self, client: Client) -> None:
        """Go from a camera's view to the free one."""
        if client.through is not None:
            self.stage.look(None, client)


def leave_button(page: Page) -> viser.GuiButtonHandle:
    """Add the button that leads to the start page."""
    hint = "Closes this recording. All work is saved."
    return page.button("Other recordings …", page.leave, "folders", hint)


def head(state: UserState, is_open: bool = False, saved: str = "") -> str:
    """Return the head of the main panel: session, hand, what is going on, and whether the work is saved. is_open: there is a session."""
    progress = state.progress
    word, colour = _STATES[progress.state]
    title, facts = "Opening …", ""
    if is_open:
        session = state.session
        title = html.escape(session.name)
        number = len(session.cameras)
        cameras = f"{number} camera{'s' if number != 1 else ''}"
        frames = "live" if session.live else f"{len(state.strip.status)} frames"
        counts = f"{frames}, {cameras}, {session.fps:g} fps"
        facts = f"<div class='handtrack-counts handtrack-faint' title='{html.escape(session.model)}'>{counts}</div>"
        facts += f"<div>{_SAVED[saved]}</div>" if saved in _SAVED else ""
    elif progress.state == "failed":
        title = "No session"
    return (
        "<div class='handtrack-head' style='padding:.2em .9em 0;font-size:.9em;line-height:1.4'>"
        "<div style='display:flex;gap:.6em;justify-content:space-between;align-items:baseline'>"
        f"<span class='handtrack-title' style='overflow-wrap:anywhere;font-size:1.1em;font-weight:600'>{title}</span>"
        f"<span style='white-space:nowrap'><span style='display:inline-block;width:.65em;height:.65em;"
        f"border-radius:50%;background:{colour};margin-right:.4em'></span>{word}</span></div>{facts}"
        f"{_activity(progress)}</div>"
    )


def _activity(progress: ProgressSnapshot) -> str:
    """Return what goes on in words, with a bar: seen whatever tab is open."""
    if progress.state in ("idle", "failed"):
        return ""
    text = html.escape(progress_words(progress))
    share = progress.done / progress.total if progress.total else 0.0
    return f"<div class='handtrack-line'>{text}</div>{bar(share, '#56b4e9')}"


# ---- How each page is laid out, which its browser remembers


KEPT_AS = "handtrack.room"  # in the browser's storage
DARK, LIGHT = "dark", "light"
WIDTH = 276
"""of the panel [px]: the scene keeps 70 % of a window of 1280 x 800"""
SYSTEM = """
const key = "viser-user:handtrack.room";
if (!localStorage.getItem(key)) localStorage.setItem(key, JSON.stringify({
  folded: false, colours: matchMedia("(prefers-color-scheme: light)").matches ? "light" : "dark"}));
"""
"""a browser that remembers nothing takes the system's colours"""


def read_taste(kept: str | None) -> Taste | None:
    """Return what a browser kept, None for nothing, or for what is none of ours."""
    with suppress(msgspec.MsgspecError):
        return msgspec.json.decode(kept or "", type=Taste)
    return None


def colours(gui: viser.GuiApi, chosen: str = DARK) -> None:
    """Give a page its colours; all pages, by the server's `gui`."""
    gui.configure_theme(
        dark_mode=chosen == DARK, show_logo=False, show_share_button=False, control_width="medium",
        brand_color=BRAND,
    )  # fmt: skip


def welcome(client: viser.ClientHandle, apply: Callable[[Taste], None]) -> None:
    """Lay a page out as its browser remembers; one that remembers nothing has the system's colours."""
    internals.run_javascript(client, SYSTEM)
    remembered(client, KEPT_AS, lambda kept: (taste := read_taste(kept)) and apply(taste))


@dataclass
class Room(Part):
    """The pages' tastes."""

    def build(self) -> None:
        """Add the keys."""
        self.page.key("Hide or show the panel", "T", self.fold, by_page=True)
        self.page.key("Light or dark", "", self.turn_light, by_page=True)

    def welcome(self, client: Client) -> None:
        """Lay a page out as its browser remembers; else in the system's colours."""
        welcome(client.handle, partial(self._apply, client))

    def fold(self, client: Client) -> None:
        """Hide the panel, or show a hidden one."""
        self.change(client, folded=not client.taste.folded)

    def change(self, client: Client, **values: object) -> None:
        """Change a taste, and let the browser remember it."""
        with client.lock:  # two keys on two threads: what is remembered last has both
            taste = replace(client.taste, **values)
            self._apply(client, taste)
            client.handle.local_storage.set_item(KEPT_AS, msgspec.json.encode(taste).decode())

    def turn_light(self, client: Client) -> None:
        """Change between light and dark."""
        self.change(client, colours=LIGHT if client.taste.colours == DARK else DARK)

    def _apply(self, client: Client, taste: Taste) -> None:
        with client.lock:
            before, client.taste = client.taste, taste
            gui = self.gui
            if taste.folded != before.folded:
                internals.fold_panel(client.handle, gui, gui.main_panel, taste.folded)
            if taste.colours != before.colours:
                colours(client.handle.gui, taste.colours)


# ---- What a user does with a view through a camera: keys and buttons


_STEP = 1.4  # two of them twice as large
_HINT = "Camera view: Z and X, or the wheel, zoom in and out; drag to move the image. C shows the {kind}, V the whole image."


def add_zoom_keys(page: Page, looking: Looking) -> None:
    """Add the buttons where the page builds now, and the keys."""
    phrase = page.phrase
    acts: dict[str, Callable[[Client], None]] = {}
    for label, key, words, act in (
        (phrase("{Kind}"), "C", "View: the {kind}, and back into the camera", looking.to_hand),
        ("In", "Z", "View: nearer", partial(looking.zoom_by, factor=_STEP)),
        ("Out", "X", "View: wider", partial(looking.zoom_by, factor=1 / _STEP)),
        ("All", "V", "View: the whole image", partial(looking.zoom_by, factor=0.0)),
    ):
        page.key(words, key, act, by_page=True)
        acts[label] = act
    buttons = page.gui.add_button_group("Zoom", tuple(acts), hint=phrase(_HINT))
    page.own(buttons, lambda client, what: acts[what](client))
