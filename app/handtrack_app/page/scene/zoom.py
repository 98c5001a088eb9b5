"""Which part of a camera's image a window shows: from the camera's centre, so that model and image match however it turns.

A place in a window is a pair of shares, (0, 0) its upper left corner and (1, 1) its lower right one, as viser tells clicks.
A pixel is a column and a row of the camera's undistorted image; pixel centres have whole coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import viser

from handtrack.arrays import D3, Floats, N
from handtrack.geometry.camera import Camera, camera_matrix
from handtrack.geometry.rotation import matrix_from_quaternion

MOST = 12.0
"""times that a picture is enlarged at most"""
_AIR = 1.04  # around what just fits
_AROUND = 1.5  # around a hand: what is beside it is looked at, too
_STEPS = (
    12  # of bringing a pixel to a place; each leaves a small share of the way, even of wide images
)

Pixel = tuple[float, float]
Place = tuple[float, float]
Box = tuple[float, float, float, float]
"""x, y, width, height [px]"""


@dataclass(frozen=True)
class Zoom:
    """Which part of an image is shown."""

    aim: Pixel
    """what is in the window's middle"""
    times: float = 1.0
    """1: the whole image just fits into the window"""


def window_camera(camera: viser.CameraHandle) -> Camera:
    """Return a browser's view as a camera whose image is the window."""
    width, height = max(camera.image_width, 1), max(camera.image_height, 1)
    focal = 0.5 * height / np.tan(0.5 * float(camera.fov))
    matrix = camera_matrix(focal, focal, (width - 1) / 2, (height - 1) / 2)
    turn = matrix_from_quaternion(camera.wxyz).T
    return Camera("", (width, height), matrix, np.zeros(5), turn, -turn @ np.array(camera.position))


def ray_pixel(card: Camera, ray: Floats[D3]) -> Pixel | None:
    """Return the pixel at which a camera sees what lies in a direction (world) from its centre; None for what is behind."""
    column, row = card.project(card.centre + ray).tolist()
    return (column, row) if np.isfinite(row) else None


def eye(card: Camera, zoom: Zoom, aspect: float) -> Camera:
    """Return how a window looks into a camera's image, as a camera at the origin whose pixels are places of the window; rows are level
    in its middle. aspect: the window's width by its height.
    """
    down = 0.5 * zoom.times / _all_of_it(card, aspect)
    matrix = camera_matrix(down / aspect, down, 0.5, 0.5)
    return Camera("", (1, 1), matrix, np.zeros(5), _turned(card, zoom.aim).T, np.zeros(3))


def fov_of(view: Camera) -> float:
    """Return the vertical field of view [rad] of an `eye`."""
    return float(2 * np.arctan(0.5 / view.matrix[1, 1]))


def whole(card: Camera) -> Zoom:
    """Return what shows the whole image."""
    return Zoom(((card.size[0] - 1) / 2, (card.size[1] - 1) / 2))


def around(card: Camera, box: Box, aspect: float) -> Zoom:
    """Return what shows a box of the image, with what is around it, at most `MOST` times enlarged."""
    x, y, width, height = box
    zoom = _within(card, Zoom((x + width / 2, y + height / 2)))
    corners = np.array([(x + a * width, y + b * height) for a in (0, 1) for b in (0, 1)])
    half = _AROUND * _fitting(card, _turned(card, zoom.aim), corners, aspect)
    times = _all_of_it(card, aspect) / max(half, 1e-9)
    return replace(zoom, times=float(np.clip(times, 1.0, MOST)))


def with_pixel_at(card: Camera, zoom: Zoom, aspect: float, pixel: Pixel, place: Place) -> Zoom:
    """Return the same enlargement turned so that a pixel is seen at a place of the window, as far as the image reaches."""
    for _ in range(_STEPS):
        here = ray_pixel(card, eye(card, zoom, aspect).rays(np.array(place)))
        if here is None:
            break
        aim = (zoom.aim[0] + pixel[0] - here[0], zoom.aim[1] + pixel[1] - here[1])
        zoom = _within(card, replace(zoom, aim=aim))
    return zoom


def enlarged(card: Camera, zoom: Zoom, factor: float) -> Zoom:
    """Return an enlargement by a further factor; the whole image, where it fits."""
    times = zoom.times * factor
    return replace(zoom, times=min(times, MOST)) if times > 1.0 else whole(card)


def box_of(card: Camera, points: Floats[N, D3], radii: Floats[N]) -> Box | None:
    """Return the box that balls, world [m], have in a camera's image; None where none is before it."""
    depth = card.to_camera(points)[:, 2]
    ahead = depth > radii + 1e-6
    if not ahead.any():
        return None
    pixels = card.project(points[ahead])
    reach = (radii / depth)[ahead, None] * np.diag(card.matrix)[:2]
    low, high = (pixels - reach).min(axis=0), (pixels + reach).max(axis=0)
    return float(low[0]), float(low[1]), float(high[0] - low[0]), float(high[1] - low[1])


def _turned(card: Camera, aim: Pixel) -> Floats[D3, D3]:
    """Return the axes of a view straight at a pixel, that has the image's rows level there."""
    ahead, across = card.rays(np.array(aim)), card.rotation[0]
    right = across - (across @ ahead) * ahead
    right = right / np.linalg.norm(right)
    return np.stack([right, np.cross(ahead, right), ahead], axis=1)


def _all_of_it(card: Camera, aspect: float) -> float:
    right, bottom = card.size[0] - 0.5, card.size[1] - 0.5
    corners = np.array([(-0.5, -0.5), (right, -0.5), (-0.5, bottom), (right, bottom)])
    return _fitting(card, _turned(card, whole(card).aim), corners, aspect)


def _fitting(card: Camera, rotation: Floats, pixels: Floats, aspect: float) -> float:
    """Return the tangent of half the field of view that has pixels (N, 2) just inside a window."""
    rays = card.rays(pixels) @ rotation
    ahead = np.maximum(rays[:, 2], 1e-3)
    return float(_AIR * np.max(np.abs(rays[:, :2] / ahead[:, None]) / (aspect, 1.0)))


def _within(card: Camera, zoom: Zoom) -> Zoom:
    """Return a zoom that aims at a pixel of the image."""
    aim = np.clip(zoom.aim, 0.0, np.array(card.size) - 1.0)
    return replace(zoom, aim=(float(aim[0]), float(aim[1])))
