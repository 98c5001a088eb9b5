"""The hand taken hold of. In a camera's picture a joint or a segment is dragged to its place, and the palm takes the whole hand
along; in a free view without the handle, Shift and a drag pull a joint or a segment parallel to the screen.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import viser

from handtrack.arrays import D3, Floats
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Page
from handtrack_app.page.pins.hover import name_holds
from handtrack_app.page.pins.pin_marks import PinMarks
from handtrack_app.page.pins.taking_hold import Hold, ellipsoid_at, hold_at, view_card
from handtrack_app.page.pins.whole_hand import WholeDrag
from handtrack_app.page.scene.model_view import ball
from handtrack_app.page.scene.zoom import ray_pixel
from handtrack_app.protocol.snapshots import BEFORE, CameraCard, PoseSnapshot, SessionSnapshot

if TYPE_CHECKING:
    from handtrack_app.viser_internals import DragButton, KeyModifier

_GRIP = "/grips/flesh"
_POINT_M = 1e-6
"""radius of a joint among the grips: nobody meets it, but the page reads where it is (`hover`)"""
_UNSEEN = 0.004  # opacity: what is not drawn at all cannot be pointed at
Node = viser.BatchedMeshHandle | viser.MeshHandle
Event = (
    viser.SceneNodeDragEvent[viser.BatchedMeshHandle] | viser.SceneNodeDragEvent[viser.MeshHandle]
)


@dataclass(frozen=True)
class _Drag:
    """What a page drags, and where it took hold of it."""

    tag: str
    held: Hold | WholeDrag
    card: CameraCard | None
    """that it looks through; None: freely"""
    start: Floats[D3]
    """world [m]"""
    place: Floats[D3]
    """of the joint or point that is held, world [m]"""


class Grips:
    """Each page that looks through a camera has grips of its own, which follow the hand that is drawn for all."""

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
        self._marks = PinMarks(page)
        self._lock = threading.RLock()  # a redraw comes by any thread of viser
        self._drawn_as: tuple[Node, ...] = ()
        """what is drawn of the hand"""
        self._is_offered = False
        """whether that can be dragged"""
        self._aside = set[int]()
        """clients for which it does not stand before the grips"""

    def fit(self, session: SessionSnapshot) -> None:
        """Take the model of a session."""
        before, self._session = self._session, session
        if before is not None and before.model != session.model:
            self._pose = None
            with self._lock:
                self._let_go(list(self._grips))

    def show(self, pose: PoseSnapshot) -> None:
        """Follow a pose."""
        self._pose = pose
        if (
            not self._page.state.playing
        ):  # nobody takes hold of a hand that runs; at the end all is drawn anew
            self.place()
        if self._session is not None:
            self._marks.show(self._session, pose)

    def place(self) -> None:
        """Stand grips where the hand is, for those who look through a camera; for nobody else."""
        with self._lock:
            self._place()

    def _place(self) -> None:
        here, pose = self._page.server.get_clients(), self._pose
        looking = {number for number in here if self._card_of(number) is not None}
        self._let_go([number for number in self._grips if number not in looking])
        self._offer()
        for number in looking ^ self._aside if self._is_offered else ():
            self._stand_aside(number, aside=number in looking)
        if pose is None or self._session is None or len(pose.centre) != len(self._session.radii):
            return
        for number in looking:
            grip = self._grips.get(number)
            if grip is None:
                grip = self._grips[number] = self._add(here[number], self._session)
            turns = quaternion_wxyz(pose.rotation)
            still = np.tile([1.0, 0.0, 0.0, 0.0], (len(pose.joints), 1))
            grip.batched_positions = np.concatenate([pose.centre, pose.joints]).astype(np.float32)
            grip.batched_wxyzs = np.concatenate([turns, still]).astype(np.float32)

    def offer(self, nodes: Iterable[Node]) -> None:
        """Let what is drawn of the hand be taken hold of with Shift: in a free view, too, where a drag alone turns the view.

        Not while the handle is shown: whatever can be dragged takes the pointer from what it hides, the handle's arrows too.
        """
        self._drawn_as, self._is_offered = tuple(nodes), False

    def _offer(self) -> None:
        wanted = not self._page.state.display.handle
        if wanted == self._is_offered:
            return
        self._is_offered, self._aside = wanted, set()
        for node in self._drawn_as:
            node.remove_drag_callback()
            if wanted:
                self._listen(node, "left", "shift")

    def _stand_aside(self, number: int, aside: bool) -> None:
        """Let what is drawn of the hand take no drags of one page: they would not pass through to its grips."""
        (self._aside.add if aside else self._aside.discard)(number)
        client = self._page.server.get_clients().get(number)
        takes = () if aside else (internals.DragBinding("left", "shift"),)
        if client is not None:
            for node in self._drawn_as:
                internals.let_drag(client, node.name, takes)

    def _let_go(self, numbers: list[int]) -> None:
        for number in numbers:
            grip = self._grips.pop(number, None)
            self._drags.pop(number, None)
            if grip is not None:
                with suppress(RuntimeError):  # its page has gone
                    grip.remove()

    def _add(self, client: viser.ClientHandle, session: SessionSnapshot) -> viser.BatchedMeshHandle:
        mesh, joints = ball(10, 14), np.full((len(session.joint_names), 3), _POINT_M)
        radii, count = np.concatenate([session.radii, joints]), len(session.radii) + len(joints)
        grip = client.scene.add_batched_meshes_simple(
            _GRIP, mesh.vertices, mesh.faces, np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)), np.zeros((count, 3)),
            batched_scales=radii.astype(np.float32), opacity=_UNSEEN, lod="off", cast_shadow=False,
            receive_shadow=False,
        )  # fmt: skip
        name_holds(client, session, _GRIP)
        self._listen(grip, "left")
        self._listen(grip, "left", "shift")
        self._listen(grip, "right")

        @grip.on_click
        def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
            index = -1 if event.instance_index is None else event.instance_index
            if self._session is not None and 0 <= index < len(self._session.ellipsoid_bone):
                bone = int(self._session.ellipsoid_bone[index])
                self.clicked(self._session.bone_names[bone])

        return grip

    def _listen(self, node: Node, button: DragButton, modifier: KeyModifier | None = None) -> None:
        turns = button == "right" or modifier == "shift"

        # in order, on viser's loop: a little arithmetic, and sent on
        async def dragged(event: Event) -> None:
            self._dragged(event, turns)

        node.on_drag(button, modifier=modifier)(dragged)

    # ---- drags

    def _dragged(self, event: Event, turns: bool) -> None:
        number = event.client.client_id
        end = np.asarray(event.end_position, dtype=float)
        if event.phase == "start":
            drag = self._begun(event, turns)
            if drag is not None:
                self._drags[number] = drag
        drag = self._drags.get(number)
        if event.phase == "end":
            self._drags.pop(number, None)
        rests = event.phase == "start" and event.start_screen_pos == event.end_screen_pos
        if drag is not None and np.isfinite(end).all() and not rests:
            self._drawn(drag, end)

    def _begun(self, event: Event, turns: bool) -> _Drag | None:
        """Return what is taken hold of; None where nothing can be: nobody drags what is only looked at."""
        session, pose, number = self._session, self._pose, event.client.client_id
        start = np.asarray(event.start_position, dtype=float)
        if session is None or pose is None or pose.origin == BEFORE or not np.isfinite(start).all():
            return None
        self._count += 1
        tag, card = f"drag {number}.{self._count}", self._card_of(number)
        root = np.array(pose.values[:6])
        if card is not None and turns:
            return _Drag(tag, WholeDrag(card, root, pose.middle, start, True), card, start, start)
        eye = card or view_card(event.client.camera)
        index = ellipsoid_at(session, pose, start)
        hold = None if index is None else hold_at(session, pose, eye, index, start)
        if hold is None:
            return None
        if hold.bone in session.stem_bones:
            # parallel to the image, or, seen freely, to the screen
            return _Drag(tag, WholeDrag(eye, root, pose.middle, start, False), card, start, start)
        return _Drag(tag, hold, card, start, hold.place(session, pose))

    def _drawn(self, drag: _Drag, end: Floats[D3]) -> None:
        """Do what a drag to a point, world [m], means."""
        page, hold = self._page, drag.held
        state = page.state
        if isinstance(hold, WholeDrag):
            edit = hold.to(end)
            if edit is not None:
                page.edit_pose(edit, "Turn" if hold.turns else "Move", drag.tag, is_stroke=True)
        elif drag.card is None:
            x, y, z = (float(v) for v in drag.place + end - drag.start)
            version = state.begin_edit()
            page.engine.pull_place(
                state.frame, (x, y, z), version, hold.joint, hold.bone, hold.point, drag.tag
            )
        else:
            pixel = ray_pixel(drag.card, end - drag.card.centre)
            if pixel is not None:
                version = state.begin_edit()
                page.engine.set_pin(
                        state.frame, drag.card.name, pixel, version, hold.joint, hold.bone, hold.point,
                        self.by_images, drag.tag,
                    )  # fmt: skip
