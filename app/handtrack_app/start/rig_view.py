"""Cameras of a calibration in the scene, each with its video's first image: a wrong order or pose is seen at once."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import viser
import viser.transforms as vtf

from handtrack.arrays import D3, Bytes, H, W
from handtrack.capture.images.video import VideoFile
from handtrack.errors import HandtrackError
from handtrack.geometry.camera import CameraRig
from handtrack.geometry.triangulation import triangulated
from handtrack_app.page.scene.viewpoint import Viewpoint, look_from

_NAME = "/rig"
_DEEP, _HIGH = 0.3, 240
"""of a frustum, as a share of the cameras' usual distance; of its picture [px]"""
_AWAY = 2.8  # from which it is seen, in the cameras' usual distances
_COLOUR = (150, 158, 168)


def first_image(video: Path, where: str) -> Bytes[H, W, D3] | None:
    """Return a video's first image, small, RGB; None where it cannot be read."""
    try:
        source = VideoFile(video, None, where)
        image = source.read(0)
        source.close()
    except HandtrackError:
        return None
    if image is None:
        return None
    size = (round(image.shape[1] * _HIGH / image.shape[0]), _HIGH)
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.cvtColor(small, cv2.COLOR_BGR2RGB), np.uint8)


def show_rig(server: viser.ViserServer, rig: CameraRig, images: dict[str, Bytes[H, W, D3]]) -> None:
    """Draw the cameras, in a size in which they stand about a metre from what they look at, whatever their unit."""
    cameras = list(rig)
    middles = np.stack([camera.matrix[None, :2, 2] for camera in cameras])
    centre = triangulated([camera.without_distortion() for camera in cameras], middles)[0]
    places = np.stack([camera.centre for camera in cameras])
    if not np.isfinite(centre).all():
        centre = places.mean(axis=0) + cameras[0].rotation[2] * max(float(np.ptp(places)), 1.0)
    unit = float(np.median(np.linalg.norm(places - centre, axis=1))) or 1.0
    with server.atomic():
        server.scene.remove_by_name(_NAME)
        server.scene.add_frame(_NAME, show_axes=False)
        for camera, place in zip(cameras, (places - centre) / unit, strict=True):
            (width, height), down = camera.size, camera.size[1] / 2 / camera.matrix[1, 1]
            # viser's scale is that of the volume
            scale = _DEEP * float(np.cbrt(down * down * width / height / 3))
            wxyz = vtf.SO3.from_matrix(camera.rotation.T).wxyz
            server.scene.add_camera_frustum(
                f"{_NAME}/{camera.name}", fov=float(2 * np.arctan(down)), aspect=width / height, scale=scale, thickness=1.5,
                thickness_units="screen", color=_COLOUR, image=images.get(camera.name), format="jpeg", wxyz=wxyz, position=place,
            )  # fmt: skip
            server.scene.add_label(
                f"{_NAME}/{camera.name}/label",
                camera.name,
                position=(0.0, -1.12 * down * _DEEP, _DEEP),
            )
    up = -np.mean([camera.rotation[1] for camera in cameras], axis=0)
    middle = np.mean((places - centre) / unit, axis=0)
    away = middle + 0.8 * up + 0.6 * np.cross(up, middle)
    seen_from = middle / 2 + _AWAY * away / np.linalg.norm(away)
    view = Viewpoint(seen_from, middle / 2, up / np.linalg.norm(up), 0.75)
    server.scene.set_up_direction(view.up)
    for client in server.get_clients().values():
        look_from(client, view)
