"""Cameras: frusta with live images, looking through one, marking a box in its image."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass, field

import numpy as np
import viser

from handtrack.arrays import D3, Bytes, Floats, H, N, W
from handtrack.geometry.camera import Camera
from handtrack.geometry.rotation import quaternion_wxyz
from handtrack_app.page.page import Display, put
from handtrack_app.page.scene.viewpoint import frustum_depth, ray_pixel, window_camera
from handtrack_app.protocol.palette import residual_colours
from handtrack_app.protocol.snapshots import (
    CloudSnapshot,
    SessionSnapshot,
)


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

    def show_images(self, images: dict[str, Bytes[H, W, D3]], frame: int) -> None:
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
) -> tuple[int, int, int, int] | None:
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
