"""How each page looks through a camera: it stands in the camera's centre; the wheel enlarges, a drag of the picture moves it.

The page itself turns and dollies about a point that is looked at. That point stands so near that neither moves the eye by
anything that could be seen: how far it is tells the enlargement, the way to it what is aimed at. So the browser answers at once,
and nothing that it does meanwhile can be lost or counted twice.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import viser
import viser.transforms as vtf

from handtrack.arrays import D3, Floats, N
from handtrack_app import viser_internals as internals
from handtrack_app.page.page import Page
from handtrack_app.page.views.zoom import (
    MOST,
    Box,
    Eye,
    Pixel,
    Place,
    Zoom,
    around,
    box_of,
    eye,
    pixel_ray,
    ray_pixel,
    towards,
    whole,
    with_pixel_at,
)
from handtrack_app.protocol.snapshots import CameraCard

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
class _Told:
    """What a page was told to look at."""

    when: float
    """[s]"""
    way: Floats[D3]
    """to the point looked at [m]"""
    zoom: Zoom
    follows: bool


@dataclass
class Through:
    """How one page looks through a camera."""

    card: CameraCard
    zoom: Zoom
    aspect: float
    follows: bool = True
    """it shows the hand wherever that goes; until the user chooses what to see"""
    left: bool = False
    """the user walked out of the camera"""
    told: deque[_Told] = field(default_factory=lambda: deque(maxlen=32))

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

    def enter(self, client: viser.ClientHandle, card: CameraCard) -> None:
        """Let a page look through a camera, at the hand if there is one."""
        with self._lock:
            self._listen(client)
            shape = client.camera.image_width, client.camera.image_height
            through = Through(card, whole(card), shape[0] / shape[1] if all(shape) else 1.0)
            self._through[client.client_id] = through
            through.zoom = self._at_hand(through) or through.zoom
            self._stand(client, through)

    def leave(self, client: viser.ClientHandle) -> None:
        """Let a page look freely again, from wherever it is put next."""
        with self._lock:
            here = self._page.server.get_clients()
            self._through = {one: view for one, view in self._through.items() if one in here}
            if self._through.pop(client.client_id, None) is not None:
                internals.send(client, internals.SetCameraMaxOrbitDistanceMessage(_FREE_M[1]))
                internals.send(client, internals.SetCameraMinOrbitDistanceMessage(_FREE_M[0]))
                self.changed(client, None)

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

    def zoom_by(self, client: viser.ClientHandle, factor: float, place: Place = (0.5, 0.5)) -> None:
        """Enlarge what is at a place of the window, which stays there."""
        self._change(client, lambda view: towards(view.card, view.zoom, view.aspect, place, factor))

    def fit(self, client: viser.ClientHandle) -> None:
        """Show the whole image."""
        self._change(client, lambda view: whole(view.card))

    def to_hand(self, client: viser.ClientHandle) -> None:
        """Show the hand, and follow it."""
        self._change(client, lambda view: self._at_hand(view) or whole(view.card), follows=True)

    def to_box(self, client: viser.ClientHandle, one: Place, other: Place) -> None:
        """Show what is between two places of the window."""

        def zoomed(view: Through) -> Zoom:
            corners = [ray_pixel(view.card, view.eye.ray(place)) for place in (one, other)]
            if None in corners:
                return view.zoom
            low, high = np.min(corners, axis=0), np.max(corners, axis=0)  # type: ignore[arg-type]
            box: Box = (low[0], low[1], high[0] - low[0], high[1] - low[1])
            return around(view.card, box, view.aspect, air=1.0)

        self._change(client, zoomed)

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

        @client.scene.on_click(modifier="cmd/ctrl")
        def _(event: viser.SceneClickEvent) -> None:
            self.zoom_by(client, 2.0, event.screen_pos)

        @client.scene.on_click(modifier="cmd/ctrl+shift")
        def _(event: viser.SceneClickEvent) -> None:
            self.zoom_by(client, 0.5, event.screen_pos)

        @client.scene.on_rect_select(modifier="cmd/ctrl")
        def _(event: viser.SceneRectSelectEvent) -> None:
            self.to_box(client, event.screen_min, event.screen_max)

    def _moved(self, client: viser.ClientHandle, camera: viser.CameraHandle) -> None:
        """Take what the browser tells of its own camera."""
        with self._lock:
            through = self._through.get(client.client_id)
            if through is None or not camera.image_height:
                return
            way = np.asarray(camera.look_at) - np.asarray(camera.position)
            if abs(camera.aspect / through.aspect - 1) > 1e-3:  # the window got another shape
                through.aspect = camera.aspect
                if through.follows:
                    through.zoom = self._at_hand(through) or through.zoom
                if not through.left:
                    self._stand(client, through)
                return
            away = float(np.linalg.norm(np.asarray(camera.position) - through.card.centre))
            if away > _LEFT_M:
                if not through.left and time.monotonic() - through.told[-1].when > _SETTLED_S:
                    through.left = True
                    self.changed(client, through)
                return
            near = float(np.linalg.norm(way))
            ahead = vtf.SO3(np.asarray(camera.wxyz, dtype=float)).as_matrix()[:, 2]
            if near < 1e-9 or way @ ahead < (1 - 1e-6) * near:
                return  # half of what it was told: the other half comes with the next frame that it draws
            self._take(client, through, way, near)
            if abs(camera.fov - through.eye.fov) > 1e-5:
                internals.send(client, internals.SetCameraFovMessage(through.eye.fov))

    def _take(
        self, client: viser.ClientHandle, through: Through, way: Floats[D3], near: float
    ) -> None:
        """Take what a page looks at: what it was told last, or what the user turned it to."""
        before = through.zoom, through.follows, through.left
        told = [one for one in through.told if np.linalg.norm(way - one.way) < 1e-3 * near]
        now = time.monotonic()
        if told and told[-1] is through.told[-1]:
            through.zoom, through.follows = told[-1].zoom, told[-1].follows
        elif told and now - told[-1].when < _SETTLED_S:
            return  # of what it was told before; what it was told last is under way
        else:
            aim = ray_pixel(through.card, way)
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
        """Put a page's eye where its view says. The handle's own setters leave out what they take for too small a step."""
        seen, centre = through.eye, through.card.centre
        way = seen.rotation[:, 2] * _NEAR_M / through.zoom.times ** (1 / _NOTCHES)
        through.told.append(_Told(time.monotonic(), way, through.zoom, through.follows))
        near = _NEAR_M / MOST ** (1 / _NOTCHES)
        with client.atomic():
            for message in (
                internals.SetCameraMinOrbitDistanceMessage(near),
                internals.SetCameraUpDirectionMessage(_three(-seen.rotation[:, 1])),
                internals.SetCameraPositionMessage(_three(centre)),
                internals.SetCameraLookAtMessage(_three(centre + way)),
                internals.SetCameraMaxOrbitDistanceMessage(_NEAR_M),
                internals.SetCameraFovMessage(seen.fov),  # the page answers to this one: last
            ):
                internals.send(client, message)
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
        looks = through.eye
        for corner in ((x, y), (x + width, y + height)):
            inside = np.clip(corner, 0.0, np.array(through.card.size) - 1.0)
            place = looks.place(pixel_ray(through.card, (float(inside[0]), float(inside[1]))))
            if place is None or not all(_INSIDE <= share <= 1 - _INSIDE for share in place):
                return False
        return 0.5 < through.zoom.times / wanted.times < 2.0


def _three(vector: Floats) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in vector)
    return x, y, z
