"""Skin colour: an ellipse in (r, g) fitted to a box on an image, with its size as the threshold."""

from __future__ import annotations

import html
from collections.abc import Callable
from dataclasses import replace

import viser

from handtrack.capture.clouds.skin_ellipse import SkinEllipse
from handtrack_app.page.page import Page, UserEvent, number, put
from handtrack_app.page.panels.constraints import clean_interval
from handtrack_app.protocol.snapshots import CloudCard

Box = tuple[int, int, int, int]
_SIZE = (0.5, 10.0, 0.1)
_LATER = "no box marked yet"


class SkinControls:
    """Where the colour is taken from, and how far from it counts."""

    def __init__(
        self,
        page: Page,
        set_: Callable[..., None],
        mark: Callable[..., None],
    ) -> None:
        self.page, self.set, self.mark = page, set_, mark
        self.card: CloudCard | None = None
        self.folder: viser.GuiFolderHandle | None = None

    def _build(self, card: CloudCard) -> None:
        page, gui = self.page, self.page.gui
        self.folder = gui.add_folder("Skin colour", expand_by_default=False)
        with self.folder:
            self.words = gui.add_html("")
            self.on = gui.add_checkbox(
                "Skin only", False, hint="Drop points of other colours; take the colour first."
            )
            self.size = gui.add_slider(
                "Ellipse's size", *_SIZE, 2.5,
                hint="The threshold, in standard deviations of the samples' (r, g).",
            )  # fmt: skip
            self.camera = gui.add_dropdown("Box in", card.image_cameras)
            drag = gui.add_button(
                "Drag a box over the image", icon=viser.Icon.MARQUEE_2, color="gray",
                hint="Looks through the camera; drag over skin, away from its edges.",
            )  # fmt: skip
            width, height = card.sizes[card.image_cameras[0]]
            self.across = gui.add_multi_slider(
                "Box x px", 0, width, 1, initial_value=(width // 3, width // 2), min_range=2
            )
            self.down = gui.add_multi_slider(
                "Box y px", 0, height, 1, initial_value=(height // 3, height // 2), min_range=2
            )
            take = gui.add_button(
                "Take the colour in the box", icon=viser.Icon.COLOR_PICKER, color="gray"
            )
            painted = gui.add_button(
                "Take it from painted masks", icon=viser.Icon.BRUSH, color="gray",
                hint="Of all cameras and frames in which you painted what is tracked, in the tab Masks.",
            )  # fmt: skip
        page.on(painted, lambda _: self._take_painted())
        page.on(self.on, lambda event: self._switch(bool(event.value)))
        page.on(self.size, lambda event: self._resize(event.value))
        page.on(self.camera, lambda _: self._camera_chosen())
        for slider in (self.across, self.down):
            page.on(slider, lambda _: self._show_box(self.box()))
        page.on(drag, self._drag)
        page.on(take, lambda _: self._take(self.box()))
        self.drag, self.take = drag, take

    @property
    def ellipse(self) -> SkinEllipse | None:
        """The ellipse in force."""
        skin = None if self.card is None else self.card.values.get("skin")
        return skin if isinstance(skin, SkinEllipse) else None

    def box(self) -> Box | None:
        """Return the box that the sliders mark; None where they hold no numbers."""
        pairs = [clean_interval(s.value, s.min, s.max) for s in (self.across, self.down)]
        if pairs[0] is None or pairs[1] is None:
            return None
        (left, right), (top, bottom) = pairs[0], pairs[1]
        return int(left), int(top), int(right - left), int(bottom - top)

    def _camera_chosen(self) -> None:
        size = self.card.sizes.get(str(self.camera.value)) if self.card is not None else None
        if size is not None:
            self.across.max, self.down.max = size
            self._show_box(self.box())

    def _switch(self, on: bool) -> None:
        if not on:
            self.kept = self.ellipse or getattr(self, "kept", None)
            self.set(skin=None)
        elif getattr(self, "kept", None) is not None:
            self.set(skin=self.kept)
        else:
            self._take(self.box())

    def _resize(self, value: object) -> None:
        size = number(value, *_SIZE[:2])
        if size is not None and self.ellipse is not None:
            self.set(skin=replace(self.ellipse, size=round(size, 3)))

    def _show_box(self, box: Box | None) -> None:
        if box is not None:
            self.page.state.display.skin_box = (str(self.camera.value), box)
            self.page.redraw()

    def _drag(self, event: UserEvent) -> None:
        def marked(box: Box) -> None:
            self.across.value = (box[0], box[0] + box[2])
            self.down.value = (box[1], box[1] + box[3])
            self._show_box(box)
            self._take(box)

        if event.client is not None:
            self.mark(str(self.camera.value), event.client, marked)
            self.page.notify(
                "info",
                "Drag a box",
                "Press the mouse over skin in the image and drag. The model is hidden until then; key 0 looks freely again.",
                event.client,
            )

    def _take(self, box: Box | None) -> None:
        if box is not None:
            self._show_box(box)
            self._send(box)

    def _take_painted(self) -> None:
        self._send(None)

    def _send(self, box: Box | None) -> None:
        size = number(self.size.value, *_SIZE[:2]) or 2.5
        self.page.engine.sample_skin(self.page.state.frame, str(self.camera.value), box, size)

    def fit(self, card: CloudCard) -> None:
        """Show the ellipse in force; without images there is no colour."""
        self.card = card
        if not card.image_cameras:
            return
        if self.folder is None:
            self._build(card)
        skin = self.ellipse
        put(self.on, value=skin is not None)
        if skin is not None and abs(self.size.value - skin.size) > 1e-9:
            self.size.value = min(max(skin.size, _SIZE[0]), _SIZE[1])
        self.words.content = _ellipse_picture(skin)


def _ellipse_picture(skin: SkinEllipse | None) -> str:
    text = _LATER if skin is None else f"r {skin.mean[0]:.3f}, g {skin.mean[1]:.3f}"
    return (
        "<div style='padding:.2em .9em;font-size:.8em;line-height:1.4;opacity:.85'>"
        f"Colour of skin: {html.escape(text)}</div>"
    )
