"""The hand taken hold of. In a camera's picture a joint or a segment is dragged to its place, and the palm takes the whole hand
along; in a free view without the handle, Shift and a drag pull a joint or a segment parallel to the screen. Everywhere a handle moves and
turns the whole hand.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np
import viser

from handtrack.arrays import D3, D6, Floats
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import (
    matrix_from_quaternion,
    quaternion_wxyz,
    rotation_matrix,
    rotation_vector,
)
from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Client, Page, Part, put
from handtrack_app.page.scene.model_view import TINY, add_batch, ball, tiny, unturned
from handtrack_app.page.scene.viewpoint import ray_pixel, window_camera
from handtrack_app.palette import CONTRADICTED, PIN
from handtrack_app.protocol import (
    BEFORE,
    HAND_REACH_M,
    Hold,
    PoseSnapshot,
    SessionSnapshot,
)

_GRIP, _FREE_GRIP = "/grips/flesh", "/grips/free"
"""of who looks through a camera, and of who looks freely"""
_POINT_M = 1e-6
"""radius of a joint among the grips: nobody meets it, but the page reads where it is (`name_holds`)"""
_UNSEEN = 0.004  # opacity: what is not drawn at all cannot be pointed at
Event = viser.SceneNodeDragEvent[viser.BatchedMeshHandle]
RootAt = Callable[[Floats[D3]], dict[str, float] | None]
"""returns where the root is when the pointer is over a point, world [m]; None where that tells nothing"""
Drag = Callable[[Floats[D3]], None]
"""does what it means that the pointer is over a point, world [m]"""


class Grips:
    """Each page has grips of its own, unseen, which follow the hand that is drawn for all: what is drawn takes no drags."""

    def __init__(
        self, page: Page, card_of: Callable[[Client], Camera | None], pose: PoseSnapshot
    ) -> None:
        """card_of: the camera that a client looks through."""
        self._page, self._card_of = page, card_of
        self._pose = pose
        self._count = 0
        self.by_images = True
        """what was seen holds the rest of the hand while a joint is dragged; else it changes least"""
        self.clicked: Callable[[str], None] = lambda bone: None
        """told of a bone that was clicked"""
        self._marks = PinMarks(page)
        self.freely = False
        """who looks freely can take hold, too, with Shift: a drag alone turns the view. Not while the handle is shown: whatever can be
        dragged takes the pointer from what it hides, the handle's arrows too
        """

    @property
    def _session(self) -> SessionSnapshot:
        return self._page.state.session

    def let_go(self) -> None:
        """The model is another."""
        for client in self._page.clients:
            _let_go(client)

    def show(self, pose: PoseSnapshot) -> None:
        """Follow a pose."""
        self._pose = pose
        if (
            not self._page.state.playing
        ):  # nobody takes hold of a hand that runs; at the end all is drawn anew
            self.place()
        self._marks.show(self._session, pose)

    def place(self) -> None:
        """Stand grips where the hand is, for those who can take hold of it."""
        pose = self._pose
        places = np.concatenate([pose.centre, pose.joints]).astype(np.float32)
        turns = unturned(len(places))
        turns[: len(pose.centre)] = quaternion_wxyz(pose.rotation)
        for client in self._page.clients:
            with client.lock:  # a redraw comes by any thread of viser
                free = _FREE_GRIP if self.freely else None
                name = free if self._card_of(client) is None else _GRIP
                if client.grip is not None and client.grip.name != name:
                    _let_go(client)
                if name is None or len(pose.centre) != len(self._session.radii):
                    continue
                client.grip = grip = client.grip or self._add(client, name)
                grip.batched_positions, grip.batched_wxyzs = places, turns

    def _add(self, client: Client, name: str) -> viser.BatchedMeshHandle:
        session = self._session
        joints = np.full((len(session.joint_names), 3), _POINT_M)
        grip = add_batch(
            client.handle.scene, name, tiny(ball(10, 14)), np.concatenate([session.radii, joints]) / TINY, opacity=_UNSEEN,
            cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        turned = partial(self._dragged, client, True)
        grip.on_drag("left", modifier="shift")(turned)
        if name == _FREE_GRIP:
            return grip
        name_holds(client.handle, session, name)
        grip.on_drag("left")(partial(self._dragged, client, False))
        grip.on_drag("right")(turned)

        @grip.on_click
        def _(event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle]) -> None:
            session, index = self._session, event.instance_index
            if index is not None and 0 <= index < len(session.ellipsoid_bone):
                self.clicked(session.bone_names[int(session.ellipsoid_bone[index])])

        return grip

    # ---- drags: in order, on viser's loop, a little arithmetic, and sent on

    async def _dragged(self, client: Client, turns: bool, event: Event) -> None:
        end = np.asarray(event.end_position, dtype=float)
        if event.phase == "start":
            client.drag = self._begun(client, event, turns) or client.drag
        drag = client.drag
        if event.phase == "end":
            client.drag = None
        rests = event.phase == "start" and event.start_screen_pos == event.end_screen_pos
        if drag is not None and np.isfinite(end).all() and not rests:
            drag(end)

    def _begun(self, client: Client, event: Event, turns: bool) -> Drag | None:
        """Return what is taken hold of; None where nothing can be: nobody drags what is only looked at."""
        session, pose = self._session, self._pose
        start = np.asarray(event.start_position, dtype=float)
        if pose.origin == BEFORE or not np.isfinite(start).all():
            return None
        self._count += 1
        tag, card = f"drag {self._count}", self._card_of(client)
        eye, root = card or window_camera(client.handle.camera), np.array(pose.values[:6])
        if card is not None and turns:
            turned = partial(dragged_root, card, root, start, pose.middle)
            return partial(self._move, "Turn", tag, turned)
        index = ellipsoid_at(session, pose, start)
        hold = None if index is None else hold_at(session, pose, eye, index, start)
        if hold is None:
            return None
        if hold.bone in session.stem_bones:
            # parallel to the image, or, seen freely, to the screen
            moved = partial(dragged_root, eye, root, start, None)
            return partial(self._move, "Move", tag, moved)
        if card is None:
            return partial(self._pull, tag, hold, place_of(hold, session, pose) - start)
        return partial(self._pin, tag, hold, card)

    def _move(self, words: str, tag: str, root_at: RootAt, end: Floats[D3]) -> None:
        edit = root_at(end)
        if edit is not None:
            self._page.edit_pose(edit, words, tag, is_stroke=True)

    def _pull(self, tag: str, hold: Hold, off: Floats[D3], end: Floats[D3]) -> None:
        """off: from where the pointer took hold to what it holds."""
        state, place = self._page.state, tuple((off + end).tolist())
        self._page.engine.pull_place(state.frame, place, state.begin_edit(), hold, tag)

    def _pin(self, tag: str, hold: Hold, card: Camera, end: Floats[D3]) -> None:
        pixel, state = ray_pixel(card, end - card.centre), self._page.state
        if pixel is not None:
            version = state.begin_edit()
            self._page.engine.set_pin(
                state.frame, card.name, pixel, version, hold, self.by_images, tag
            )


def _let_go(client: Client) -> None:
    with client.lock:
        grip, client.grip, client.drag = client.grip, None, None
        if grip is not None:
            with suppress(RuntimeError):  # its page has gone
                grip.remove()


# ---- What a pointer takes hold of in a camera's picture: a joint where it is near one, else the point of a segment under it


NEAR_JOINT_M = 0.007
"""as near as a finger is thick; of a body, as much more as it is larger"""
BEHIND = 4.0
"""times as far as that from what is pointed at, a joint lies behind it, though it is seen beside it"""
LEAST_AWAY_M = 0.05
"""nearer to a camera nothing is any larger in its image"""


def place_of(hold: Hold, session: SessionSnapshot, pose: PoseSnapshot) -> Floats[D3]:
    """Return where a pose has it, world [m]."""
    if hold.joint:
        return pose.joints[session.joint_names.index(hold.joint)]
    bone = session.bone_names.index(hold.bone)
    return pose.bone_position[bone] + pose.bone_rotation[bone] @ np.array(hold.point)


def near_joint_m(session: SessionSnapshot) -> float:
    """Return how far from a joint is still at it: half of what carries it is as thick as that."""
    return NEAR_JOINT_M * session.reach_m / HAND_REACH_M


def ellipsoid_at(session: SessionSnapshot, pose: PoseSnapshot, at: Floats[D3]) -> int | None:
    """Return the ellipsoid of the flesh that a point, world [m], is in or next to; None where the pose is not of this model."""
    if len(pose.centre) != len(session.radii) or not len(session.radii):
        return None
    inside = np.einsum("nji,nj->ni", pose.rotation, at - pose.centre) / session.radii
    return int(np.argmin((inside**2).sum(axis=1)))


def hold_at(
    session: SessionSnapshot,
    pose: PoseSnapshot,
    card: Camera,
    ellipsoid: int,
    at: Floats[D3],
) -> Hold | None:
    """Return what is held where a pointer meets an ellipsoid at a point, world [m]; None for what is not of this pose."""
    pixel, near_m = ray_pixel(card, at - card.centre), near_joint_m(session)
    if pixel is None:
        return None
    off_px = np.linalg.norm(card.project(pose.joints) - pixel, axis=1)
    away_m = np.linalg.norm(pose.joints - at, axis=1)
    off_px = np.where(np.isfinite(off_px) & (away_m <= BEHIND * near_m), off_px, np.inf)
    nearest = int(off_px.argmin())
    if off_px[nearest] < near_m * float(card.pixels_per_m_at(at)):
        return Hold(joint=session.joint_names[nearest])
    bone = int(session.ellipsoid_bone[ellipsoid])
    place = _on_ellipsoid(session, pose, card, ellipsoid, at) - pose.bone_position[bone]
    x, y, z = (pose.bone_rotation[bone].T @ place).tolist()
    return Hold(bone=session.bone_names[bone], point=(x, y, z))


def _on_ellipsoid(
    session: SessionSnapshot, pose: PoseSnapshot, card: Camera, ellipsoid: int, at: Floats[D3]
) -> Floats[D3]:
    """Return where the ray through a point first meets an ellipsoid; the nearest point of the ray to its centre where it misses."""
    radii, turn = session.radii[ellipsoid], pose.rotation[ellipsoid]
    way = (turn.T @ (at - card.centre)) / radii
    begin = (turn.T @ (card.centre - pose.centre[ellipsoid])) / radii
    a, b, c = way @ way, way @ begin, begin @ begin - 1.0
    root = max(float(b * b - a * c), 0.0)
    return card.centre + float((-b - np.sqrt(root)) / a) * (at - card.centre)


# ---- The name of what a drag would take hold of, beside the pointer: the page's own script (`style`) shows it


def name_holds(client: viser.ClientHandle, session: SessionSnapshot, node: str) -> None:
    """Tell a page what its grips are called: a node's instances are the ellipsoids and then the joints."""
    whole = {
        bone: f"{bone.replace('_', ' ')}: moves the whole {session.kind}"
        for bone in session.stem_bones
    }
    bones = [session.bone_names[int(bone)] for bone in session.ellipsoid_bone]
    known = {
        "node": node,
        "radius": TINY,
        "near": near_joint_m(session),
        "behind": BEHIND * near_joint_m(session),
        "least": LEAST_AWAY_M,
        "segments": [whole.get(bone, bone.replace("_", " ")) for bone in bones],
        "joints": [joint.replace("_", " ") for joint in session.joint_names],
    }
    internals.run_javascript(client, f"window.handtrackHolds = {json.dumps(known)}")


# ---- The whole hand moved: parallel to a camera's image, or turned, its fingers as they are


ROOT = ("root_tx", "root_ty", "root_tz", "root_rx", "root_ry", "root_rz")
_NEAR_AXIS_M = 0.004
"""so near to the axis the pointer tells no angle: a tremble would turn the hand over"""


def dragged_root(
    card: Camera,
    root: Floats[D6],
    start: Floats[D3],
    middle: Floats[D3] | None,
    end: Floats[D3],
) -> dict[str, float] | None:
    """Return root parameters by name when the whole hand is dragged in a camera's picture; None where that tells nothing.

    root: where the drag began [m, rad]. start, end: what was taken hold of, and where the pointer is now, world [m]. middle: of the
    hand, world [m], which turns about the line of sight to that; None: it moves parallel to the image.
    """
    now, was = (_as_deep(card, p, start if middle is None else middle) for p in (end, start))
    if now is None or was is None:
        return None
    place, turn = root[:3], root[3:]
    if middle is None:
        place = place + now - was
    else:
        axis = middle - card.centre
        axis = axis / np.linalg.norm(axis)
        was, now = (p - middle - ((p - middle) @ axis) * axis for p in (was, now))
        if min(np.linalg.norm(was), np.linalg.norm(now)) < _NEAR_AXIS_M:
            return None
        by = rotation_matrix(axis * np.arctan2(np.cross(was, now) @ axis, was @ now))
        place = middle + by @ (place - middle)
        turn = rotation_vector(by @ rotation_matrix(turn))
    return dict(zip(ROOT, [*place.tolist(), *turn.tolist()], strict=True))


def _as_deep(card: Camera, point: Floats[D3], other: Floats[D3]) -> Floats[D3] | None:
    """Return what the camera sees where it sees a point, as deep in its picture as another."""
    way = point - card.centre
    along, depth = card.to_camera(np.stack([point, other]))[:, 2]
    if depth <= 0 or along <= 1e-9 * float(np.linalg.norm(way)):
        return None
    return card.centre + way * (depth / along)


# ---- Pins as they are drawn in the scene: a head on the ray, and a thread to what it holds


_HEADS, _THREADS = "/pins/heads", "/pins/threads"
_HEAD_M = 0.0028
_MISSED = 1.6
"""times as large is the head of a pin that the pose misses: red and orange look alike to many"""
_BEFORE_M = 0.03
"""that a pin's head stands nearer to its camera than what it holds: flesh does not hide it"""


class PinMarks:
    """They are drawn for all pages."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._heads = add_batch(
            page.server.scene, _HEADS, ball(8, 12), np.array([_HEAD_M]), batched_colors=PIN, cast_shadow=False, visible=False
        )  # fmt: skip
        self._threads = page.server.scene.add_line_segments(
            _THREADS, np.zeros((1, 2, 3), np.float32), PIN, thickness=2.0, thickness_units="screen",
            visible=False,
        )  # fmt: skip

    def show(self, session: SessionSnapshot, pose: PoseSnapshot) -> None:
        """Show the pins of a pose; those that it misses, which contradict something, are red and larger."""
        pins, larger = pose.pins, session.reach_m / HAND_REACH_M
        centres = {card.name: card.centre for card in session.cameras}
        with self._page.server.atomic():
            if pins:
                meant = np.array([pin.meant for pin in pins])
                back = np.array([centres[pin.camera] for pin in pins]) - meant
                away = np.linalg.norm(back, axis=1, keepdims=True)
                heads = meant + back * np.minimum(larger * _BEFORE_M / np.maximum(away, 1e-9), 0.5)
                places = np.array([pin.place for pin in pins])
                self._heads.batched_positions = heads.astype(np.float32)
                self._heads.batched_wxyzs = unturned(len(pins))
                missed = np.array([pin.off_m > near_joint_m(session) for pin in pins])
                heads_m = larger**0.75 * _HEAD_M * np.where(missed, _MISSED, 1.0)
                self._heads.batched_scales = heads_m.astype(np.float32)
                colours = np.where(missed[:, None], CONTRADICTED, PIN).astype(np.uint8)
                self._heads.batched_colors = colours
                self._threads.colors = np.repeat(colours[:, None], 2, axis=1)
                self._threads.points = np.stack([heads, places], axis=1).astype(np.float32)
            for drawn in (self._heads, self._threads):
                put(drawn, visible=bool(pins))


# ---- The handle in the scene that moves and turns the whole hand


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
