"""Cameras: frusta with live images, looking through one, marking a box in its image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import viser
import viser.transforms as vtf

from handtrack.arrays import D3, Bytes, Floats, H, W
from handtrack_app.page.scene.moments import Moments
from handtrack_app.page.scene.viewpoint import frustum_depth
from handtrack_app.page.state import Display
from handtrack_app.protocol.snapshots import CameraCard, SessionSnapshot


@dataclass
class CameraRigView:
    """Handles of the cameras."""

    cards: dict[str, CameraCard]
    frusta: dict[str, viser.CameraFrustumHandle]
    labels: dict[str, viser.LabelHandle]
    frame: int | None = None
    """what the small images are of"""


def add_cameras(
    server: viser.ViserServer, name: str, session: SessionSnapshot, hand: Floats[D3]
) -> CameraRigView:
    """Add a frustum for each camera. hand: where the hand is at first [m]."""
    frusta, labels = {}, {}
    server.scene.add_frame(name, show_axes=False)
    for card in session.cameras:
        width, height = card.size
        fov = 2 * np.arctan(height / 2 / card.matrix[1, 1])
        frusta[card.name] = server.scene.add_camera_frustum(
            f"{name}/{card.name}", fov=float(fov), aspect=width / height, thickness=1.5, thickness_units="screen",
            color=(150, 158, 168), image=np.full((60, 80, 3), 40, np.uint8), format="jpeg",
            wxyz=vtf.SO3.from_matrix(card.rotation).wxyz, position=card.centre, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        labels[card.name] = server.scene.add_label(f"{name}/{card.name}/label", card.name)
    view = CameraRigView({card.name: card for card in session.cameras}, frusta, labels)
    size_cameras(view, hand)
    return view


def size_cameras(view: CameraRigView, hand: Floats[D3]) -> None:
    """Draw the cameras as large as they may be before a hand at `hand` [m]."""
    for name, frustum in view.frusta.items():
        card = view.cards[name]
        (width, height), focal = card.size, card.matrix[1, 1]
        down, depth = height / 2 / focal, frustum_depth(card, hand)
        volume = np.cbrt(down * down * width / height / 3)  # viser's scale is that of the volume
        frustum.scale = float(depth * volume)
        view.labels[name].position = (0.0, -1.12 * down * depth, depth)


def show_cameras(view: CameraRigView, display: Display) -> None:
    """Apply the display options to the frusta."""
    for name, frustum in view.frusta.items():
        frustum.visible = display.cameras
        view.labels[name].visible = frustum.visible
        if not display.images:
            frustum.image = None


def update_thumbnails(view: CameraRigView, images: dict[str, Bytes[H, W, D3]], frame: int) -> None:
    """Put small images of a frame onto the frusta."""
    view.frame = frame
    for name, image in images.items():
        if name in view.frusta:
            view.frusta[name].image = image


def clear_late(view: CameraRigView, moments: Moments) -> None:
    """Show no small images of a frame that was shown too long ago, until others come."""
    if view.frame is not None and not moments.fits(view.frame):
        view.frame = None
        for frustum in view.frusta.values():
            frustum.image = None


def bare(display: Display) -> Display:
    """Return the display options without all that stands before the image."""
    return replace(display, mode="", cloud=False, ghosts=False, handle=False, truth=False)


def pixel_box(
    client_camera: viser.CameraHandle,
    card: CameraCard,
    corners: tuple[tuple[float, float], tuple[float, float]],
) -> tuple[int, int, int, int] | None:
    """Return x, y, w, h [px] in a camera's undistorted image of a rectangle dragged over a view from its centre.

    corners: opposite ones, as shares of the window. None for a rectangle beside the image.
    """
    up = np.tan(0.5 * float(client_camera.fov))
    across = up * float(client_camera.aspect)
    turn = vtf.SO3(np.asarray(client_camera.wxyz, dtype=float)).as_matrix()
    places = []
    for x, y in (
        (a, b) for a in (corners[0][0], corners[1][0]) for b in (corners[0][1], corners[1][1])
    ):
        ray = card.rotation.T @ turn @ np.array([(2 * x - 1) * across, (2 * y - 1) * up, 1.0])
        if ray[2] <= 1e-6:
            return None
        places.append((card.matrix @ (ray / ray[2]))[:2])
    low, high = np.min(places, axis=0), np.max(places, axis=0)
    low = np.clip(np.round(low), 0, np.array(card.size) - 1)
    high = np.clip(np.round(high), 0, card.size)
    width, height = (high - low).astype(int)
    return (int(low[0]), int(low[1]), int(width), int(height)) if width > 1 and height > 1 else None
