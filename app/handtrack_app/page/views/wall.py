"""All cameras at once: close pictures of the hand, side by side and as large as the window allows; a click leads into one."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import viser

from handtrack.arrays import D3, Bytes, H, W
from handtrack_app.page.page import Page
from handtrack_app.page.scene.camera_names import CameraNames
from handtrack_app.page.scene.moments import Moments
from handtrack_app.page.scene.viewpoint import Viewpoint, look_from

ALL = "*"
"""what a page looks through that sees all cameras"""
CLOSE = "close"
"""what such a picture is called among what is painted over a camera's image"""
_PLACE = np.array(
    [0.0, 0.0, 1000.0]
)  # [m] where the eye stands: the scene is far behind it, and not drawn
_FOV, _FILLED = 0.6, 0.96  # of the eye [rad]; share of a cell that its picture takes
_SHAPE = 4 / 3  # width by height of a picture, as the engine makes them
_NODE = "/wall"


@dataclass
class _Wall:
    """One page's pictures."""

    images: dict[str, viser.ImageHandle]
    labels: dict[str, viser.LabelHandle]
    aspect: float = 0.0
    shown: bool = True
    frame: int | None = None
    """what the pictures are of"""


@dataclass
class Walls:
    """The pages that see all cameras, or did. Called by viser's threads and the view thread."""

    page: Page
    chosen: Callable[[str, viser.ClientHandle], None] = lambda camera, client: None
    """a camera's picture was clicked"""
    _walls: dict[int, _Wall] = field(default_factory=dict)
    _names: CameraNames = field(default_factory=CameraNames)
    _lock: threading.RLock = field(default_factory=threading.RLock)
    """a picture that comes while its page leaves must not be shown after"""

    def enter(self, client: viser.ClientHandle, cameras: Sequence[str]) -> None:
        """Show a page all cameras."""
        with self._lock:
            here = self.page.server.get_clients()
            self._walls = {one: wall for one, wall in self._walls.items() if one in here}
            wall = self._walls.get(client.client_id)
            if wall is None:
                wall = self._walls[client.client_id] = self._built(client, cameras)
            wall.shown, wall.aspect = True, 0.0
            self._names.write(wall.labels)
            self._lay_out(client, wall)

    def leave(self, client: viser.ClientHandle) -> None:
        """Show it no more."""
        with self._lock:
            wall = self._walls.get(client.client_id)
            if wall is not None and wall.shown:
                wall.shown = False
                for node in (*wall.images.values(), *wall.labels.values()):
                    node.visible = False

    def show(self, pictures: dict[tuple[str, str], Bytes[H, W, D3]], frame: int) -> None:
        """Show the pictures of a frame that came."""
        with self._lock:
            for wall in self._walls.values():
                for camera, image in wall.images.items():
                    picture = pictures.get((camera, CLOSE))
                    if picture is not None and wall.shown:
                        image.image = picture
                        image.visible = wall.labels[camera].visible = True
                        wall.frame = frame

    def clear_late(self, moments: Moments) -> None:
        """Hide pictures of frames that were shown too long ago."""
        with self._lock:
            for wall in self._walls.values():
                for image in wall.images.values() if wall.shown else ():
                    if image.visible and not moments.fits(wall.frame):
                        image.visible = False

    def name(self, names: CameraNames) -> None:
        """Write beside the pictures what stands beside the small ones."""
        with self._lock:
            self._names = names
            for wall in self._walls.values():
                if wall.shown:
                    names.write(wall.labels)

    def _built(self, client: viser.ClientHandle, cameras: Sequence[str]) -> _Wall:
        wall = _Wall({}, {})
        for camera in cameras:
            name = f"{_NODE}/{camera}"
            self.page.everyones.add(name)  # who looks on chooses its own view
            image = client.scene.add_image(
                name, np.full((48, 64, 3), 30, np.uint8), 0.1, 0.1, format="jpeg", cast_shadow=False,
                receive_shadow=False, visible=False,
            )  # fmt: skip
            image.on_click(lambda event, camera=camera: self.chosen(camera, event.client))
            wall.images[camera] = image
            wall.labels[camera] = client.scene.add_label(f"{name}/label", camera, visible=False)

        @client.camera.on_update
        def _(_camera: viser.CameraHandle) -> None:
            with self._lock:
                if wall.shown:
                    self._lay_out(client, wall)

        return wall

    def _lay_out(self, client: viser.ClientHandle, wall: _Wall) -> None:
        """Stand the pictures so that they fill the window, if that has another shape now."""
        shape = client.camera.image_width, client.camera.image_height
        aspect = shape[0] / shape[1] if all(shape) else 1.0
        if abs(aspect - wall.aspect) < 1e-3:
            return
        wall.aspect = aspect
        half = math.tan(_FOV / 2)
        places, width = cells(len(wall.images), aspect)
        with client.atomic():
            for (camera, image), (x, y) in zip(wall.images.items(), places, strict=True):
                image.render_width = 2 * half * width * _FILLED
                image.render_height = image.render_width / _SHAPE
                image.position = _PLACE + (2 * half * x, 2 * half * y, 1.0)
                corner = (-0.47 * image.render_width, 0.46 * image.render_height, 0.0)
                wall.labels[camera].position = corner
        look_from(client, Viewpoint(_PLACE, _PLACE + (0, 0, 1.0), np.array([0, -1.0, 0]), _FOV))


def cells(count: int, aspect: float) -> tuple[list[tuple[float, float]], float]:
    """Return the middles (from the window's own, x right and y down) and the width of as many pictures as large as they can be.

    In heights of the window. aspect: its width by its height.
    """
    best = max(range(1, max(count, 1) + 1), key=lambda columns: _width(count, columns, aspect))
    width, rows = _width(count, best, aspect), math.ceil(count / best)
    places = []
    for i in range(count):
        row, column = divmod(i, best)
        across = min(best, count - row * best)  # pictures of this row
        places.append(
            ((column - (across - 1) / 2) * width, (row - (rows - 1) / 2) * width / _SHAPE)
        )
    return places, width


def _width(count: int, columns: int, aspect: float) -> float:
    return min(aspect / columns, _SHAPE / math.ceil(count / columns))
