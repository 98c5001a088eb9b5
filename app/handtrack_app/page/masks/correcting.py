"""Correcting a frame's mask: a brush on the camera's image, and what was painted carried to the frames beside."""

from __future__ import annotations

import html
import math
from collections.abc import Callable
from itertools import count

import viser

from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Keys, Page, UserEvent, number, put
from handtrack_app.page.scene.looking import Pixel
from handtrack_app.page.scene.stage import Stage

_BRUSHES = {
    "{kind}": "hand",
    "not {kind}": "not hand",
    "unknown": "unknown",
    "as it is": "as it is",
}
"""words → what is sent"""
_RADIUS = (1, 80, 1)  # [px]
_FACTOR = 1.2  # by which a key changes the radius
_MOST = 20  # frames to carry to, each way


class CorrectingWidgets:
    """A folder of the tab."""

    def __init__(
        self,
        page: Page,
        stage: Stage,
        keys: Keys,
        camera: Callable[[UserEvent], str | None],
        named: Callable[[], str],
    ) -> None:
        """camera: the one that a user means; named: the one chosen in the tab, empty for all."""
        self.page, self.stage, self.camera, self.named = page, stage, camera, named
        self._modal = keys.modal
        self._painter: viser.ClientHandle | None = None
        self._strokes = count(1)
        self._stroke, self._last = 0, None
        self.brushes = {page.words.of(words): brush for words, brush in _BRUSHES.items()}
        gui = page.gui
        with gui.add_folder("Correct this frame"):
            self.words = gui.add_html("")
            self.brush = gui.add_dropdown(
                "Brush",
                tuple(self.brushes),
                hint="Key X, while you paint, swaps with the one before. As it is: takes the correction away again.",
            )
            self.radius = gui.add_slider("Radius px", *_RADIUS, 10, hint="Keys [ and ].")
            self.paint = gui.add_button(
                "Paint over the mask", icon=viser.Icon.BRUSH, color="gray",
                hint="Looks through the camera, without the model; drag or click over its image. Undo takes a stroke back.",
            )  # fmt: skip
            self.done = gui.add_button("Done painting", icon=viser.Icon.CHECK, visible=False)
            self.drop = gui.add_button(
                "Drop this frame's correction", icon=viser.Icon.ERASER, color="gray"
            )
            self.before = gui.add_slider("Before", 0, _MOST, 1, 3)
            self.behind = gui.add_slider("After", 0, _MOST, 1, 3)
            self.carry = gui.add_button(
                "Carry to these frames", icon=viser.Icon.ARROWS_HORIZONTAL, color="gray",
                hint="What was painted follows the image's motion; where that is not sure it becomes unknown. Frames that were "
                "painted themselves stay.",
            )  # fmt: skip
        page.on(self.paint, self._begin)
        page.on(self.done, self._end)
        page.on(self.drop, self._drop)
        page.on(self.carry, self._carry)
        self.radius.on_update(lambda _: self._show_brush())  # whoever changed it
        for words, key, factor in (("smaller", "[", 1 / _FACTOR), ("larger", "]", _FACTOR)):
            act = page.from_user(lambda _, factor=factor: self._resize(factor))
            keys.add(f"Brush for masks: {words}", key, act)
        self._other = tuple(self.brushes)[1]
        """what X swaps with"""
        stage.stopped_painting = lambda: self._show_painting(None)

    def say(self, corrected: dict[str, str]) -> None:
        """Say which cameras are corrected in the frame shown."""
        lines = "<br>".join(f"{html.escape(n)}: {html.escape(w)}" for n, w in corrected.items())
        put(
            self.words,
            content=f"<div style='padding:.2em .9em;font-size:.8em;line-height:1.4;opacity:.8'>{lines}</div>"
            if lines
            else "",
        )

    def _begin(self, event: UserEvent) -> None:
        camera = self.camera(event)
        if camera is None or event.client is None:
            return
        self.stage.paint_on(camera, event.client, self._pointed)
        self._show_painting(event.client)
        self.page.notify(
            "info",
            f"Painting over {camera}",
            "Drag with the left button over the image, or click. X swaps the brush, [ and ] change its radius. The wheel and the "
            "right button still move the view; key 0 ends.",
            event.client,
        )

    def _end(self, event: UserEvent) -> None:
        if event.client is not None:
            self.stage.look(self.page.state.look(event.client.client_id).through, event.client)

    def _show_painting(self, painter: viser.ClientHandle | None) -> None:
        """Take who paints; nobody does any more, for None."""
        before, self._painter = self._painter, painter
        put(self.paint, visible=painter is None)
        put(self.done, visible=painter is not None)
        if before is not None:
            self._modal.pop(before.client_id, None)
            _send_brush(before, 0.0)
        if painter is not None:
            self._modal[painter.client_id] = self._swapped
            self._show_brush()

    def _show_brush(self) -> None:
        """Draw the brush as a circle about the pointer, in its size over the image."""
        client, radius = self._painter, number(self.radius.value, *_RADIUS[:2])
        card = None if client is None else self.stage.looking.card(client.client_id)
        if client is not None and card is not None and radius is not None:
            _send_brush(client, radius / float(card.matrix[1, 1]))

    def _swapped(self, key: str) -> bool:
        if key == "X":
            self._other, self.brush.value = str(self.brush.value), self._other
        return key == "X"

    def _resize(self, factor: float) -> None:
        wanted = self.radius.value * factor
        wanted = math.ceil(wanted) if factor > 1 else math.floor(wanted)
        self.radius.value = min(max(wanted, _RADIUS[0]), _RADIUS[1])

    def _pointed(self, camera: str, at: Pixel, phase: str) -> None:
        radius = number(self.radius.value, *_RADIUS[:2])
        if radius is None:
            return
        if phase in ("start", "click"):
            self._stroke, self._last = next(self._strokes), None
        points = (at,) if self._last is None else (self._last, at)
        self._last = None if phase in ("end", "click") else at
        frame, brush = self.page.state.frame, self.brushes.get(str(self.brush.value))
        if brush is None:
            return
        self.page.engine.paint_mask(frame, camera, brush, points, radius, str(self._stroke))

    def _drop(self, event: UserEvent) -> None:
        camera = self.camera(event)
        if camera is not None:
            self.page.engine.drop_correction(self.page.state.frame, camera)

    def _carry(self, _: UserEvent) -> None:
        before, behind = (number(s.value, 0, _MOST) or 0 for s in (self.before, self.behind))
        frame = self.page.state.frame
        self.page.engine.carry_masks(frame, self.named(), round(before), round(behind))


def _send_brush(client: viser.ClientHandle, tangent: float) -> None:
    """Show a page the brush. tangent: of the angle from its middle to its edge, seen from the camera; 0: none."""
    internals.run_javascript(client, f"document.body.dataset.brush = {tangent:.6f}")
