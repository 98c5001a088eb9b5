"""Grips: in a camera's picture the hand can be taken hold of. Who looks through a camera drags a joint or a segment to its place."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
import viser

from handtrack.geometry.rotation import quaternion_wxyz
from handtrack_app.page.page import Page, put
from handtrack_app.page.pins.taking_hold import Hold, hold_at
from handtrack_app.page.scene.solids import ball
from handtrack_app.page.views.zoom import ray_pixel
from handtrack_app.protocol.commands import SetPin
from handtrack_app.protocol.palette import PIN
from handtrack_app.protocol.snapshots import HAND_REACH_M, CameraCard, PoseSnapshot, SessionSnapshot

_GRIP, _HEADS, _THREADS = "/grips/flesh", "/pins/heads", "/pins/threads"
_UNSEEN = 0.004  # opacity: what is not drawn at all cannot be pointed at
_HEAD_M = 0.0028
_BEFORE_M = 0.03
"""that a pin's head stands nearer to its camera than what it holds: flesh does not hide it"""


@dataclass
class _Drag:
    hold: Hold
    tag: str


class Grips:
    """Each page that looks through a camera has grips of its own; pins are drawn for all."""

    def __init__(self, page: Page, card_of: Callable[[int | None], CameraCard | None]) -> None:
        """card_of: the camera that a client looks through."""
        self._page, self._card_of = page, card_of
        self._session: SessionSnapshot | None = None
        self._pose: PoseSnapshot | None = None
        self._grips: dict[int, viser.BatchedMeshHandle] = {}
        self._drags: dict[int, _Drag] = {}
        self._count = 0
        self.by_images = True
        """what was seen holds the rest of the hand while a joint is dragged; else it changes least"""
        self.clicked: Callable[[str], None] = lambda bone: None
        """told of a bone that was clicked"""
        mesh = ball(8, 12)
        self._heads = page.server.scene.add_batched_meshes_simple(
            _HEADS, mesh.vertices, mesh.faces, np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)),
            batched_scales=np.array([_HEAD_M], np.float32), batched_colors=PIN, lod="off", cast_shadow=False, visible=False,
        )  # fmt: skip
        self._threads = page.server.scene.add_line_segments(
            _THREADS, np.zeros((1, 2, 3), np.float32), PIN, thickness=2.0, thickness_units="screen",
            visible=False,
        )  # fmt: skip

    def fit(self, session: SessionSnapshot) -> None:
        """Take the model of a session."""
        before, self._session = self._session, session
        if before is not None and before.model != session.model:
            self._pose = None
            self._let_go(list(self._grips))

    def show(self, pose: PoseSnapshot) -> None:
        """Follow a pose."""
        self._pose = pose
        if (
            not self._page.state.playing
        ):  # nobody takes hold of a hand that runs; at the end all is drawn anew
            self.place()
        self._show_pins(pose)

    def place(self) -> None:
        """Stand grips where the hand is, for those who look through a camera; for nobody else."""
        here, pose = self._page.server.get_clients(), self._pose
        looking = {number for number in here if self._card_of(number) is not None}
        self._let_go([number for number in self._grips if number not in looking])
        if pose is None or self._session is None or len(pose.centre) != len(self._session.radii):
            return
        for number in looking:
            grip = self._grips.get(number)
            if grip is None:
                grip = self._grips[number] = self._add(here[number], self._session)
            grip.batched_positions = pose.centre.astype(np.float32)
            grip.batched_wxyzs = quaternion_wxyz(pose.rotation).astype(np.float32)

    def _let_go(self, numbers: list[int]) -> None:
        for number in numbers:
            grip = self._grips.pop(number, None)
            self._drags.pop(number, None)
            if grip is not None:
                with suppress(RuntimeError):  # its page has gone
                    grip.remove()

    def _show_pins(self, pose: PoseSnapshot) -> None:
        pins, session = pose.pins, self._session
        if session is None:
            return
        larger = session.reach_m / HAND_REACH_M
        centres = {card.name: card.centre for card in session.cameras}
        with self._page.server.atomic():
            if pins:
                meant = np.array([pin.meant for pin in pins])
                back = np.array([centres[pin.camera] for pin in pins]) - meant
                away = np.linalg.norm(back, axis=1, keepdims=True)
                heads = meant + back * np.minimum(larger * _BEFORE_M / np.maximum(away, 1e-9), 0.5)
                places = np.array([pin.place for pin in pins])
                turn = np.array([1.0, 0.0, 0.0, 0.0], np.float32)
                self._heads.batched_positions = heads.astype(np.float32)
                self._heads.batched_wxyzs = np.tile(turn, (len(pins), 1))
                self._heads.batched_scales = np.full(len(pins), larger**0.75 * _HEAD_M, np.float32)
                self._threads.points = np.stack([heads, places], axis=1).astype(np.float32)
            put(self._heads, visible=bool(pins))
            put(self._threads, visible=bool(pins))

    def _add(self, client: viser.ClientHandle, session: SessionSnapshot) -> viser.BatchedMeshHandle:
        mesh, count = ball(10, 14), len(session.radii)
        grip = client.scene.add_batched_meshes_simple(
            _GRIP, mesh.vertices, mesh.faces, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.zeros((count, 3)),
            batched_scales=session.radii.astype(np.float32), opacity=_UNSEEN, lod="off", cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip

        # in order, on viser's loop: a little arithmetic, and sent on
        @grip.on_drag("left")
        async def _(event: viser.SceneNodeDragEvent[viser.BatchedMeshHandle]) -> None:
            self._dragged(client.client_id, event)

        @grip.on_click
        def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
            index = -1 if event.instance_index is None else event.instance_index
            if self._session is not None and 0 <= index < len(self._session.ellipsoid_bone):
                bone = int(self._session.ellipsoid_bone[index])
                self.clicked(self._session.bone_names[bone])

        return grip

    def _dragged(
        self, number: int, event: viser.SceneNodeDragEvent[viser.BatchedMeshHandle]
    ) -> None:
        card, session, pose = self._card_of(number), self._session, self._pose
        if card is None or session is None or pose is None or event.instance_index is None:
            return
        if event.phase == "start":
            at = np.asarray(event.start_position, dtype=float)
            hold = hold_at(session, pose, card, event.instance_index, at)
            if hold is None:
                return
            self._count += 1
            self._drags[number] = _Drag(hold, f"pin {number}.{self._count}")
        drag = self._drags.get(number)
        if drag is None:
            return
        end = np.asarray(event.end_position, dtype=float) - card.centre
        pixel = ray_pixel(card, end) if np.isfinite(end).all() else None
        if event.phase == "end":
            del self._drags[number]
        if pixel is None or (
            event.phase == "start" and event.start_screen_pos == event.end_screen_pos
        ):
            return
        state, hold = self._page.state, drag.hold
        version = state.begin_edit()
        self._page.send(
            SetPin(
                state.frame, card.name, pixel, version, hold.joint, hold.bone, hold.point,
                self.by_images, drag.tag,
            )
        )  # fmt: skip
