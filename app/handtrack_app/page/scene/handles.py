"""The control in the scene that moves and turns the whole hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import viser

from handtrack.arrays import D6, Floats
from handtrack.geometry.rotation import (
    matrix_from_quaternion,
    quaternion_wxyz,
    rotation_matrix,
    rotation_vector,
)
from handtrack_app.page.page import Client, Part
from handtrack_app.page.pins.grips import ROOT

RootEdit = Callable[[dict[str, float], str, str, bool], None]
"""root parameters by name, what is done in words, the drag that it belongs to, and that it is one"""
_FAR_M = 100.0
"""nobody's hand is further from the world's origin: such a drag is no edit"""
_STILL_M, _STILL_RAD = 1e-5, np.deg2rad(0.01)
"""a control that is clicked comes back with its pose rounded; a pixel of a drag is a tenth of a millimetre and more"""


class RootHandle:
    """A transform control at the wrist."""

    def __init__(self, server: viser.ViserServer, on_edit: RootEdit, larger: float) -> None:
        """Add the control; `on_edit` receives what a drag of it does. larger: than a hand's."""
        self._on_edit = on_edit
        self._dragging, self._drags = False, 0
        self._shown: Floats[D6] | None = None
        """where a drag takes hold of it"""
        self._words = ""
        """what the drag did so far"""
        self.control = server.scene.add_transform_controls(
            "/root", scale=0.09 * larger, line_width=2.5, disable_sliders=True, depth_test=False, opacity=0.9, visible=False
        )  # fmt: skip

        # in order, on viser's loop: a little arithmetic, and sent on
        @self.control.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            self._dragged(event.phase)

    def show_at(self, root: Floats[D6]) -> None:
        """Move the control to the root parameters [m, rad], unless the user holds it."""
        if not self._dragging:
            self._shown = root.copy()
            self.control.position = root[:3]
            self.control.wxyz = quaternion_wxyz(rotation_matrix(root[3:6]))

    def _dragged(self, phase: str) -> None:
        """Follow a drag. A click moves nothing, and is no edit."""
        if not self._dragging:
            self._drags, self._words = self._drags + 1, ""
        self._dragging, start = phase != "end", self._shown
        turn = rotation_vector(matrix_from_quaternion(self.control.wxyz))
        root = np.concatenate([self.control.position, turn])
        if start is None or np.abs(root[:3]).max() > _FAR_M:
            return
        moved = np.linalg.norm(root[:3] - start[:3]) > _STILL_M
        turn = rotation_matrix(root[3:6]) @ rotation_matrix(start[3:6]).T
        turned = np.linalg.norm(rotation_vector(turn)) > _STILL_RAD
        if moved or turned:
            self._words = "Turn" if turned else "Move"
        if self._words:
            edit: dict[str, float] = dict(zip(ROOT, root.tolist(), strict=True))
            self._on_edit(edit, self._words, f"handle {self._drags}", True)


@dataclass
class GrabKeys(Part):
    """G lets the handle move, R turn; X, Y and Z, along or about that axis of it alone. The same again, or Escape, ends it.

    It is dragged with the button held: viser reports no pointer that only moves.
    """

    control: viser.TransformControlsHandle
    """of the root"""
    _kind: str = ""
    _axis: str = ""
    _was_shown: bool = True

    def build(self) -> None:
        for key, words in (
            ("G", "Grab: move the {kind}; then X, Y or Z"),
            ("R", "Turn the {kind}; then X, Y or Z"),
        ):
            self.page.key(words, key, partial(self._begin, key), by_page=True)

    def _begin(self, kind: str, client: Client) -> None:
        self._kind, self._axis = kind, ""
        self._was_shown = self.state.display.handle
        client.modal = partial(self._heard, client)
        self.page.draw("handle", True)
        self._show()

    def _heard(self, client: Client, key: str) -> bool:
        if key in ("X", "Y", "Z"):
            self._axis = "" if key == self._axis else key
        elif key in ("G", "R") and key != self._kind:
            self._kind, self._axis = key, ""
        elif key in (self._kind, "escape"):
            self._kind = self._axis = ""
            client.modal = None
            self.page.draw("handle", self._was_shown)
        else:
            return False
        self._show()
        return True

    def _show(self) -> None:
        control, moves = self.control, self._kind == "G"
        control.disable_axes, control.disable_rotations = self._kind == "R", moves
        # viser draws an arc where the two axes are active that it lies between
        x, y, z = (not self._axis or (axis == self._axis) == moves for axis in "XYZ")
        control.active_axes = x, y, z
