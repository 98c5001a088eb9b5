"""Masks: where they come from, tried live over all cameras, a box, and correcting them by hand."""

from __future__ import annotations

import html
import math
from dataclasses import dataclass, field
from functools import partial

from handtrack.setting import Setting
from handtrack_app import viser_internals as internals
from handtrack_app.page.html import escaped, sheet, text
from handtrack_app.page.page import Client, Panel, Part, put
from handtrack_app.page.panels.settings import TOLD, SavedSettings, SettingWidget
from handtrack_app.page.scene.stage import Stage
from handtrack_app.page.scene.viewpoint import Pixel
from handtrack_app.protocol import (
    FILES,
    NO_MASKS,
    Box,
    MaskCameraCard,
    PictureSnapshot,
    SessionSnapshot,
)

ALL = "all cameras"


@dataclass
class MaskPanel(Panel):
    """Handles of the mask tab."""

    stage: Stage
    settings: dict[str, dict[str, SettingWidget]] = field(default_factory=dict)
    """by method and name"""

    def build(self) -> None:
        page, gui, cameras = self.page, self.gui, self.state.session.masks
        names = tuple(camera.name for camera in cameras)
        possible = [n for n in METHOD_WORDS if any(n in camera.possible for camera in cameras)]
        self.sheet = page.offer(gui.add_html(""), lambda: self.state.display.masks)
        self.wrong = gui.add_html("")
        self.note = gui.add_html("")
        self.on = page.check(
            "Show masks", page.state.display.masks, self._show_masks,
            page.phrase("Green: {kind}. Hatched: unknown. Blue outline: corrected by you."),
        )  # fmt: skip
        choices = (ALL, *names) if len(names) > 1 else names
        self.camera = page.choice("Camera", choices, lambda _: self._show_chosen())
        methods = {METHOD_WORDS[n]: n for n in possible}
        self.method = page.choice("Masks from", methods, lambda name: self._set("method", name))
        for method in possible:
            if not (known := settings_of(method)):
                continue
            folder = gui.add_folder(METHOD_WORDS[method])
            with page.offer(folder, lambda method=method: self._shown_camera().method == method):
                self.settings[method] = {
                    name: SettingWidget(page, one, partial(self._set, name))
                    for name, one in known.items()
                }
                if method == "skin_adaptive":
                    act = partial(self._drag, "sample")
                    page.button("Drag a box over skin", act, "marquee-2", by_page=True)
        with gui.add_folder("Box", expand_by_default=False):
            self.box_words = gui.add_html("")
            page.button(
                "Drag a box over the image", partial(self._drag, "roi"), "marquee-2",
                "Pixels outside it are not observed.", by_page=True,
            )  # fmt: skip
            page.button(
                "No box", lambda: self._set("roi", None, one=True), "x", when=lambda: self._shown_camera().roi is not None
            )  # fmt: skip
        self.saved = SavedSettings(
            page, "masks", "the cameras' masks and roi", "Discards unsaved changes; corrections stay.", "masks of {}"
        )  # fmt: skip
        self.correcting = CorrectingWidgets(page, self)
        seen = any({*camera.possible} - {FILES, NO_MASKS} for camera in cameras)
        page.offer(self.correcting.folder, lambda: seen)

    def fit(self, session: SessionSnapshot) -> None:
        """Show what is in force."""
        self._show_chosen()
        self.note.content = escaped(session.mask_words)

    # ---- which camera

    def named(self) -> str:
        """Return the camera that is chosen in the tab, empty for all."""
        chosen = str(self.camera.value)
        return "" if chosen == ALL else chosen

    def _shown_camera(self) -> MaskCameraCard:
        """Return the camera chosen, of all the first."""
        named, cameras = self.named(), self.state.session.masks
        return next((c for c in cameras if c.name == named), cameras[0])

    def one_camera(self, client: Client) -> str:
        """Return the camera that is meant where there can be one only: chosen, or looked through, or the first."""
        return self.named() or client.through or self._shown_camera().name

    def _show_chosen(self) -> None:
        camera = self._shown_camera()
        put(self.method, value=METHOD_WORDS[camera.method])
        for name, one in self.settings.get(camera.method, {}).items():
            if name in camera.values:
                one.show(camera.values[name])
        said = "no box: the whole image is used"
        if camera.roi is not None:
            said = "{2} × {3} px from {0}, {1}".format(*camera.roi)
        self.box_words.content = escaped(f"{camera.name}: {said}.")

    # ---- changing

    def _show_masks(self, on: bool) -> None:
        self.page.draw("masks", on)
        put(self.on, value=on)
        if on:
            self.wrong.content = escaped("Masks are being made …")

    def _set(self, name: str, value: object, one: bool = False) -> None:
        camera = self._shown_camera().name if one else self.named()
        self._show_masks(True)
        self.engine.set_masks(camera, {name: value})

    def _drag(self, what: str, client: Client) -> None:
        camera = self.one_camera(client)

        def marked(box: Box) -> None:
            self._show_masks(True)
            self.engine.mark_mask_box(camera, what, box, self.state.frame)

        over = "skin, away from its edges" if what == "sample" else "everything to observe"
        self.stage.mark_box(camera, client, over, marked)

    # ---- snapshots

    def show(self, made: PictureSnapshot) -> None:
        """Show the masks of a frame, where some were made."""
        if made.masks and self.state.display.masks:
            put(self.sheet, content=sheet(made.frame, made.masks))
        if made.corrected or made.problems:
            self.wrong.content = escaped(" ".join(made.problems))
            self.correcting.show_corrections(made.corrected)


# ---- The mask methods and their settings


METHOD_WORDS: dict[str, str] = TOLD["mask_words"]
_KINDS: dict[str, type] = {"int": int, "float": float, "bool": bool}


def settings_of(method: str) -> dict[str, Setting]:
    """Return the settings that the page offers of a method, by name; none of what has none."""
    known = TOLD["masks"].get(method, {})
    told = {name: own or TOLD["shared"][name] for name, own in known.items()}
    return {name: Setting(**one | {"kind": _KINDS[one["kind"]]}) for name, one in told.items()}


# ---- Correcting a frame's mask: a brush on the camera's image, and what was painted carried to the frames beside


_BRUSHES = {
    "{kind}": "hand",
    "not {kind}": "not hand",
    "unknown": "unknown",
    "as it is": "as it is",
}
"""words → what is sent"""
_TASK = (
    "Drag with the left button over the image, or click. X swaps the brush, [ and ] change its radius. The wheel and the right "
    "button still move the view; key 0 ends."
)
_RADIUS = (1, 80, 1)  # [px]
_FACTOR = 1.2  # by which a key changes the radius
_MOST = 20  # frames to carry to, each way


@dataclass
class CorrectingWidgets(Part):
    """A folder of the tab."""

    panel: MaskPanel
    """it knows which camera is meant"""
    _painter: Client | None = None
    _stroke: int = 0
    _last: Pixel | None = None

    def build(self) -> None:
        page, gui = self.page, self.gui
        self.brushes = {page.phrase(words): brush for words, brush in _BRUSHES.items()}
        self.folder = gui.add_folder("Correct this frame")
        with self.folder:
            self.words = gui.add_html("")
            self.brush = gui.add_dropdown(
                "Brush", tuple(self.brushes),
                hint="Key X swaps with the previous brush. As it is: removes the correction.",
            )  # fmt: skip
            self.radius = gui.add_slider("Radius px", *_RADIUS, 10, hint="Keys [ and ].")
            self.paint = page.button(
                "Paint over the mask", self._begin, "brush",
                "Opens the camera view without the model. Drag or click to paint with the brush above. Undo removes a stroke.",
                when=lambda: self._painter is None, by_page=True,
            )  # fmt: skip
            self.done = page.button(
                "Done painting", self._end, "check", color=None, when=lambda: self._painter is not None, by_page=True
            )  # fmt: skip
            page.button("Drop this frame's correction", self._drop, "eraser", by_page=True)
            self.before = gui.add_slider("Before", 0, _MOST, 1, 3)
            self.behind = gui.add_slider("After", 0, _MOST, 1, 3)
            page.button(
                "Carry to these frames", self._carry, "arrows-horizontal",
                "Propagates the correction along the image's motion; uncertain pixels become unknown. Frames that you painted stay.",
            )  # fmt: skip
        self.radius.on_update(lambda _: self._show_brush())  # whoever changed it
        for words, key, factor in (("smaller", "[", 1 / _FACTOR), ("larger", "]", _FACTOR)):
            page.key(f"Brush for masks: {words}", key, partial(self._resize, factor))
        self._other = tuple(self.brushes)[1]
        """what X swaps with"""
        page.watch(self._see_painter)

    def show_corrections(self, corrected: dict[str, str]) -> None:
        """Say which cameras are corrected in the frame shown."""
        said = {name: words for name, words in corrected.items() if words}
        lines = "<br>".join(f"{html.escape(n)}: {html.escape(w)}" for n, w in said.items())
        put(self.words, content=text(lines))

    def _begin(self, client: Client) -> None:
        camera = self.panel.one_camera(client)
        self.panel.stage.paint_on(camera, client, _TASK, self._pointed)

    def _end(self, client: Client) -> None:
        """End the painting, whoever asks for that."""
        painter = self._painter if self._painter in self.page.clients else client
        self.panel.stage.look(painter.through, painter)

    def _see_painter(self) -> None:
        """Take who paints, if that has changed."""
        painter = next((one for one in self.page.clients if one.pointed), None)
        before, self._painter = self._painter, painter
        if painter is before:
            return
        if before is not None:
            before.modal = None
            _send_brush(before, 0.0)
        if painter is not None:
            painter.modal = self._swapped
            self._show_brush()

    def _show_brush(self) -> None:
        """Draw the brush as a circle about the pointer, in its size over the image."""
        client = self._painter
        card = None if client is None else self.panel.stage.looking.card(client)
        if client is not None and card is not None:
            _send_brush(client, self.radius.value / float(card.matrix[1, 1]))

    def _swapped(self, key: str) -> bool:
        if key == "X":
            self._other, self.brush.value = str(self.brush.value), self._other
        return key == "X"

    def _resize(self, factor: float) -> None:
        wanted = self.radius.value * factor
        wanted = math.ceil(wanted) if factor > 1 else math.floor(wanted)
        self.radius.value = min(max(wanted, _RADIUS[0]), _RADIUS[1])

    def _pointed(self, camera: str, at: Pixel, phase: str) -> None:
        if phase in ("start", "click"):
            self._stroke, self._last = self._stroke + 1, None
        points = (at,) if self._last is None else (self._last, at)
        self._last = None if phase in ("end", "click") else at
        frame, brush = self.state.frame, self.brushes[self.brush.value]
        radius = float(self.radius.value)
        self.engine.paint_mask(frame, camera, brush, points, radius, str(self._stroke))

    def _drop(self, client: Client) -> None:
        self.engine.drop_correction(self.state.frame, self.panel.one_camera(client))

    def _carry(self) -> None:
        frame, before, behind = self.state.frame, self.before.value, self.behind.value
        self.engine.carry_masks(frame, self.panel.named(), before, behind)


def _send_brush(client: Client, tangent: float) -> None:
    """Show a page the brush. tangent: of the angle from its middle to its edge, seen from the camera; 0: none."""
    internals.run_javascript(client.handle, f"document.body.dataset.brush = {tangent:.6f}")
