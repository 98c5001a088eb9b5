"""Cameras: frusta with live images; and what each page looks through, a camera whose picture stands behind the hand, its own."""

from __future__ import annotations

import html
import json
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import viser

from handtrack.arrays import D3, Bytes, Floats, N
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import matrix_from_quaternion, quaternion_wxyz
from handtrack_app import viser_internals as internals
from handtrack_app.page.html import bordered, pictures
from handtrack_app.page.html import picture as as_html
from handtrack_app.page.page import Client, Display, Page, put
from handtrack_app.page.scene.viewpoint import (
    MOST,
    Area,
    Pixel,
    Viewpoint,
    Zoom,
    around,
    box_of,
    enlarged,
    eye,
    fov_of,
    frustum_depth,
    look_from,
    ray_pixel,
    whole,
    window_camera,
    with_pixel_at,
)
from handtrack_app.palette import residual_colours
from handtrack_app.protocol import (
    Box,
    CloudSnapshot,
    Image,
    SessionSnapshot,
)

_BEHIND = 0.16  # [m] from the hand to the screen: a flat hand cannot touch it
_IN_THE_WAY = ("/cameras", "/ground")
"""of who looks through a camera: its neighbour's picture could stand before the hand"""
_SCREEN = "/screen"
ALL = "*"
"""what a page looks through that sees all cameras: close pictures of the hand in a panel over the scene"""
CLOSE = "close"
"""what such a picture is called among what is painted over a camera's image"""
Picture = tuple[str, str]
"""a camera, and what is painted over its image"""
Clicked = viser.SceneNodePointerEvent[viser.ImageHandle]
Dragged = viser.SceneNodeDragEvent[viser.ImageHandle]
Pointed = Callable[[str, Pixel, str], None]
"""pointed(camera, column and row [px] of its undistorted image, `start`, `update`, `end` or `click`)"""


@dataclass
class Screen:
    """The picture behind the hand in one page's own scene."""

    image: viser.ImageHandle
    picture: Picture | None = None
    frame: int | None = None
    """what the picture is of"""
    depth: dict[str, float] = field(default_factory=dict)
    """by camera [m], where it stood last"""


class Looking:
    """The pages' looks and screens; asked by the threads of viser and by the view thread."""

    def __init__(self, page: Page, name_of: Callable[[str], str], cards: dict[str, Camera]) -> None:
        """name_of: what stands beside a camera's picture; cards: the session's cameras, as they are now."""
        self._page, self._name_of, self._cards = page, name_of, cards
        self._hand: tuple[Floats[N, D3], Floats[N]] | None = None
        self._close: dict[str, str] = {}
        """close pictures by camera, as HTML"""
        self._close_of: int | None = None
        """the frame that they are of"""
        self.chosen: Callable[[Client], object] = lambda client: None
        """is told whenever a page is shown something else"""

    @property
    def anyone(self) -> bool:
        """Whether a page looks through a camera."""
        return any(map(self.card, self._page.clients))

    def card(self, client: Client) -> Camera | None:
        """Return the camera that a page looks through."""
        return self._cards.get(client.through or "")

    def set_through(self, client: Client, camera: str | None) -> None:
        """Let a page look through a camera, or at what `ALL` see; None: freely, from wherever it is."""
        with client.lock:
            client.through = camera
            self._explain(client)
            card = self.card(client)
            for name in _IN_THE_WAY:
                shown = internals.messages.SetSceneNodeVisibilityMessage(name, card is None)
                internals.send(client.handle, shown)
            if camera == ALL:
                self._add_close_ups(client)
            elif client.close_ups is not None:
                client.close_ups[0].remove()
                client.close_ups = None
            if card is None:
                self.leave(client)
            else:
                client.screen = client.screen or self._add_screen(client)
                self.enter(client, card)

    def set_paint(self, client: Client, paint: str) -> None:
        """Paint something else over what a page sees through its camera."""
        client.paint = paint
        self._explain(client)

    def _explain(self, client: Client) -> None:
        """Let a page show what the colours over its picture mean, and its widgets what is chosen."""
        paint = "" if self.card(client) is None else client.paint
        source = f"document.body.dataset.overlay = {json.dumps(paint)}"
        internals.run_javascript(client.handle, source)
        self.chosen(client)

    def pictures(self, field: bool) -> tuple[Picture, ...]:
        """Return the pictures that the pages show. field: the model's field in place of what is painted else."""
        clients = self._page.clients
        chosen = [shown for one in clients if (shown := _picture(one, field)) is not None]
        if any(one.through == ALL for one in clients):
            chosen += [(camera, CLOSE) for camera in self._cards]
        return tuple(dict.fromkeys(chosen))

    def _add_close_ups(self, client: Client) -> None:
        """Show a page all cameras."""
        if client.close_ups is None:
            panel = client.handle.gui.add_panel()
            with panel.add_tab("All cameras"):
                client.close_ups = panel, client.handle.gui.add_html("")
            panel.float(x=16, y=16, width=560)
            self.draw_close_ups()

    def draw_close_ups(self) -> None:
        """Show all cameras' pictures, with their names, to those who see them."""
        named = {self._name_of(camera): one for camera, one in self._close.items()}
        for client in self._page.clients:
            if (opened := client.close_ups) is not None:
                put(opened[1], content=pictures(named, "handtrack-picture"))

    def _add_screen(self, client: Client) -> Screen:
        """Add a page's screen, and have its pointer over that and its camera heard from now on."""
        image = client.handle.scene.add_image(
            _SCREEN, np.full((48, 64, 3), 30, np.uint8), 0.1, 0.1, format="jpeg", cast_shadow=False,
            receive_shadow=False, visible=False,
        )  # fmt: skip
        image.on_drag("left")(partial(self._dragged_left, client))
        image.on_drag("right")(partial(self._dragged, client))
        client.handle.camera.on_update(partial(self.moved, client))
        return Screen(image)

    def place(self, field: bool, hand: Floats[D3], larger: float) -> None:
        """Stand the screens behind the hand at `hand` [m]. field: as for `pictures`; larger: than a hand."""
        for client in self._page.clients:
            with client.lock:
                screen, picture = client.screen, _picture(client, field)
                if screen is None:
                    continue
                if picture != screen.picture:
                    screen.image.visible = False  # until its picture comes
                screen.picture = picture
                card = None if picture is None else self._cards.get(picture[0])
                if card is not None:
                    _place(screen, card, hand, larger)

    def listen(self, client: Client, pointed: Pointed) -> None:
        """Tell where a page, and no other, drags or clicks on the camera's image that it sees, until `hush`."""
        for other in self._page.clients:
            self.hush(other)
        if client.screen is not None:
            client.pointed = pointed
            client.screen.image.on_click(partial(self._clicked, client))

    def hush(self, client: Client) -> None:
        """Listen no more: drags turn the view again."""
        before, client.pointed = client.pointed, None
        if before is not None and client.screen is not None:
            client.screen.image.remove_click_callback()

    # in order, on viser's loop: a little arithmetic, and sent on

    async def _clicked(self, client: Client, event: Clicked) -> None:
        self._report(client, np.add(event.ray_origin, event.ray_direction), "click")

    async def _dragged_left(self, client: Client, event: Dragged) -> None:
        if client.pointed is not None:
            begins = event.phase == "start"
            if begins:
                self._report(client, np.asarray(event.start_position, float), "start")
            phase = "update" if begins else event.phase
            self._report(client, np.asarray(event.end_position, float), phase)
        elif client.box is None:
            await self._dragged(client, event)

    async def _dragged(self, client: Client, event: Dragged) -> None:
        """Move the picture under the pointer: what is held comes to its place in the window."""
        card, place = self.card(client), event.end_screen_pos
        held = card and ray_pixel(card, np.asarray(event.start_position) - card.centre)
        if held is not None:
            self._change(
                client, lambda view: with_pixel_at(view.card, view.zoom, view.aspect, held, place)
            )

    def _report(self, client: Client, through: Floats[D3], phase: str) -> None:
        screen, card, pointed = client.screen, self.card(client), client.pointed
        if screen is not None and card is not None and pointed is not None:
            eye = np.asarray(client.handle.camera.position, dtype=float)
            at = _pixel(card, screen.depth[card.name], eye, through)
            if at is not None:
                pointed(card.name, at, phase)

    def show(self, images: dict[Picture, Image], frame: int) -> None:
        """Show the pictures of a frame that came."""
        close = {c: as_html(one, c) for (c, paint), one in images.items() if paint == CLOSE}
        if close:
            self._close, self._close_of = close, frame
            self.draw_close_ups()
        for screen in self._screens:
            if screen.picture in images:
                screen.image.image = images[screen.picture]
                screen.image.visible = True
                screen.frame = frame

    @property
    def _screens(self) -> list[Screen]:
        clients = self._page.clients
        return [one.screen for one in clients if one.screen is not None]

    def clear_late(self, moments: Moments) -> None:
        """Hide pictures of frames that were shown too long ago."""
        if self._close and not moments.fits(self._close_of):
            self._close = {}
            self.draw_close_ups()
        for screen in self._screens:
            if screen.image.visible and not moments.fits(screen.frame):
                screen.image.visible = False

    # ---- the pages' camera views: called by viser's threads, its loop, and the view thread

    def enter(self, client: Client, card: Camera) -> None:
        """Let a page look through a camera, at the hand if there is one."""
        with client.lock:
            camera = client.handle.camera
            shape = camera.image_width, camera.image_height
            client.view = view = CameraView(
                card, whole(card), shape[0] / shape[1] if all(shape) else 1.0
            )
            view.zoom = self._at_hand(view) or view.zoom
            self._stand(client, view)

    def ask(self, client: Client, task: str) -> None:
        """Say beside a page's view what is to be done in it; no more, for no words."""
        with client.lock:
            if client.view is not None:
                client.view.task = task
                self._describe(client)

    def leave(self, client: Client) -> None:
        """Let a page look freely again, from wherever it is put next."""
        with client.lock:
            if client.view is not None:
                client.view = None
                messages, (least, most) = internals.messages, _FREE_M
                internals.send(client.handle, messages.SetCameraMaxOrbitDistanceMessage(most))
                internals.send(client.handle, messages.SetCameraMinOrbitDistanceMessage(least))
                self._describe(client)

    def look_freely(self, client: Client, view: Viewpoint) -> None:
        """Move a page's view, unless it looks through a camera by now."""
        with client.lock:
            if client.view is None:
                look_from(client.handle, view)

    def show_hand(self, points: Floats[N, D3], radii: Floats[N]) -> None:
        """Take where the hand is: balls, world [m]. Views that follow it turn where it would be cut off."""
        self._hand = points, radii
        for client in self._page.clients:
            with client.lock:
                view = client.view
                if view is None or view.left or not view.follows:
                    continue
                box = box_of(view.card, points, radii)
                if box is not None and not _shows(view, box):
                    view.zoom = around(view.card, box, view.aspect)
                    self._stand(client, view)

    # ---- what keys and buttons do

    def zoom_by(self, client: Client, factor: float) -> None:
        """Enlarge what is in the window's middle; by 0: show the whole image."""
        self._change(client, lambda view: enlarged(view.card, view.zoom, factor))

    def to_hand(self, client: Client) -> None:
        """Show the hand, and follow it."""
        self._change(client, lambda view: self._at_hand(view) or whole(view.card), follows=True)

    def _change(
        self,
        client: Client,
        zoomed: Callable[[CameraView], Zoom],
        follows: bool = False,
    ) -> None:
        with client.lock:
            view = client.view
            if view is not None:
                view.zoom, view.follows, view.left = zoomed(view), follows, False
                self._stand(client, view)

    # ---- what the page does by itself

    async def moved(self, client: Client, camera: viser.CameraHandle) -> None:
        """Take what the browser tells of its own camera: in order, on viser's loop."""
        with client.lock:
            view = client.view
            if view is None or not camera.image_height:
                return
            direction = np.asarray(camera.look_at) - np.asarray(camera.position)
            if abs(camera.aspect / view.aspect - 1) > 1e-3:  # the window got another shape
                view.aspect = camera.aspect
                if view.follows:
                    view.zoom = self._at_hand(view) or view.zoom
                if not view.left:
                    self._stand(client, view)
                return
            away = float(np.linalg.norm(np.asarray(camera.position) - view.card.centre))
            if away > _LEFT_M:
                if not view.left and time.monotonic() - view.sent[-1].when > _SETTLED_S:
                    view.left = True
                    self._describe(client)
                return
            near = float(np.linalg.norm(direction))
            ahead = matrix_from_quaternion(camera.wxyz)[:, 2]
            if near < 1e-9 or direction @ ahead < (1 - 1e-6) * near:
                return  # half of what it was told: the other half comes with the next frame that it draws
            self._take(client, view, direction, near)
            fov = fov_of(view.eye)
            if abs(camera.fov - fov) > 1e-5:
                internals.send(client.handle, internals.messages.SetCameraFovMessage(fov))

    def _take(self, client: Client, view: CameraView, direction: Floats[D3], near: float) -> None:
        """Take what a page looks at: what it was told last, or what the user turned it to."""
        before = view.zoom, view.follows, view.left
        sent = [one for one in view.sent if np.linalg.norm(direction - one.direction) < 1e-3 * near]
        now = time.monotonic()
        if sent and sent[-1] is view.sent[-1]:
            view.zoom, view.follows = sent[-1].zoom, sent[-1].follows
        elif sent and now - sent[-1].when < _SETTLED_S:
            return  # of what it was told before; what it was told last is under way
        else:
            aim = ray_pixel(view.card, direction)
            if aim is None:
                return
            times = (_NEAR_M / near) ** _NOTCHES
            view.zoom = Zoom(aim, float(np.clip(times, 1.0, MOST)))
            view.follows = False
        view.left = False
        if before != (view.zoom, view.follows, view.left):
            self._describe(client)

    # ---- inside

    def _stand(self, client: Client, view: CameraView) -> None:
        """Put a page's eye where its view says."""
        observed, centre = view.eye, view.card.centre
        direction = observed.rotation[2] * _NEAR_M / view.zoom.times ** (1 / _NOTCHES)
        view.sent.append(_SentView(time.monotonic(), direction, view.zoom, view.follows))
        there = Viewpoint(centre, centre + direction, -observed.rotation[1], fov_of(observed))
        look_from(client.handle, there, (_NEAR_M / MOST ** (1 / _NOTCHES), _NEAR_M))
        self._describe(client)

    def _describe(self, client: Client) -> None:
        """Write the line about a page's view."""
        line, view = client.view_line, client.view
        if view is not None:
            client.view_line = line = line or client.handle.gui.add_html("", order=0.5)
            put(line, content=self._page.phrase(view.words))
        elif line is not None:
            client.view_line = None
            line.remove()

    def _at_hand(self, view: CameraView) -> Zoom | None:
        box = None if self._hand is None else box_of(view.card, *self._hand)
        return None if box is None else around(view.card, box, view.aspect)


def _shows(view: CameraView, box: Area) -> bool:
    """Return whether a box of the image is seen whole, and not much smaller than it could be."""
    x, y, width, height = box
    for corner in ((x, y), (x + width, y + height)):
        inside = np.clip(corner, 0.0, np.array(view.card.size) - 1.0)
        place = ray_pixel(view.eye, view.card.rays(inside))
        if place is None or not all(_INSIDE <= share <= 1 - _INSIDE for share in place):
            return False
    return 0.5 < view.zoom.times / around(view.card, box, view.aspect).times < 2.0


def _picture(client: Client, field: bool) -> Picture | None:
    if client.through in (None, ALL):
        return None
    return client.through, "field" if field else client.paint


def _pixel(card: Camera, depth: float, eye: Floats[D3], through: Floats[D3]) -> Pixel | None:
    """Return where a ray from `eye` through a point (both world [m]) meets a camera's image at `depth` [m]."""
    near, far = card.to_camera(np.stack([eye, through]))[:, 2]
    share = (depth - near) / (far - near) if abs(far - near) > 1e-9 else -1.0
    return None if share <= 0 else ray_pixel(card, eye + share * (through - eye) - card.centre)


def _place(screen: Screen, card: Camera, hand: Floats[D3], larger: float) -> None:
    """Stand a screen behind the hand as the camera sees it."""
    away = float(card.to_camera(hand)[2])
    depth = max(away, 0.1) + larger * _BEHIND
    kept = screen.depth.get(card.name)
    if kept is not None and kept - 0.10 * larger > away > kept - 0.24 * larger:
        depth = kept  # stands still while the hand stays in front of it
    screen.depth[card.name] = depth
    image = screen.image
    image.render_width, image.render_height, image.position = plane_of(card, depth)
    image.wxyz = quaternion_wxyz(card.rotation.T)


def plane_of(card: Camera, depth: float) -> tuple[float, float, Floats[D3]]:
    """Return width and height [m] and middle (world [m]) of what a camera's image covers at a depth [m]: exact for a pinhole."""
    (width, height), matrix = card.size, card.matrix
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    middle = np.array(
        [(width / 2 - cx - 0.5) * depth / fx, (height / 2 - cy - 0.5) * depth / fy, depth]
    )
    return depth * width / fx, depth * height / fy, card.centre + middle @ card.rotation


# ---- Looking through a camera


_NEAR_M = 1e-4
"""to the point that is looked at, of the whole image: an eye that far off sees a hand at half a metre 0.02 % larger"""
_NOTCHES = 3.0
"""the enlargement grows with this power of the nearness: viser's wheel goes 5 % nearer a notch, which enlarges by 17 %"""
_LEFT_M = 1e-3
"""an eye that far from the camera's centre sees hand and picture apart: 0.5 px at 1000 px of focal length and half a metre"""
_SETTLED_S = 1.0
"""a page does within this what it is told"""
_INSIDE = 0.03
"""share of the window, at its edges, that a hand that is followed keeps out of"""
_FREE_M = (0.01, 1e4)
"""how near and far the point looked at may be of who looks freely: viser's own bounds"""


@dataclass(frozen=True)
class _SentView:
    """What a page was told to look at."""

    when: float
    """[s]"""
    direction: Floats[D3]
    """to the point looked at [m]"""
    zoom: Zoom
    follows: bool


@dataclass
class CameraView:
    """How one page looks through a camera."""

    card: Camera
    zoom: Zoom
    aspect: float
    follows: bool = True
    """it shows the hand wherever that goes; until the user chooses what to see"""
    left: bool = False
    """the user walked out of the camera"""
    task: str = ""
    """what the user is to do in it, in words"""
    sent: deque[_SentView] = field(default_factory=lambda: deque(maxlen=32))

    @property
    def words(self) -> str:
        """The line about it."""
        name = html.escape(self.card.name)
        words, colour = f"<b>{name}</b>, {self.zoom.times:.1f} ×", "#56b4e9"
        if self.follows:
            words += ", follows the {kind}"
        if self.left:
            words, colour = f"<b>You left {name}:</b> C goes back", "#e69f00"
        if self.task:
            words += f"<br>{html.escape(self.task)}"
        return bordered(words, colour)

    @property
    def eye(self) -> Camera:
        return eye(self.card, self.zoom, self.aspect)


# ---- Cameras as frusta with small images, marking a box in one, which frames were shown a moment ago, and the cloud


class CameraRig:
    """The cameras as frusta with small images, and their names."""

    def __init__(self, server: viser.ViserServer, name: str, session: SessionSnapshot) -> None:
        self.cards = {card.name: card for card in session.cameras}
        self.frusta: dict[str, viser.CameraFrustumHandle] = {}
        self.labels: dict[str, viser.LabelHandle] = {}
        self.frame: int | None = None
        """what the small images are of"""
        server.scene.add_frame(name, show_axes=False)
        for card in session.cameras:
            width, height = card.size
            self.frusta[card.name] = server.scene.add_camera_frustum(
                f"{name}/{card.name}", fov=1.0, aspect=width / height, thickness=1.5, thickness_units="screen",
                color=(150, 158, 168), image=np.full((60, 80, 3), 40, np.uint8), format="jpeg", cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self.labels[card.name] = server.scene.add_label(f"{name}/{card.name}/label", card.name)
        self.move(session)

    def move(self, session: SessionSnapshot) -> None:
        """Put the cameras where they are now: one may have been corrected."""
        for card in session.cameras:
            self.cards[card.name], frustum = card, self.frusta[card.name]
            frustum.fov = float(2 * np.arctan(card.size[1] / 2 / card.matrix[1, 1]))
            frustum.wxyz, frustum.position = quaternion_wxyz(card.rotation.T), card.centre

    def size(self, hand: Floats[D3]) -> None:
        """Draw the cameras as large as they may be before a hand at `hand` [m]."""
        for name, frustum in self.frusta.items():
            card = self.cards[name]
            down, depth = card.size[1] / 2 / card.matrix[1, 1], frustum_depth(card, hand)
            # viser's scale is that of the volume
            frustum.scale = float(depth * np.cbrt(down * down * card.size[0] / card.size[1] / 3))
            self.labels[name].position = (0.0, -1.12 * down * depth, depth)

    def show(self, display: Display) -> None:
        """Apply the display options."""
        for name, frustum in self.frusta.items():
            frustum.visible = self.labels[name].visible = display.cameras
            if not display.images:
                frustum.image = None

    def show_images(self, images: dict[str, Image], frame: int) -> None:
        """Show small images of a frame."""
        self.frame = frame
        for name, image in images.items():
            self.frusta[name].image = image

    def clear_late(self, moments: Moments) -> None:
        """Show no small images of a frame that was shown too long ago, until others come."""
        if self.frame is not None and not moments.fits(self.frame):
            self.frame = None
            for frustum in self.frusta.values():
                frustum.image = None


def pixel_box(
    client_camera: viser.CameraHandle,
    card: Camera,
    corners: tuple[tuple[float, float], tuple[float, float]],
) -> Box | None:
    """Return x, y, w, h [px] in a camera's undistorted image of a rectangle dragged over a view from its centre.

    corners: opposite ones, as shares of the window. None for a rectangle beside the image.
    """
    view = window_camera(client_camera)
    across, down = (np.array(corners) * view.size - 0.5).T
    places = [ray_pixel(card, view.rays(np.array([x, y]))) for x in across for y in down]
    if None in places:
        return None
    low, high = np.min(places, axis=0), np.max(places, axis=0)  # type: ignore[arg-type]
    low = np.clip(np.round(low), 0, np.array(card.size) - 1)
    high = np.clip(np.round(high), 0, card.size)
    x, y, width, height = np.concatenate([low, high - low]).astype(int).tolist()
    return (x, y, width, height) if width > 1 and height > 1 else None


# ---- Which frames were shown a moment ago: a picture comes later than the hand of its frame


_MOMENT_S = 0.3
"""the engine paints every 0.08 s, while it tracks every 0.25 s; what is older would deceive"""


@dataclass
class Moments:
    """The frame shown, and when others gave way to the next."""

    frame: int | None = None
    _left: dict[int, float] = field(default_factory=dict)
    """by frame [s]"""

    def show(self, frame: int) -> None:
        """Another frame is shown, or the same again."""
        now = time.monotonic()
        if self.frame is not None and self.frame != frame:
            self._left[self.frame] = now
        self._left = {f: when for f, when in self._left.items() if now - when < _MOMENT_S}
        self.frame = frame

    def fits(self, frame: int | None) -> bool:
        """Return whether what was made of a frame may be seen now: of the one shown, or, in motion, of one just before."""
        if frame is None or frame == self.frame:
            return frame is not None
        return time.monotonic() - self._left.get(frame, -_MOMENT_S) < _MOMENT_S


# ---- The cloud of the frame shown: points coloured by their distance to the model, by their own colour, or plain


_PLAIN = (225, 228, 232)


class CloudView:
    """The points and the snapshot that they are of."""

    def __init__(self, server: viser.ViserServer) -> None:
        """Add the points, hidden until the first ones come."""
        self.points = server.scene.add_point_cloud(
            "/cloud/points", np.zeros((0, 3), np.float32), _PLAIN, point_shape="circle", precision="float32", point_shading="flat", visible=False,
        )  # fmt: skip
        self.cloud: CloudSnapshot | None = None
        self._lock = threading.RLock()
        """frames come on one thread, display options on others: the colours shown are of the latest of both"""

    def take(self, cloud: CloudSnapshot, display: Display) -> None:
        """Take a frame's cloud; where only the hand moved, the points stay and their colours change."""
        with self._lock:
            before, self.cloud = self.cloud, cloud
            if before is None or not np.array_equal(before.points, cloud.points):
                self.points.points = cloud.points
            self.colour(display)

    def colour(self, display: Display) -> None:
        """Colour the points as the display options say."""
        with self._lock:
            if self.cloud is not None:
                self.points.colors = cloud_colours(self.cloud, display.cloud_colour)

    def show(self, display: Display, moments: Moments) -> None:
        """Apply the other display options; a cloud of another frame than those shown now is hidden."""
        known = self.cloud is not None and moments.fits(self.cloud.frame)
        put(self.points, visible=display.cloud and known, point_size=1e-3 * display.cloud_size_mm)


def cloud_colours(cloud: CloudSnapshot, how: str) -> Bytes[N, D3]:
    """Return the points' colours; of none, one that stands for any: a page refuses an empty list."""
    if not len(cloud.points):
        return np.array([_PLAIN], np.uint8)
    if how == "own" and cloud.colors is not None:
        return cloud.colors
    if how == "residual" and np.isfinite(cloud.residual_mm).any():
        return residual_colours(cloud.residual_mm)
    return np.tile(np.array(_PLAIN, np.uint8), (len(cloud.points), 1))
