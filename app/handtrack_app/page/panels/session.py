"""Session: what is open, and how it is drawn: display modes, cameras, looking through one."""

from __future__ import annotations

import base64
import html
from collections.abc import Callable
from dataclasses import dataclass, field

import cv2
import numpy as np
import viser

from handtrack.arrays import D3, Bytes, H, W
from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Keys, Page, number, put
from handtrack_app.page.panels.tracking import progress_words
from handtrack_app.page.scene.camera_names import CameraNames
from handtrack_app.page.views.room import Room
from handtrack_app.page.views.wall import ALL
from handtrack_app.page.views.zoom_keys import ZoomKeys
from handtrack_app.protocol.snapshots import PictureSnapshot, ProgressSnapshot, SessionSnapshot

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
    "saved": "<span style='opacity:.7'>✓ All changes saved</span>",
    "saving": "<span style='opacity:.7'>… Saving</span>",
    "unsaved": "<b class='handtrack-warning'>⚠ The last changes are not saved yet</b>",
    "kept nowhere": "<b class='handtrack-warning'>⚠ To look at: nothing is saved</b>",
}
_OVERLAPS = (
    "<div style='padding:.1em .9em .2em;font-size:.8em' title='of {kind} and mask: their common area by that of both'>"
    "<span style='opacity:.65'>overlap</span> {}</div>"
)
_PAINT_HINT = (
    "Residual: orange is silhouette without model, blue is model without silhouette; lines lead from where a joint was seen to where "
    "the model has it. Mask: what counts as {kind}; of what is purple nobody knows, and it counts for nothing."
)
_PAINT_WORDS = {
    "nothing": "plain",
    "model's outline": "outline",
    "residual": "residual",
    "mask": "mask",
    "model's field": "field",
}


@dataclass
class SessionPanel:
    """The head of the main panel and its View tab."""

    page: Page
    tab: viser.GuiTabHandle
    look: Callable[..., None]
    """look(camera, client, everything=False): through a camera, or freely (None) at the hand or at everything"""
    paint_over: Callable[[int, str], None]
    """what is painted over the camera's image that a client sees"""
    keys: Keys
    zoom: ZoomKeys
    room: Room
    others: viser.GuiButtonHandle = field(init=False)
    """leads to the start page"""
    built: bool = False
    cameras: tuple[str, ...] = ()
    toggles: dict[str, viser.GuiCheckboxHandle] = field(default_factory=dict)

    def __post_init__(self) -> None:
        with self.tab:
            self.others = self.page.gui.add_button(
                "Other recordings …", icon=viser.Icon.FOLDERS, color="gray", order=1e6,
                hint="Leaves this one; all that was done is kept.",
            )  # fmt: skip
            self.room.build()  # a page that comes while the session opens has its taste at once

    def fit(self, session: SessionSnapshot) -> None:
        """Build the tab once for a session's cameras."""
        if self.built:
            return
        self.built = True
        page, gui, display = self.page, self.page.gui, self.page.state.display
        cameras = self.cameras = tuple(card.name for card in session.cameras)
        with self.tab:
            blank = np.full((8, 8, 3), 36, np.uint8)
            self.sheet = gui.add_image(blank, format="jpeg", jpeg_quality=80)
            self.played = gui.add_html("", visible=False)
            self.overlaps = gui.add_html("", visible=False)
            self.mode = gui.add_dropdown(
                "Model style", tuple(_MODE_WORDS), initial_value=_word_of(_MODE_WORDS, display.mode),
                hint="Surface: used for point-cloud fitting; during playback the ellipsoids are shown instead.",
            )  # fmt: skip
            self.opacity = gui.add_slider("Opacity", 0.1, 1.0, 0.05, display.opacity)
            with gui.add_folder("Cameras"):
                self.through = gui.add_dropdown(
                    "Camera view",
                    (FREE, *cameras, TOGETHER),
                    initial_value=FREE,
                    hint=self.page.words.of(
                        "See the {kind} over a camera's image, or all cameras' images of the {kind} side by side."
                    ),
                )
                self.zoom.build()
                self.paint = gui.add_dropdown(
                    "Overlay", tuple(_PAINT_WORDS), initial_value=_word_of(_PAINT_WORDS, display.paint),
                    hint=page.words.of(_PAINT_HINT),
                )  # fmt: skip
                self._toggle("Cameras", "cameras", "Draw the cameras in the scene.")
                self._toggle(
                    "Live images",
                    "images",
                    "Show each camera's image of this frame, in the scene and above.",
                )
            with gui.add_folder("Show"):
                self._toggle(
                    "Handle", "handle", "Drag the whole model: arrows move it, arcs turn it. Without it Shift and a drag pull any "
                    "joint or segment in the free view.",
                )  # fmt: skip
                if session.has_truth:
                    self._toggle("Ground truth", "truth", "True joints, white.")
            self.view = gui.add_button_group("Look at", (session.kind.capitalize(), "Everything"))
            self._look_by_keys(cameras)
        page.on(self.mode, lambda e: page.draw("mode", _MODE_WORDS.get(e.value)))
        page.on(self.opacity, lambda e: page.draw("opacity", number(e.value, 0.1, 1.0)))
        page.own(self.through, self._look)
        page.own(self.paint, self._paint)
        page.own(
            self.view, lambda client, what: self._show_look(None, client, what == "Everything")
        )

    def _look_by_keys(self, cameras: tuple[str, ...]) -> None:
        look = self.page.from_user
        for i, name in enumerate(cameras[:9], start=1):
            act = look(lambda event, name=name: self._show_look(name, event.client))
            self.page.everyones.add(self.keys.add(f"Look through {name}", str(i), act))
        act = look(lambda event: self._next_paint(event.client))
        self.page.everyones.add(self.keys.add("Next overlay: outline, residual, …", "O", act))
        act = look(lambda event: self._show_look(None, event.client))
        self.page.everyones.add(self.keys.add("Orbit view", "0", act))
        act = look(lambda event: self._show_look(ALL, event.client))
        self.page.everyones.add(self.keys.add("See the {kind} in all cameras", "B", act))
        self.zoom.walls.chosen = self._show_look

    def show_pictures(self, pictures: PictureSnapshot) -> None:
        """Show what the cameras see, side by side."""
        if not self.built:
            return
        wanted, playing = self.page.state.display.images, self.page.state.playing
        if wanted and pictures.sheet is not None:
            if playing:
                self.played.content = _at_once(pictures.sheet)
            else:
                self.sheet.image = pictures.sheet
        put(self.sheet, visible=wanted and not playing)
        put(self.played, visible=wanted and playing)

    def show_names(self, names: CameraNames) -> None:
        """Show below the cameras' pictures how far the hand shown overlaps each mask, where that is known."""
        if not self.built:
            return
        told = [names.of(camera) for camera in self.cameras]
        words = " · ".join(html.escape(one) for one in told)
        known = told != list(self.cameras)
        known |= self.page.state.playing and self.overlaps.visible  # the line keeps its place
        known &= self.page.state.display.images
        put(self.overlaps, visible=known)
        if known:
            put(self.overlaps, content=self.page.words.of(_OVERLAPS).replace("{}", words))

    def _toggle(self, label: str, name: str, hint: str) -> None:
        page = self.page
        box = page.gui.add_checkbox(label, getattr(page.state.display, name), hint=hint)
        page.on(box, lambda event: page.draw(name, bool(event.value)))
        self.toggles[name] = box

    def _look(self, client: viser.ClientHandle, chosen: str) -> None:
        self.look({FREE: None, TOGETHER: ALL}.get(chosen, chosen), client)

    def _show_look(
        self, camera: str | None, client: viser.ClientHandle | None, everything: bool = False
    ) -> None:
        if client is not None:
            word = {None: FREE, ALL: TOGETHER}.get(camera, str(camera))
            internals.show_value(client, self.through, word)
            self.look(camera, client, everything)

    def _paint(self, client: viser.ClientHandle, chosen: str) -> None:
        """Paint over what a page looks through; the one that edits also sees it on the small pictures of all."""
        paint, state = _PAINT_WORDS[chosen], self.page.state
        self.paint_over(client.client_id, paint)
        if state.editor == client.client_id:
            state.display.paint = "plain" if paint == "mask" else paint
        self.page.redraw()

    def _next_paint(self, client: viser.ClientHandle | None) -> None:
        """Take the next overlay."""
        if client is not None:
            now = self.page.state.look(client.client_id).paint
            found = list(_PAINT_WORDS.values())
            chosen = list(_PAINT_WORDS)[(found.index(now) + 1) % len(found)]
            internals.show_value(client, self.paint, chosen)
            self._paint(client, chosen)

    def leave(self, client: viser.ClientHandle) -> None:
        """Go from a camera's view to the free one."""
        if self.page.state.look(client.client_id).through is not None:
            self._show_look(None, client)

    def show_display(self) -> None:
        """Show the display options in force."""
        display = self.page.state.display
        if self.built:
            put(self.mode, value=_word_of(_MODE_WORDS, display.mode))


def _at_once(picture: Bytes[H, W, D3]) -> str:
    """Return a picture that the browser shows together with the words that come with it; viser's own widget loads it first."""
    _, packed = cv2.imencode(".jpg", picture[..., ::-1], (cv2.IMWRITE_JPEG_QUALITY, 80))
    data = base64.b64encode(packed.tobytes()).decode()
    return (
        "<div style='padding:0 var(--mantine-spacing-xs) .5em'><img decoding='sync' style='max-width:100%;display:block' "
        f"src='data:image/jpeg;base64,{data}'></div>"
    )


def _word_of(words: dict[str, str], value: str) -> str:
    return next(word for word, own in words.items() if own == value)


def head(session: SessionSnapshot | None, progress: ProgressSnapshot, saved: str = "") -> str:
    """Return the head of the main panel: session, hand, what is going on, and whether the work is saved."""
    word, colour = _STATES.get(progress.state, ("Busy", "#56b4e9"))
    title, facts = "Opening …", ""
    if session is not None:
        title = html.escape(session.name)
        number = len(session.cameras)
        cameras = f"{number} camera{'s' if number != 1 else ''}"
        frames = "live" if session.live else f"{session.stop - session.start} frames"
        counts = f"{frames}, {cameras}, {session.fps:g} frames/s"
        facts = f"<div style='opacity:.85' title='{html.escape(session.model)}'>{counts}</div>"
        facts += f"<div>{_SAVED[saved]}</div>" if saved in _SAVED else ""
    elif progress.state == "failed":
        title = "No session"
    return (
        "<div style='padding:.2em .9em 0;font-size:.85em;line-height:1.4'>"
        "<div style='display:flex;justify-content:space-between;align-items:baseline'>"
        f"<span class='handtrack-title' style='font-size:1.1em;font-weight:600'>{title}</span>"
        f"<span style='white-space:nowrap'><span style='display:inline-block;width:.65em;height:.65em;"
        f"border-radius:50%;background:{colour};margin-right:.4em'></span>{word}</span></div>{facts}"
        f"{_activity(progress)}</div>"
    )


def _activity(progress: ProgressSnapshot) -> str:
    """Return what goes on in words, with a bar: seen whatever tab is open."""
    if progress.state in ("idle", "failed"):
        return ""
    text = html.escape(progress_words(progress))
    share = 100.0 * progress.done / progress.total if progress.total else 0.0
    return (
        f"<div style='margin-top:.35em'>{text}</div>"
        "<div style='height:4px;border-radius:2px;background:rgba(128,128,128,.3);margin-top:.3em'>"
        f"<div style='height:4px;border-radius:2px;background:#56b4e9;width:{share:.1f}%'></div></div>"
    )
