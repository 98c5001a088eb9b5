"""Masks: where they come from, tried live over all cameras, a box, and correcting them by hand."""

from __future__ import annotations

import html
from dataclasses import dataclass, field

import numpy as np
import viser

from handtrack_app.page.masks.correcting import CorrectingWidgets
from handtrack_app.page.masks.method_widgets import METHOD_WORDS, MethodWidgets
from handtrack_app.page.page import Keys, Page, UserEvent, put
from handtrack_app.page.panels.constraints import clean_interval
from handtrack_app.page.scene.stage import Stage
from handtrack_app.protocol.masks import MaskCameraCard, MaskCard, MaskPicture

ALL = "all cameras"


@dataclass
class MaskPanel:
    """Handles of the mask tab."""

    page: Page
    tab: viser.GuiTabHandle
    stage: Stage
    keys: Keys
    card: MaskCard | None = None
    built: bool = False
    methods: dict[str, MethodWidgets] = field(default_factory=dict)

    def fit(self, card: MaskCard) -> None:
        """Build the tab once, then show what is in force."""
        self.card = card
        if not self.built:
            self.built = True
            with self.tab:
                self._build(card)
        self._show_chosen()
        self.note.content = _small(card.words)
        changed = ", ".join(card.unsaved)
        self.saved.content = _small(
            f"Not in session.toml yet: masks of {changed}." if changed else ""
        )
        for button in (self.save, self.back):
            put(button, visible=bool(card.unsaved))

    def _build(self, card: MaskCard) -> None:
        page, gui = self.page, self.page.gui
        names = tuple(camera.name for camera in card.cameras)
        possible = [n for n in METHOD_WORDS if any(n in camera.possible for camera in card.cameras)]
        blank = np.full((8, 8, 3), 36, np.uint8)
        self.sheet = gui.add_image(blank, format="jpeg", jpeg_quality=80, visible=False)
        self.wrong = gui.add_html("")
        self.note = gui.add_html("")
        self.on = gui.add_checkbox(
            "Show masks", page.state.display.masks,
            hint=page.words.of("Green: {kind}. Hatched: unknown. Blue outline: corrected by you."),
        )  # fmt: skip
        self.camera = gui.add_dropdown("Camera", (ALL, *names) if len(names) > 1 else names)
        self.method = gui.add_dropdown("Masks from", tuple(METHOD_WORDS[n] for n in possible))
        self.methods = {
            name: MethodWidgets(page, name, self._set)
            for name in possible
            if name not in ("files", "none")
        }
        if "skin_adaptive" in self.methods:
            with self.methods["skin_adaptive"].folder:
                sample = gui.add_button(
                    "Drag a box over skin", icon=viser.Icon.MARQUEE_2, color="gray"
                )
            page.on(sample, lambda event: self._drag(event, "sample"))
        self._build_box(card)
        self.saved = gui.add_html("")
        self.save = gui.add_button(
            "Save to session.toml", icon=viser.Icon.DEVICE_FLOPPY, color="gray", visible=False,
            hint="Only masks and roi of the cameras change; the file before is kept in versions/.",
        )  # fmt: skip
        self.back = gui.add_button(
            "Back to what is saved", icon=viser.Icon.RESTORE, color="gray", visible=False,
            hint="Forget what was changed here since; corrections stay.",
        )  # fmt: skip
        self.correcting = CorrectingWidgets(
            page, self.stage, self.keys, self._one_camera, self._named
        )
        page.on(self.on, lambda event: self._show_masks(bool(event.value)))
        page.on(self.camera, lambda _: self._show_chosen())
        page.on(self.method, lambda event: self._choose(str(event.value)))
        page.on(self.save, lambda _: page.engine.save_masks())
        page.on(self.back, lambda _: page.engine.restore_masks())

    def _build_box(self, card: MaskCard) -> None:
        page, gui = self.page, self.page.gui
        width, height = card.cameras[0].size
        with gui.add_folder("Box", expand_by_default=False):
            self.box_words = gui.add_html("")
            drag = gui.add_button(
                "Drag a box over the image", icon=viser.Icon.MARQUEE_2, color="gray",
                hint="Outside of it nothing counts as observed.",
            )  # fmt: skip
            self.across = gui.add_multi_slider(
                "Box x px", 0, width, 1, initial_value=(0, width), min_range=2
            )
            self.down = gui.add_multi_slider(
                "Box y px", 0, height, 1, initial_value=(0, height), min_range=2
            )
            self.no_box = gui.add_button("No box", icon=viser.Icon.X, color="gray", visible=False)
        page.on(drag, lambda event: self._drag(event, "roi"))
        for slider in (self.across, self.down):
            page.on(slider, lambda _: self._set_box())
        page.on(self.no_box, lambda _: self._set("roi", None, one=True))

    # ---- which camera

    def _named(self) -> str:
        chosen = str(self.camera.value)
        return "" if chosen == ALL else chosen

    def _shown_camera(self) -> MaskCameraCard:
        """Return the camera chosen, of all the first."""
        assert self.card is not None
        named = self._named()
        return next((c for c in self.card.cameras if c.name == named), self.card.cameras[0])

    def _one_camera(self, event: UserEvent) -> str | None:
        """Return the camera that is meant where there can be one only: chosen, or looked through, or the first."""
        through = self.page.state.look(event.client.client_id).through
        return self._named() or through or self._shown_camera().name

    def _show_chosen(self) -> None:
        camera = self._shown_camera()
        put(self.method, value=METHOD_WORDS[camera.method])
        for name, widgets in self.methods.items():
            put(widgets.folder, visible=name == camera.method)
            if name == camera.method:
                widgets.fit(camera.values)
        (width, height), roi = camera.size, camera.roi
        put(self.across, max=width)
        put(self.down, max=height)
        x, y, w, h = roi or (0, 0, width, height)
        put(self.across, value=(x, x + w))
        put(self.down, value=(y, y + h))
        put(self.no_box, visible=roi is not None)
        said = "no box: the whole image counts" if roi is None else f"{w} × {h} px from {x}, {y}"
        self.box_words.content = _small(f"{camera.name}: {said}.")

    # ---- changing

    def _show_masks(self, on: bool) -> None:
        self.page.draw("masks", on)
        put(self.on, value=on)
        put(self.sheet, visible=on)
        if on:
            self.wrong.content = _small("Masks are being made …")

    def _set(self, name: str, value: object, one: bool = False) -> None:
        camera = self._shown_camera().name if one else self._named()
        self._show_masks(True)
        self.page.engine.set_masks(camera, {name: value})

    def _choose(self, words: str) -> None:
        method = next((name for name, known in METHOD_WORDS.items() if known == words), None)
        if method is not None:
            self._set("method", method)

    def _set_box(self) -> None:
        pairs = [clean_interval(s.value, s.min, s.max) for s in (self.across, self.down)]
        if pairs[0] is not None and pairs[1] is not None:
            (left, right), (top, bottom) = pairs[0], pairs[1]
            self._set("roi", (int(left), int(top), int(right - left), int(bottom - top)), one=True)

    def _drag(self, event: UserEvent, what: str) -> None:
        camera = self._one_camera(event)
        if camera is None or event.client is None:
            return

        def marked(box: tuple[int, int, int, int]) -> None:
            self._show_masks(True)
            self.page.engine.mark_mask_box(camera, what, box, self.page.state.frame)

        self.stage.mark_box(camera, event.client, marked)
        over = "skin, away from its edges" if what == "sample" else "all that is to count"
        self.page.notify(
            "info",
            f"Drag a box in {camera}",
            f"Press the mouse and drag over {over}. The model is hidden until then; key 0 looks freely again.",
            event.client,
        )

    # ---- snapshots

    def show(self, picture: MaskPicture) -> None:
        """Show the masks of a frame."""
        if not self.built:
            return
        if picture.sheet is not None and self.page.state.display.masks:
            self.sheet.image = picture.sheet
            put(self.sheet, visible=True)
        self.wrong.content = _small(picture.words)
        self.correcting.say(picture.corrected)


def _small(text: str) -> str:
    if not text:
        return ""
    return f"<div style='padding:.3em .9em;font-size:.85em;line-height:1.4;opacity:.8'>{html.escape(text)}</div>"
