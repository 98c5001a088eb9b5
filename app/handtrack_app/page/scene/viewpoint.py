"""Where a view stands: free, so that hand and cameras just fill the page; or at a camera's centre, on a part of its image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import viser

from handtrack.arrays import D3, D5, Floats, N
from handtrack.geometry.camera import Camera, camera_matrix
from handtrack.geometry.rotation import matrix_from_quaternion
from handtrack_app import viser_internals as internals
from handtrack_app.protocol import SessionSnapshot

_LEAST = 0.35  # share of the picture's height that a hand reaches over at least if cameras are shown with it at first: bent, it fills two thirds of that
_FOV = 0.65  # of a free view, from top to bottom [rad]
_WIDE, _ABOVE, _BELOW = 0.9, 0.94, 0.94  # free part of the picture, in half heights


@dataclass(frozen=True)
class Viewpoint:
    """Where a free view stands."""

    position: Floats[D3]
    look_at: Floats[D3]
    up: Floats[D3]
    fov: float = _FOV


_RAISES, _TURNS = (0.35, 0.2, 0.6, 0.9, 1.3), range(-75, 76, 15)
"""views that are tried: raised by a share of the way to the cameras, and turned about what is upright [°]"""


def first_view(session: SessionSnapshot, hand: Floats[D3]) -> Viewpoint:
    """Return the view to begin with: with the cameras, unless they stand so far off that the hand would be small."""
    wide = hand_view(session, hand, everything=True)
    return wide if _size(wide, hand, session.reach_m) >= _LEAST else hand_view(session, hand)


def hand_view(session: SessionSnapshot, hand: Floats[D3], everything: bool = False) -> Viewpoint:
    """Return the view that shows the hand, and everything else where that is asked for, as large as can be, with no camera before it.

    From the cameras' side and above, so that their pictures are seen upright, not from their backs. hand: its middle [m].
    """
    frusta = [frustum_corners(card, hand) for card in session.cameras]
    images = [corners[1:] for corners in frusta] if everything else []
    around = session.reach_m * np.array(list(product((-1.0, 1.0), repeat=3)))
    points = np.concatenate([hand + around, *images])
    up = upward(session)
    tried = list[tuple[float, Viewpoint]]()
    for raised, turn in product(_RAISES, np.deg2rad([*_TURNS])):
        axes = _axes(session, hand, up, raised, turn)
        view = _fitted(points, axes, up)
        score = _size(view, hand, session.reach_m) - 0.04 * (abs(turn) + abs(raised - _RAISES[0]))
        for card, corners in zip(session.cameras, frusta, strict=True):
            score -= 0.5 * _hides(view, axes, corners, hand, session.reach_m)
            score += 0.15 * min(float(-axes[2] @ card.rotation[2]), 0.6) / len(frusta)
        tried.append((score, view))
    return max(tried, key=lambda one: one[0])[1]


def _size(view: Viewpoint, hand: Floats, reach_m: float) -> float:
    """Return the share of the picture's height that a hand fills."""
    return float(reach_m / (np.linalg.norm(view.position - hand) * np.tan(view.fov / 2)))


def _hides(view: Viewpoint, axes: Floats, frustum: Floats, hand: Floats, reach_m: float) -> bool:
    """Return whether a drawn camera (5, 3) comes into the round place that the hand has in the picture."""
    apex, *image = frustum
    middle = np.mean(image, axis=0)
    edges = [a + s * (b - a) for a in image for b in (apex, middle) for s in np.linspace(0, 1, 7)]
    observed = np.array([hand, *edges]) - view.position
    depth = -observed @ axes[2]
    flat = observed @ axes[:2].T / np.maximum(depth, 1e-6)[:, None]
    near = np.linalg.norm(flat[1:] - flat[0], axis=1) < 0.9 * reach_m / depth[0]
    return bool(near.any())


def upward(session: SessionSnapshot) -> Floats[D3]:
    """Return the mean of the cameras' upward axes: worlds differ."""
    up = -np.mean([card.rotation[1] for card in session.cameras], axis=0)
    if np.linalg.norm(up) < 0.2:
        up = -session.cameras[0].rotation[1]
    return up / np.linalg.norm(up)


def frustum_depth(card: Camera, hand: Floats[D3]) -> float:
    """Return how deep a camera's frustum is drawn [m]: large enough to see its image, clear of the hand."""
    return float(np.clip(0.28 * np.linalg.norm(card.centre - hand), 0.05, 0.25))


def frustum_corners(card: Camera, hand: Floats[D3]) -> Floats[D5, D3]:
    """Return the apex and the image's corners of a camera as it is drawn, world [m]."""
    (width, height), matrix = card.size, card.matrix
    deep = frustum_depth(card, hand)
    across, down = 0.5 * width / matrix[0, 0], 0.5 * height / matrix[1, 1]
    corners = [(0.0, 0.0, 0.0)] + [(x * across, y * down, 1.0) for x in (-1, 1) for y in (-1, 1)]
    return card.centre + deep * np.array(corners) @ card.rotation


def _axes(
    session: SessionSnapshot, hand: Floats, up: Floats, raised: float, turn: float
) -> Floats[D3, D3]:
    """Return the axes of a view from where the cameras are, raised by a share of the way, turned about `up` [rad]: unit vectors to
    the right, upward in the picture, and towards the viewer.
    """
    ways = [card.centre - hand for card in session.cameras]
    back = np.mean([way / max(np.linalg.norm(way), 1e-9) for way in ways], axis=0)
    if np.linalg.norm(back) < 0.4:  # they stand all around
        back = ways[0]
    level = back - (back @ up) * up
    if np.linalg.norm(level) < 0.05:  # they look straight down, or up
        above = session.cameras[0].rotation[1]
        level = (above @ up) * up - above
    level = level / max(float(np.linalg.norm(level)), 1e-9)
    away = np.cos(turn) * level + np.sin(turn) * np.cross(up, level) + raised * up
    away /= np.linalg.norm(away)
    right = np.cross(up, away)
    right /= max(float(np.linalg.norm(right)), 1e-9)
    return np.stack([right, np.cross(away, right), away])


def _fitted(points: Floats, axes: Floats[D3, D3], up: Floats) -> Viewpoint:
    """Return the nearest view along given axes that has all points (N, 3) in the free part of the picture.

    A point is in it when |x − a| ≤ w (d − z) and y between −l (d − z) and h (d − z) of b, where the view stands
    at (a, b, d): bounds linear in a, b and d, so the least d follows from the extremes.
    """
    t = np.tan(_FOV / 2)
    wide, above, below = _WIDE * t, _ABOVE * t, _BELOW * t
    x, y, z = axes @ points.T
    right, left = np.max(x + wide * z), np.min(x - wide * z)
    top, bottom = np.max(y + above * z), np.min(y - below * z)
    d = max((right - left) / (2 * wide), (top - bottom) / (above + below))
    a = 0.5 * (right + left)
    slack = d * (above + below) - (top - bottom)
    b = top - above * d + 0.5 * slack
    position = axes.T @ (a, b, d)
    middle = float(points.mean(axis=0) @ axes[2])
    return Viewpoint(position, position - (d - middle) * axes[2], up)


def look_from(
    client: viser.ClientHandle, view: Viewpoint, near: tuple[float, float] | None = None
) -> None:
    """Move a client's view to a viewpoint. The handle's own setters leave out what they believe is there already, or take for too small a
    step. near: how near and far the point looked at may be from now on [m]; None: as it was.
    """
    up, position, target = (
        (float(x), float(y), float(z)) for x, y, z in (view.up, view.position, view.look_at)
    )
    messages: list[internals.Message] = [
        internals.messages.SetCameraUpDirectionMessage(up),
        internals.messages.SetCameraPositionMessage(position),
        internals.messages.SetCameraLookAtMessage(target),
        internals.messages.SetCameraFovMessage(view.fov),  # a page answers to this one: last
    ]
    if near is not None:
        messages.insert(0, internals.messages.SetCameraMinOrbitDistanceMessage(near[0]))
        messages.insert(-1, internals.messages.SetCameraMaxOrbitDistanceMessage(near[1]))
    with client.atomic():
        for message in messages:
            internals.send(client, message)


def begin_at(server: viser.ViserServer, view: Viewpoint) -> None:
    """Let all pages, and those to come, look from a view."""
    server.scene.set_up_direction(view.up)
    start = server.initial_camera
    start.up, start.position, start.look_at = view.up, view.position, view.look_at
    start.fov, start.near, start.far = view.fov, 0.005, 50.0
    for client in server.get_clients().values():
        look_from(client, view)


# ---- Which part of a camera's image a window shows: from the camera's centre, so that model and image match however it turns.
# A place in a window is a pair of shares, (0, 0) its upper left corner and (1, 1) its lower right one, as viser tells clicks.
# A pixel is a column and a row of the camera's undistorted image; pixel centres have whole coordinates


MOST = 12.0
"""times that a picture is enlarged at most"""
_AIR = 1.04  # around what just fits
_AROUND = 1.5  # around a hand: what is beside it is looked at, too
_STEPS = (
    12  # of bringing a pixel to a place; each leaves a small share of the way, even of wide images
)

Pixel = tuple[float, float]
Place = tuple[float, float]
Area = tuple[float, float, float, float]
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


def around(card: Camera, box: Area, aspect: float) -> Zoom:
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


def box_of(card: Camera, points: Floats[N, D3], radii: Floats[N]) -> Area | None:
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
