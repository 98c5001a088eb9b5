"""What each page looks through: a camera whose picture stands behind the hand. Every page has its own."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
import viser
import viser.transforms as vtf

from handtrack.arrays import D3, Bytes, Floats, H, W
from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Page
from handtrack_app.page.pins.taking_hold import view_card
from handtrack_app.page.scene.moments import Moments
from handtrack_app.page.state import Look
from handtrack_app.page.views.through import Views
from handtrack_app.page.views.wall import ALL, CLOSE, Walls
from handtrack_app.page.views.zoom import ray_pixel
from handtrack_app.protocol.snapshots import CameraCard

_BEHIND = 0.16  # [m] from the hand to the screen: a flat hand cannot touch it
_IN_THE_WAY = ("/cameras", "/ground")
"""of who looks through a camera: its neighbour's picture could stand before the hand"""
_SCREEN = "/screen"
Picture = tuple[str, str]
"""a camera, and what is painted over its image"""
Pixel = tuple[float, float]
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

    def __init__(self, page: Page) -> None:
        self._page = page
        self.views, self.walls = Views(page), Walls(page)
        page.everyones.add(_SCREEN)  # who looks on turns its own picture, too
        self._cards: dict[str, CameraCard] = {}
        self._screens: dict[int, Screen] = {}
        self._lock = threading.RLock()  # each page has one screen, whichever thread redraws
        self._heard_image: viser.ImageHandle | None = None
        self.boxed: set[int] = set()
        """clients that drag a box over the picture, which stays where it is"""
        self.heard: int | None = None
        """the client whose drags over an image are listened to"""

    def fit(self, cards: dict[str, CameraCard]) -> None:
        """Take the cameras of a session."""
        self._cards = cards

    @property
    def anyone(self) -> bool:
        """Whether a page looks through a camera."""
        state = self._page.state
        here = self._page.server.get_clients()
        return any(state.look(client).through in self._cards for client in here)

    def card(self, client: int | None) -> CameraCard | None:
        """Return the camera that a page looks through."""
        return self._cards.get(self._page.state.look(client).through or "")

    def view_axes(self, client: viser.ClientHandle | None) -> Floats[D3, D3] | None:
        """Return the axes, view → world, of the camera that a page looks through, or of its free view."""
        if client is None:
            return None
        card = self.card(client.client_id)
        return view_card(client.camera).rotation if card is None else card.rotation

    def set_through(self, client: viser.ClientHandle, camera: str | None) -> None:
        """Let a page look through a camera, or at what `ALL` see; None: freely, from wherever it is."""
        state, number = self._page.state, client.client_id
        with state.lock:
            state.looks[number] = replace(state.look(number), through=camera)
        self._explain(number)
        card = self.card(number)
        for name in _IN_THE_WAY:
            internals.show_node(client, name, card is None)
        if card is None:
            self.views.leave(client)
        if camera == ALL:
            self.walls.enter(client, tuple(self._cards))
        else:
            self.walls.leave(client)
        if card is not None:
            self.views.enter(client, card)

    def set_paint(self, client: int, paint: str) -> None:
        """Paint something else over what a page sees through its camera."""
        state = self._page.state
        with state.lock:
            state.looks[client] = replace(state.look(client), paint=paint)
        self._explain(client)

    def _explain(self, number: int) -> None:
        """Let a page show what the colours over its picture mean."""
        client, look = self._page.server.get_clients().get(number), self._page.state.look(number)
        if client is not None:
            paint = look.paint if look.through in self._cards else ""
            internals.run_javascript(client, f"document.body.dataset.overlay = {json.dumps(paint)}")

    def pictures(self, field_camera: str | None) -> tuple[Picture, ...]:
        """Return the pictures that the pages show. field_camera: whose field is shown, if any."""
        here = self._page.server.get_clients()
        looks = [self._page.state.look(one) for one in here]
        chosen = [_picture(look, field_camera) for look in looks]
        if any(look.through == ALL for look in looks):
            chosen += [(camera, CLOSE) for camera in self._cards]
        return tuple(dict.fromkeys(one for one in chosen if one is not None))

    def place(self, field_camera: str | None, hand: Floats[D3], larger: float) -> None:
        """Stand the screens behind the hand at `hand` [m]. larger: than a hand."""
        with self._lock:
            here = self._page.server.get_clients()
            self._screens = {one: screen for one, screen in self._screens.items() if one in here}
            state = self._page.state
            with state.lock:
                state.looks = {one: look for one, look in state.looks.items() if one in here}
            for number, client in here.items():
                picture = _picture(state.look(number), field_camera)
                screen = self._screens.get(number)
                if screen is None and picture is not None:
                    screen = self._screens[number] = Screen(_add_screen(client))
                    self._drags_turn(client, screen.image, "left")
                    self._drags_turn(client, screen.image, "right")
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
        screen, card = self._screens.get(client.client_id), self.card(client.client_id)
        if screen is None or card is None:
            return
        self.hush()
        screen.image.remove_drag_callback()
        self._drags_turn(client, screen.image, "right")

        def tell(through: Sequence[float], phase: str) -> None:
            if self._page.state.editor not in (None, client.client_id):
                return
            eye = np.asarray(client.camera.position, dtype=float)
            at = _pixel(card, screen.depth[card.name], eye, np.asarray(through, dtype=float))
            if at is not None:
                pointed(card.name, at, phase)

        # in order, on viser's loop: sent on, and nothing else
        @screen.image.on_drag("left")
        async def _(event: viser.SceneNodeDragEvent[viser.ImageHandle]) -> None:
            if event.phase == "start":
                tell(event.start_position, "start")
            tell(event.end_position, "update" if event.phase == "start" else event.phase)

        @screen.image.on_click
        async def _(event: viser.SceneNodePointerEvent[viser.ImageHandle]) -> None:
            through = np.asarray(event.ray_origin) + np.asarray(event.ray_direction)
            tell(tuple(through), "click")

        self._heard_image, self.heard = screen.image, client.client_id

    def hush(self) -> None:
        """Listen no more: drags turn the view again."""
        image, self._heard_image, heard = self._heard_image, None, self.heard
        self.heard = None
        client = self._page.server.get_clients().get(-1 if heard is None else heard)
        if image is not None and client is not None:
            with suppress(RuntimeError):  # its page has gone
                image.remove_drag_callback()
                image.remove_click_callback()
                self._drags_turn(client, image, "left")
                self._drags_turn(client, image, "right")

    def _drags_turn(
        self, client: viser.ClientHandle, image: viser.ImageHandle, button: internals.DragButton
    ) -> None:
        """Let a drag of the picture move it under the pointer."""

        @image.on_drag(button)
        async def _(event: viser.SceneNodeDragEvent[viser.ImageHandle]) -> None:
            if client.client_id in self.boxed and button == "left":
                return
            card = self.card(client.client_id)
            held = None if card is None else np.asarray(event.start_position) - card.centre
            pixel = None if card is None or held is None else ray_pixel(card, held)
            if pixel is not None:
                self.views.drag(client, pixel, event.end_screen_pos)

    def show(self, images: dict[Picture, Bytes[H, W, D3]], frame: int) -> None:
        """Show the pictures of a frame that came."""
        self.walls.show(images, frame)
        for screen in self._screens.values():
            if screen.picture in images:
                screen.image.image = images[screen.picture]
                screen.image.visible = True
                screen.frame = frame

    def clear_late(self, moments: Moments) -> None:
        """Hide pictures of frames that were shown too long ago."""
        self.walls.clear_late(moments)
        for screen in list(self._screens.values()):
            if screen.image.visible and not moments.fits(screen.frame):
                screen.image.visible = False


def _picture(look: Look, field_camera: str | None) -> Picture | None:
    paint = look.paint if field_camera is None else "field"
    camera = None if look.through == ALL else look.through or field_camera
    return None if camera is None else (camera, paint)


def _pixel(card: CameraCard, depth: float, eye: Floats[D3], through: Floats[D3]) -> Pixel | None:
    """Return where a ray from `eye` through a point (both world [m]) meets a camera's image at `depth` [m]."""
    ahead = card.rotation[:, 2]
    along = float((through - eye) @ ahead)
    share = (depth - float((eye - card.centre) @ ahead)) / along if abs(along) > 1e-9 else -1.0
    if share <= 0:
        return None
    seen = card.matrix @ (card.rotation.T @ (eye + share * (through - eye) - card.centre))
    return float(seen[0] / seen[2]), float(seen[1] / seen[2])


def _add_screen(client: viser.ClientHandle) -> viser.ImageHandle:
    return client.scene.add_image(
        _SCREEN, np.full((48, 64, 3), 30, np.uint8), 0.1, 0.1, format="jpeg", cast_shadow=False,
        receive_shadow=False, visible=False,
    )  # fmt: skip


def _place(screen: Screen, card: CameraCard, hand: Floats[D3], larger: float) -> None:
    """Stand a screen behind the hand as the camera sees it."""
    away = float((hand - card.centre) @ card.rotation[:, 2])
    depth = max(away, 0.1) + larger * _BEHIND
    kept = screen.depth.get(card.name)
    if kept is not None and kept - 0.10 * larger > away > kept - 0.24 * larger:
        depth = kept  # stands still while the hand stays in front of it
    screen.depth[card.name] = depth
    image = screen.image
    image.render_width, image.render_height, image.position = plane_of(card, depth)
    image.wxyz = vtf.SO3.from_matrix(card.rotation).wxyz


def plane_of(card: CameraCard, depth: float) -> tuple[float, float, Floats[D3]]:
    """Return width and height [m] and middle (world [m]) of what a camera's image covers at a depth [m]: exact for a pinhole."""
    (width, height), matrix = card.size, card.matrix
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    middle = np.array(
        [(width / 2 - cx - 0.5) * depth / fx, (height / 2 - cy - 0.5) * depth / fy, depth]
    )
    return depth * width / fx, depth * height / fy, card.centre + card.rotation @ middle
