"""The control in the scene that moves and turns the whole hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from handtrack.arrays import D6, Floats
from handtrack.geometry.rotation import (
    matrix_from_quaternion,
    quaternion_wxyz,
    rotation_matrix,
    rotation_vector,
)
from handtrack_app.page.pins.whole_hand import ROOT

RootEdit = Callable[[dict[str, float], str, str, bool], None]
"""root parameters by name, what is done in words, the drag that it belongs to, and that it is one"""
_STILL_M, _STILL_RAD = 1e-5, np.deg2rad(0.01)
"""a control that is clicked comes back with its pose rounded; a pixel of a drag is a tenth of a millimetre and more"""


@dataclass
class RootHandle:
    """A transform control at the wrist."""

    control: viser.TransformControlsHandle
    on_edit: RootEdit
    dragging: bool = False
    _drags: int = 0
    _shown: Floats[D6] | None = None
    """where a drag takes hold of it"""
    _words: str = ""
    """what the drag did so far"""

    def show_at(self, root: Floats[D6]) -> None:
        """Move the control to the root parameters [m, rad], unless the user holds it."""
        if not self.dragging:
            self._shown = root.copy()
            self.control.position = root[:3]
            self.control.wxyz = quaternion_wxyz(rotation_matrix(root[3:6]))

    def dragged(self, phase: str) -> None:
        """Follow a drag. A click moves nothing, and is no edit."""
        if not self.dragging:
            self._drags, self._words = self._drags + 1, ""
        self.dragging, start = phase != "end", self._shown
        root = root_parameters(self.control.position, self.control.wxyz)
        if root is None or start is None:
            return
        moved = np.linalg.norm(root[:3] - start[:3]) > _STILL_M
        turn = rotation_matrix(root[3:6]) @ rotation_matrix(start[3:6]).T
        turned = np.linalg.norm(rotation_vector(turn)) > _STILL_RAD
        if moved or turned:
            self._words = "Turn" if turned else "Move"
        if self._words:
            edit: dict[str, float] = dict(zip(ROOT, root.tolist(), strict=True))
            self.on_edit(edit, self._words, f"handle {self._drags}", True)


def add_root_handle(
    server: viser.ViserServer, name: str, on_edit: RootEdit, larger: float = 1.0
) -> RootHandle:
    """Add the control; `on_edit` receives what a drag of it does. larger: than a hand's."""
    control = server.scene.add_transform_controls(
        name,
        scale=0.09 * larger,
        line_width=2.5,
        disable_sliders=True,
        depth_test=False,
        opacity=0.9,
        visible=False,
    )
    handle = RootHandle(control, on_edit)

    # in order, on viser's loop: a little arithmetic, and sent on
    @control.on_update
    async def _(event: viser.TransformControlsEvent) -> None:
        handle.dragged(event.phase)

    return handle


def root_parameters(position: object, wxyz: object) -> Floats[D6] | None:
    """Return the root parameters of a pose that came from a client; None if it is no pose."""
    try:
        place = np.asarray(position, dtype=float).reshape(3)
        turn = np.asarray(wxyz, dtype=float).reshape(4)
    except (TypeError, ValueError):
        return None
    length = float(np.linalg.norm(turn))
    if not (
        np.isfinite(place).all()
        and np.isfinite(length)
        and length > 1e-6
        and np.abs(place).max() < 100
    ):
        return None
    return np.concatenate([place, rotation_vector(matrix_from_quaternion(turn / length))])
