"""What each page looks through: a camera whose picture stands behind the hand. Every page has its own."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
import viser

from handtrack.arrays import D3, Bytes, Floats, H, N, W
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import matrix_from_quaternion, quaternion_wxyz
from handtrack_app import viser_internals as internals
from handtrack_app.page.html import picture as as_html
from handtrack_app.page.html import pictures
from handtrack_app.page.page import Look, Page, put
from handtrack_app.page.scene.camera_view import CameraNames, Moments
from handtrack_app.page.scene.viewpoint import Viewpoint, look_from
from handtrack_app.page.scene.zoom import (
    MOST,
    Eye,
    Pixel,
    Place,
    Zoom,
    around,
    box_of,
    enlarged,
    eye,
    ray_pixel,
    whole,
    with_pixel_at,
)

_BEHIND = 0.16  # [m] from the hand to the screen: a flat hand cannot touch it
_IN_THE_WAY = ("/cameras", "/ground")
"""of who looks through a camera: its neighbour's picture could stand before the hand"""
_SCREEN = "/screen"
Picture = tuple[str, str]
"""a camera, and what is painted over its image"""
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

    def __init__(self, page: Page, names: CameraNames, cards: dict[str, Camera]) -> None:
        """cards: the session's cameras, as they are now."""
        self._page, self._cards = page, cards
        self.views, self.close_ups = Views(page), CloseUps(page, names)
        self._screens: dict[int, Screen] = {}
        self._lock = threading.RLock()  # each page has one screen, whichever thread redraws
        self._pointed: Pointed = lambda camera, pixel, phase: None
        self.boxed: set[int] = set()
        """clients that drag a box over the picture, which stays where it is"""
        self.heard: int | None = None
        """the client whose drags over an image are listened to"""

    @property
    def anyone(self) -> bool:
        """Whether a page looks through a camera."""
        state = self._page.state
        here = self._page.server.get_clients()
        return any(state.look(client).through in self._cards for client in here)

    def card(self, client: int | None) -> Camera | None:
        """Return the camera that a page looks through."""
        return self._cards.get(self._page.state.look(client).through or "")

    def set_through(self, client: viser.ClientHandle, camera: str | None) -> None:
        """Let a page look through a camera, or at what `ALL` see; None: freely, from wherever it is."""
        state, number = self._page.state, client.client_id
        with state.lock:
            state.views[number] = replace(state.look(number), through=camera)
        self._explain(number)
        card = self.card(number)
        for name in _IN_THE_WAY:
            shown = internals.messages.SetSceneNodeVisibilityMessage(name, card is None)
            internals.send(client, shown)
        (self.close_ups.enter if camera == ALL else self.close_ups.leave)(client)
        if card is None:
            self.views.leave(client)
        else:
            self.views.enter(client, card)

    def set_paint(self, client: int, paint: str) -> None:
        """Paint something else over what a page sees through its camera."""
        state = self._page.state
        with state.lock:
            state.views[client] = replace(state.look(client), paint=paint)
        self._explain(client)

    def _explain(self, number: int) -> None:
        """Let a page show what the colours over its picture mean."""
        client, look = self._page.server.get_clients().get(number), self._page.state.look(number)
        if client is not None:
            paint = look.paint if look.through in self._cards else ""
            internals.run_javascript(client, f"document.body.dataset.overlay = {json.dumps(paint)}")

    def pictures(self, field: bool) -> tuple[Picture, ...]:
        """Return the pictures that the pages show. field: the model's field in place of what is painted else."""
        here = self._page.server.get_clients()
        views = [self._page.state.look(one) for one in here]
        chosen = [_picture(look, field) for look in views]
        if any(look.through == ALL for look in views):
            chosen += [(camera, CLOSE) for camera in self._cards]
        return tuple(dict.fromkeys(one for one in chosen if one is not None))

    def place(self, field: bool, hand: Floats[D3], larger: float) -> None:
        """Stand the screens behind the hand at `hand` [m]. field: as for `pictures`; larger: than a hand."""
        with self._lock:
            here = self._page.server.get_clients()
            self._screens = self._page.present(self._screens)
            state = self._page.state
            with state.lock:
                state.views = self._page.present(state.views)
            for number, client in here.items():
                picture = _picture(state.look(number), field)
                screen = self._screens.get(number)
                if screen is None and picture is not None:
                    hidden = client.scene.add_image(
                        _SCREEN, np.full((48, 64, 3), 30, np.uint8), 0.1, 0.1, format="jpeg", cast_shadow=False,
                        receive_shadow=False, visible=False,
                    )  # fmt: skip
                    screen = self._screens[number] = Screen(hidden)
                    self._hear_drags(client, screen.image, "left")
                    self._hear_drags(client, screen.image, "right")
                if screen is None:
                    continue
                if picture != screen.picture:
                    screen.image.visible = False  # until its picture comes
                screen.picture = picture
                card = None if picture is None else self._cards.get(picture[0])
                if card is not None:
                    _place(screen, card, hand, larger)

    def listen(self, client: viser.ClientHandle, pointed: Pointed) -> None:
        """Tell where a page drags or clicks on the camera's image that it sees, until `hush`."""
        self.hush()
        screen, number = self._screens.get(client.client_id), client.client_id
        if screen is None or self.card(number) is None:
            return
        self.heard, self._pointed = number, pointed

        # in order, on viser's loop: sent on, and nothing else
        @screen.image.on_click
        async def _(event: viser.SceneNodePointerEvent[viser.ImageHandle]) -> None:
            self._report(client, np.add(event.ray_origin, event.ray_direction), "click")

    def hush(self) -> None:
        """Listen no more: drags turn the view again."""
        screen, self.heard = self._screens.get(-1 if self.heard is None else self.heard), None
        if screen is not None:
            with suppress(RuntimeError):  # its page has gone
                screen.image.remove_click_callback()

    def _report(self, client: viser.ClientHandle, through: Floats[D3], phase: str) -> None:
        screen, card = self._screens.get(client.client_id), self.card(client.client_id)
        if screen is not None and card is not None:
            eye = np.asarray(client.camera.position, dtype=float)
            at = _pixel(card, screen.depth[card.name], eye, through)
            if at is not None:
                self._pointed(card.name, at, phase)

    def _hear_drags(
        self, client: viser.ClientHandle, image: viser.ImageHandle, button: internals.DragButton
    ) -> None:
        """Let a drag of the picture move it under the pointer; or tell of it where somebody listens."""
        number = client.client_id

        @image.on_drag(button)
        async def _(event: viser.SceneNodeDragEvent[viser.ImageHandle]) -> None:
            if button == "left" and number == self.heard:
                begins = event.phase == "start"
                if begins:
                    self._report(client, np.asarray(event.start_position, float), "start")
                phase = "update" if begins else event.phase
                self._report(client, np.asarray(event.end_position, float), phase)
                return
            if number in self.boxed and button == "left":
                return
            card = self.card(number)
            held = None if card is None else np.asarray(event.start_position) - card.centre
            pixel = None if card is None or held is None else ray_pixel(card, held)
            if pixel is not None:
                self.views.drag(client, pixel, event.end_screen_pos)

    def show(self, images: dict[Picture, Bytes[H, W, D3]], frame: int) -> None:
        """Show the pictures of a frame that came."""
        self.close_ups.show(images, frame)
        for screen in self._screens.values():
            if screen.picture in images:
                screen.image.image = images[screen.picture]
                screen.image.visible = True
                screen.frame = frame

    def clear_late(self, moments: Moments) -> None:
        """Hide pictures of frames that were shown too long ago."""
        self.close_ups.clear_late(moments)
        for screen in list(self._screens.values()):
            if screen.image.visible and not moments.fits(screen.frame):
                screen.image.visible = False


def _picture(look: Look, field: bool) -> Picture | None:
    if look.through in (None, ALL):
        return None
    return look.through, "field" if field else look.paint


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
class Through:
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
    def eye(self) -> Eye:
        return eye(self.card, self.zoom, self.aspect)


class Views:
    """The pages' views through cameras. Called by viser's threads, its loop, and the view thread."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self._through: dict[int, Through] = {}
        self._heard: set[int] = set()
        self._hand: tuple[Floats[N, D3], Floats[N]] | None = None
        self._lock = threading.RLock()
        self.changed: Callable[[viser.ClientHandle, Through | None], None] = lambda client, view: (
            None
        )
        """told of every change of a page's view; None: it looks freely"""

    def of(self, client: int | None) -> Through | None:
        """Return how a page looks through a camera; None: it looks freely."""
        return None if client is None else self._through.get(client)

    def enter(self, client: viser.ClientHandle, card: Camera) -> None:
        """Let a page look through a camera, at the hand if there is one."""
        with self._lock:
            self._listen(client)
            shape = client.camera.image_width, client.camera.image_height
            through = Through(card, whole(card), shape[0] / shape[1] if all(shape) else 1.0)
            self._through[client.client_id] = through
            through.zoom = self._at_hand(through) or through.zoom
            self._stand(client, through)

    def ask(self, client: viser.ClientHandle, task: str) -> None:
        """Say beside a page's view what is to be done in it; no more, for no words."""
        with self._lock:
            through = self._through.get(client.client_id)
            if through is not None:
                through.task = task
                self.changed(client, through)

    def leave(self, client: viser.ClientHandle) -> None:
        """Let a page look freely again, from wherever it is put next."""
        with self._lock:
            self._through = self._page.present(self._through)
            if self._through.pop(client.client_id, None) is not None:
                messages, (least, most) = internals.messages, _FREE_M
                internals.send(client, messages.SetCameraMaxOrbitDistanceMessage(most))
                internals.send(client, messages.SetCameraMinOrbitDistanceMessage(least))
                self.changed(client, None)

    def look_freely(self, client: viser.ClientHandle, view: Viewpoint) -> None:
        """Move a page's view, unless it looks through a camera by now."""
        with self._lock:
            if client.client_id not in self._through:
                look_from(client, view)

    def show_hand(self, points: Floats[N, D3], radii: Floats[N]) -> None:
        """Take where the hand is: balls, world [m]. Views that follow it turn where it would be cut off."""
        with self._lock:
            self._hand = points, radii
            here = self._page.server.get_clients()
            for number, through in list(self._through.items()):
                wanted = self._at_hand(through) if through.follows and not through.left else None
                if wanted is not None and number in here and not self._shows(through, wanted):
                    through.zoom = wanted
                    self._stand(here[number], through)

    # ---- what keys and buttons do

    def zoom_by(self, client: viser.ClientHandle, factor: float) -> None:
        """Enlarge what is in the window's middle."""
        self._change(client, lambda view: enlarged(view.card, view.zoom, factor))

    def fit(self, client: viser.ClientHandle) -> None:
        """Show the whole image."""
        self._change(client, lambda view: whole(view.card))

    def to_hand(self, client: viser.ClientHandle) -> None:
        """Show the hand, and follow it."""
        self._change(client, lambda view: self._at_hand(view) or whole(view.card), follows=True)

    def drag(self, client: viser.ClientHandle, held: Pixel, place: Place) -> None:
        """Turn so that a pixel that is held is at a place of the window."""
        self._change(
            client, lambda view: with_pixel_at(view.card, view.zoom, view.aspect, held, place)
        )

    def _change(
        self,
        client: viser.ClientHandle,
        zoomed: Callable[[Through], Zoom],
        follows: bool = False,
    ) -> None:
        with self._lock:
            through = self._through.get(client.client_id)
            if through is None:
                return
            through.zoom, through.follows, through.left = zoomed(through), follows, False
            self._stand(client, through)

    # ---- what the page does by itself

    def _listen(self, client: viser.ClientHandle) -> None:
        if client.client_id in self._heard:
            return
        self._heard.add(client.client_id)

        # in order, on viser's loop: a little arithmetic
        @client.camera.on_update
        async def _(camera: viser.CameraHandle) -> None:
            self._moved(client, camera)

    def _moved(self, client: viser.ClientHandle, camera: viser.CameraHandle) -> None:
        """Take what the browser tells of its own camera."""
        with self._lock:
            through = self._through.get(client.client_id)
            if through is None or not camera.image_height:
                return
            direction = np.asarray(camera.look_at) - np.asarray(camera.position)
            if abs(camera.aspect / through.aspect - 1) > 1e-3:  # the window got another shape
                through.aspect = camera.aspect
                if through.follows:
                    through.zoom = self._at_hand(through) or through.zoom
                if not through.left:
                    self._stand(client, through)
                return
            away = float(np.linalg.norm(np.asarray(camera.position) - through.card.centre))
            if away > _LEFT_M:
                if not through.left and time.monotonic() - through.sent[-1].when > _SETTLED_S:
                    through.left = True
                    self.changed(client, through)
                return
            near = float(np.linalg.norm(direction))
            ahead = matrix_from_quaternion(camera.wxyz)[:, 2]
            if near < 1e-9 or direction @ ahead < (1 - 1e-6) * near:
                return  # half of what it was told: the other half comes with the next frame that it draws
            self._take(client, through, direction, near)
            if abs(camera.fov - through.eye.fov) > 1e-5:
                internals.send(client, internals.messages.SetCameraFovMessage(through.eye.fov))

    def _take(
        self, client: viser.ClientHandle, through: Through, direction: Floats[D3], near: float
    ) -> None:
        """Take what a page looks at: what it was told last, or what the user turned it to."""
        before = through.zoom, through.follows, through.left
        sent = [
            one for one in through.sent if np.linalg.norm(direction - one.direction) < 1e-3 * near
        ]
        now = time.monotonic()
        if sent and sent[-1] is through.sent[-1]:
            through.zoom, through.follows = sent[-1].zoom, sent[-1].follows
        elif sent and now - sent[-1].when < _SETTLED_S:
            return  # of what it was told before; what it was told last is under way
        else:
            aim = ray_pixel(through.card, direction)
            if aim is None:
                return
            times = (_NEAR_M / near) ** _NOTCHES
            through.zoom = Zoom(aim, float(np.clip(times, 1.0, MOST)))
            through.follows = False
        through.left = False
        if before != (through.zoom, through.follows, through.left):
            self.changed(client, through)

    # ---- inside

    def _stand(self, client: viser.ClientHandle, through: Through) -> None:
        """Put a page's eye where its view says."""
        observed, centre = through.eye, through.card.centre
        direction = observed.rotation[:, 2] * _NEAR_M / through.zoom.times ** (1 / _NOTCHES)
        through.sent.append(_SentView(time.monotonic(), direction, through.zoom, through.follows))
        view = Viewpoint(centre, centre + direction, -observed.rotation[:, 1], observed.fov)
        look_from(client, view, (_NEAR_M / MOST ** (1 / _NOTCHES), _NEAR_M))
        self.changed(client, through)

    def _at_hand(self, through: Through) -> Zoom | None:
        box = None if self._hand is None else box_of(through.card, *self._hand)
        return None if box is None else around(through.card, box, through.aspect)

    def _shows(self, through: Through, wanted: Zoom) -> bool:
        """Return whether the hand is seen whole, and not much smaller than it could be."""
        box = None if self._hand is None else box_of(through.card, *self._hand)
        if box is None:
            return True
        x, y, width, height = box
        views = through.eye
        for corner in ((x, y), (x + width, y + height)):
            inside = np.clip(corner, 0.0, np.array(through.card.size) - 1.0)
            place = views.place(through.card.rays(inside))
            if place is None or not all(_INSIDE <= share <= 1 - _INSIDE for share in place):
                return False
        return 0.5 < through.zoom.times / wanted.times < 2.0


# ---- All cameras at once: close pictures of the hand in a panel over the scene


ALL = "*"
"""what a page looks through that sees all cameras"""
CLOSE = "close"
"""what such a picture is called among what is painted over a camera's image"""


@dataclass
class CloseUps:
    """The pages that see all cameras. Called by viser's threads and the view thread."""

    page: Page
    names: CameraNames
    _opened: dict[int, tuple[viser.PanelHandle, viser.GuiHtmlHandle]] = field(default_factory=dict)
    """by client"""
    _pictures: dict[str, str] = field(default_factory=dict)
    """by camera, as HTML"""
    _frame: int | None = None
    """what the pictures are of"""

    def enter(self, client: viser.ClientHandle) -> None:
        """Show a page all cameras."""
        self._opened = self.page.present(self._opened)
        if client.client_id not in self._opened:
            panel = client.gui.add_panel()
            with panel.add_tab("All cameras"):
                self._opened[client.client_id] = panel, client.gui.add_html("")
            panel.float(x=16, y=16, width=560)
            self.draw()

    def leave(self, client: viser.ClientHandle) -> None:
        """Show it no more."""
        if (opened := self._opened.pop(client.client_id, None)) is not None:
            opened[0].remove()

    def show(self, images: dict[Picture, Bytes[H, W, D3]], frame: int) -> None:
        """Show the pictures of a frame that came."""
        close = {
            camera: as_html(one, camera)
            for (camera, paint), one in images.items()
            if paint == CLOSE
        }
        if close:
            self._pictures, self._frame = close, frame
            self.draw()

    def clear_late(self, moments: Moments) -> None:
        """Hide pictures of a frame that was shown too long ago."""
        if self._pictures and not moments.fits(self._frame):
            self._pictures = {}
            self.draw()

    def draw(self) -> None:
        """Show the pictures, with the cameras' names."""
        named = {self.names.of(camera): one for camera, one in self._pictures.items()}
        for _, widget in list(self._opened.values()):
            put(widget, content=pictures(named, "handtrack-picture"))
