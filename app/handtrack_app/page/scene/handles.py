"""Controls in the scene: one moves and turns the whole hand, others pull its fingertips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from handtrack.arrays import D3, D6, Floats, K
from handtrack.geometry.rotation import (
    matrix_from_quaternion,
    quaternion_wxyz,
    rotation_matrix,
    rotation_vector,
)

RootEdit = Callable[[dict[str, float]], None]
_ROOT = ("root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz")


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


TipEdit = Callable[[str, tuple[float, float, float]], None]


@dataclass
class TipHandles:
    """Controls that pull fingertips."""

    controls: dict[str, viser.TransformControlsHandle]
    held: str | None = None

    def show_at(self, tips: Floats[K, D3]) -> None:
        """Move the controls to the fingertips (T, 3) [m], except the one that the user holds."""
        for (name, control), place in zip(self.controls.items(), tips, strict=True):
            if name != self.held:
                control.position = place

    def remove(self) -> None:
        """Take the controls out of the scene."""
        for control in self.controls.values():
            control.remove()

    def show(self, visible: bool) -> None:
        for control in self.controls.values():
            control.visible = visible


def add_tip_handles(
    server: viser.ViserServer,
    name: str,
    tips: tuple[str, ...],
    on_edit: TipEdit,
    larger: float = 1.0,
) -> TipHandles:
    """Add a control for each fingertip; `on_edit(tip, place)` is called while one is dragged. larger: than a hand's."""
    handles = TipHandles({})
    for tip in tips:
        control = server.scene.add_transform_controls(
            f"{name}/{tip}", scale=0.035 * larger, line_width=2.5, disable_sliders=True, disable_rotations=True,
            depth_test=False, opacity=0.9, visible=False,
        )  # fmt: skip
        handles.controls[tip] = control

        @control.on_update
        def _(event: viser.TransformControlsEvent, tip: str = tip) -> None:
            handles.held = None if event.phase == "end" else tip
            place = root_parameters(event.target.position, (1.0, 0.0, 0.0, 0.0))
            if place:
                on_edit(tip, (place["root_tx"], place["root_ty"], place["root_tz"]))

    return handles


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
    return dict(zip(_ROOT, [*place.tolist(), *rotvec.tolist()], strict=True))
