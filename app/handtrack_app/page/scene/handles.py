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

RootEdit = Callable[[dict[str, float]], None]


@dataclass
class RootHandle:
    """A transform control at the wrist."""

    control: viser.TransformControlsHandle
    dragging: bool = False

    def show_at(self, root: Floats[D6]) -> None:
        """Move the control to the root parameters [m, rad], unless the user holds it."""
        if not self.dragging:
            self.control.position = root[:3]
            self.control.wxyz = quaternion_wxyz(rotation_matrix(root[3:6]))


def add_root_handle(
    server: viser.ViserServer, name: str, on_edit: RootEdit, larger: float = 1.0
) -> RootHandle:
    """Add the control; `on_edit` receives root parameters by name while it is dragged. larger: than a hand's."""
    control = server.scene.add_transform_controls(
        name,
        scale=0.09 * larger,
        line_width=2.5,
        disable_sliders=True,
        depth_test=False,
        opacity=0.9,
        visible=False,
    )
    handle = RootHandle(control)

    @control.on_update
    def _(event: viser.TransformControlsEvent) -> None:
        handle.dragging = event.phase != "end"
        edit = root_parameters(event.target.position, event.target.wxyz)
        if edit:
            on_edit(edit)

    return handle


def root_parameters(position: object, wxyz: object) -> dict[str, float]:
    """Return the root parameters of a pose that came from a client; empty if it is no pose."""
    try:
        place = np.asarray(position, dtype=float).reshape(3)
        turn = np.asarray(wxyz, dtype=float).reshape(4)
    except (TypeError, ValueError):
        return {}
    length = float(np.linalg.norm(turn))
    if not (
        np.isfinite(place).all()
        and np.isfinite(length)
        and length > 1e-6
        and np.abs(place).max() < 100
    ):
        return {}
    rotvec = rotation_vector(matrix_from_quaternion(turn / length))
    return dict(zip(ROOT, [*place.tolist(), *rotvec.tolist()], strict=True))
